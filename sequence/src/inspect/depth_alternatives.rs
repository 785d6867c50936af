//! Conventions of depth to test: pose conventions, depth scales, intrinsics.

use linecarve_lines::camera::Camera;
use rayon::prelude::*;

use super::consistency::FITS;
use super::depth_pair::DepthPair;
use super::intrinsics_hypotheses::{
    FOCAL_STEP, description, focal_hypotheses, refined, section as section_of,
};
use super::pose_hypotheses::{PoseHypothesis, axes_hypotheses, pose_hypotheses, simplest_of_best};
use super::quantile;
use crate::{DepthCalibration, DepthValues, Sequence};

/// Common depth scales: millimetres, TUM RGB-D, RealSense L515, a power of two, Replica, and tenths of a millimetre.
const SCALES: [f64; 6] = [1000.0, 5000.0, 4000.0, 256.0, 6553.5, 10_000.0];

/// Poses in metres, centimetres and millimetres: the factor on a common scale.
const POSE_UNITS: [(f64, &str); 3] = [
    (1.0, ""),
    (0.01, ", as for poses in centimetres"),
    (0.001, ", as for poses in millimetres"),
];

/// A found scale within this share of a common one is that.
const COMMON_SCALE: f64 = 0.05;

/// Ratio of the scales that the search tries first, and their number on either side.
const SCALE_STEP: f64 = 1.15;
const SCALE_STEPS: i32 = 66;

/// With a larger misfit at the best of the first scales none between them fits: that is at most half a step away, and the misfit changes by
/// less than the scale.
const WORTH_REFINING: f64 = FITS + 0.5 * (SCALE_STEP - 1.0);

/// Of the pixels that are compared, a search takes every so many-th in either direction: first, and around what it found.
const COARSE: usize = 4;
const FINE: usize = 2;

/// The best scale must fit this much better than one that makes the motion vanish: otherwise only the rotation fits.
const BETTER_THAN_ROTATION: f64 = 0.5;

/// The best of many axes must fit this much better than those read: of many wrong ones, some fit a little better.
const AXES_BETTER: f64 = 0.25;

/// Smallest share of the compared pixels that must overlap under a scale.
const MIN_OVERLAP: f64 = 0.2;

/// A convention of poses, depth scale and camera to test.
#[derive(Clone)]
pub(super) struct DepthConvention {
    pub(super) description: String,
    /// The sidecar entry that selects it.
    pub(super) remedy: Option<String>,
    pub(super) differences: usize,
    pub(super) poses: PoseHypothesis,
    /// What raw values measure.
    pub(super) values: DepthValues,
    /// Factor on depth, after values were read as `values` says.
    pub(super) factor: f64,
    /// The depth camera, if it is not that of the files.
    pub(super) camera: Option<Camera>,
}

impl DepthConvention {
    fn of_poses(poses: PoseHypothesis, calibration: &DepthCalibration) -> Self {
        Self {
            description: poses.description.clone(),
            remedy: poses.remedy.clone(),
            differences: poses.differences,
            poses,
            values: calibration.values,
            factor: 1.0,
            camera: None,
        }
    }

    /// The same with another scale of depth.
    fn with_scale(&self, calibration: &DepthCalibration, scale: f64) -> Self {
        let is_inverse = self.values == DepthValues::InverseDepth;
        let words = format!(
            "a depth scale of {scale} instead of {}{}",
            calibration.scale,
            if is_inverse { "" } else { pose_unit_of(scale) }
        );
        Self {
            factor: match is_inverse {
                true => scale / calibration.scale,
                false => calibration.scale / scale,
            },
            ..self.with(&words, &format!("scale = {scale:?}"))
        }
    }

    /// The scale that a factor stands for.
    fn scale_of(&self, calibration: &DepthCalibration, factor: f64) -> f64 {
        match self.values {
            DepthValues::InverseDepth => calibration.scale * factor,
            DepthValues::Depth | DepthValues::Distance => calibration.scale / factor,
        }
    }

    /// The same with raw values that measure something else.
    fn with_values(&self, values: DepthValues) -> Self {
        Self {
            values,
            ..self.with(values.words(), &format!("values = \"{}\"", values.name()))
        }
    }

    /// The same with a line more of section `[depth]`.
    fn with(&self, words: &str, line: &str) -> Self {
        const SECTION: &str = "[depth]";
        let remedy = match &self.remedy {
            Some(remedy) if remedy.contains(SECTION) => format!("{remedy}\n{line}"),
            Some(remedy) => format!("{remedy}\n{SECTION}\n{line}"),
            None => format!("{SECTION}\n{line}"),
        };
        Self {
            description: joined(self, ", ", words),
            remedy: Some(remedy),
            differences: self.differences + 1,
            ..self.clone()
        }
    }
}

fn joined(first: &DepthConvention, separator: &str, words: &str) -> String {
    if first.differences == 0 {
        words.to_owned()
    } else {
        format!("{}{separator}{words}", first.description)
    }
}

/// The convention as read.
pub(super) fn as_read(sequence: &Sequence, calibration: &DepthCalibration) -> DepthConvention {
    DepthConvention::of_poses(PoseHypothesis::as_read(sequence), calibration)
}

/// What raw values may measure instead.
fn other_values(calibration: &DepthCalibration) -> impl Iterator<Item = DepthValues> {
    let read = calibration.values;
    DepthValues::ALL
        .into_iter()
        .filter(move |other| *other != read)
}

/// Alternative pose conventions, then common depth scales, then values that measure something else.
pub(super) fn alternatives(
    sequence: &Sequence,
    calibration: &DepthCalibration,
) -> Vec<DepthConvention> {
    let of_scales = SCALES
        .into_iter()
        .filter(|other| (other / calibration.scale - 1.0).abs() > 1e-3)
        .map(|scale| as_read(sequence, calibration).with_scale(calibration, scale));
    // The scale of inverse depth is searched for.
    let of_values = other_values(calibration)
        .filter(|other| {
            *other != DepthValues::InverseDepth && calibration.values != DepthValues::InverseDepth
        })
        .map(|other| as_read(sequence, calibration).with_values(other));
    pose_hypotheses(sequence)
        .into_iter()
        .filter(|poses| poses.differences > 0)
        .map(|poses| DepthConvention::of_poses(poses, calibration))
        .chain(of_scales)
        .chain(of_values)
        .collect()
}

/// The depth scale and the focal length that fit best, and both with other pose conventions unless those fit by themselves.
pub(super) fn search(
    sequence: &Sequence,
    calibration: &DepthCalibration,
    pairs: &[DepthPair],
    is_explained: bool,
) -> Vec<DepthConvention> {
    let search = Search {
        sequence,
        calibration,
        pairs,
    };
    let as_read = as_read(sequence, calibration);
    let mut found: Vec<DepthConvention> = search.best_scale(&as_read).into_iter().collect();
    found.extend(search.best_focal(&as_read));
    if !is_explained {
        let single = pose_hypotheses(sequence)
            .into_iter()
            .filter(|poses| poses.differences == 1 && poses.remedy.is_some());
        found.extend(
            single.filter_map(|poses| {
                search.best_scale(&DepthConvention::of_poses(poses, calibration))
            }),
        );
        let of_values = other_values(calibration).map(|other| as_read.with_values(other));
        found.extend(of_values.filter_map(|convention| search.best_scale(&convention)));
    }
    found.extend(search.best_axes(&as_read));
    found
}

struct Search<'a> {
    sequence: &'a Sequence,
    calibration: &'a DepthCalibration,
    pairs: &'a [DepthPair],
}

impl Search<'_> {
    /// Median relative difference, and the number of pixels compared: every `every`-th of those of a pair.
    fn fit(&self, convention: &DepthConvention, every: usize) -> (f64, usize) {
        let mut relative: Vec<f64> = self
            .pairs
            .iter()
            .flat_map(|pair| pair.residuals(self.sequence, self.calibration, convention, every))
            .map(|residual| residual.1)
            .collect();
        let count = relative.len();
        (quantile(&mut relative, 0.5).unwrap_or(f64::INFINITY), count)
    }

    /// The best of some conventions by their fit.
    fn best(
        &self,
        conventions: impl Iterator<Item = DepthConvention>,
        every: usize,
    ) -> Option<(f64, DepthConvention)> {
        let measured = self.measured(conventions, every).into_iter();
        measured.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The fit of some conventions, of those with enough overlap.
    fn measured(
        &self,
        conventions: impl Iterator<Item = DepthConvention>,
        every: usize,
    ) -> Vec<(f64, DepthConvention)> {
        let conventions: Vec<DepthConvention> = conventions.collect();
        let measured: Vec<((f64, usize), DepthConvention)> = conventions
            .into_par_iter()
            .map(|convention| (self.fit(&convention, every), convention))
            .collect();
        let most = measured
            .iter()
            .map(|((_, count), _)| *count)
            .max()
            .unwrap_or(0);
        measured
            .into_iter()
            .filter(|((_, count), _)| *count as f64 >= MIN_OVERLAP * most as f64)
            .map(|((misfit, _), convention)| (misfit, convention))
            .collect()
    }

    /// A convention with the depth scale that fits best; `None` if no scale is clearly best.
    fn best_scale(&self, convention: &DepthConvention) -> Option<DepthConvention> {
        let with_factor = |factor: f64| DepthConvention {
            factor,
            ..convention.clone()
        };
        let ladder = (-SCALE_STEPS..=SCALE_STEPS).map(|step| SCALE_STEP.powi(step));
        let (misfit, coarse) = self.best(ladder.map(with_factor), COARSE)?;
        if misfit > WORTH_REFINING {
            return None;
        }
        let fine = (-20..=20).map(|step| coarse.factor * SCALE_STEP.powf(f64::from(step) / 20.0));
        let (misfit, fine) = self.best(fine.map(with_factor), FINE)?;
        let (of_rotation, _) = self.fit(&with_factor(1e9), FINE);
        if misfit >= BETTER_THAN_ROTATION * of_rotation {
            return None;
        }
        let scale = common_scale(convention.scale_of(self.calibration, fine.factor));
        Some(convention.with_scale(self.calibration, scale))
    }

    /// The other axes that fit best, of poses or of depth images that are turned or mirrored; `None` if none is far better.
    fn best_axes(&self, as_read: &DepthConvention) -> Option<DepthConvention> {
        let axes = axes_hypotheses(self.sequence).into_iter();
        let measured = self.measured(
            axes.map(|poses| DepthConvention::of_poses(poses, self.calibration)),
            COARSE,
        );
        let (misfit, best) = simplest_of_best(&measured, |(misfit, it)| (*misfit, it.differences))?;
        let (of_read, _) = self.fit(as_read, COARSE);
        (*misfit < AXES_BETTER * of_read).then(|| best.clone())
    }

    /// The focal length that fits best.
    fn best_focal(&self, convention: &DepthConvention) -> Option<DepthConvention> {
        let camera = &self.calibration.camera;
        // The distortion of a separate depth camera is not kept: its remedy is only a number to start from.
        let (name, stored, size) = if self.calibration.registered {
            let stored = self.sequence.stored_color_camera();
            ("color", stored, self.sequence.color_size())
        } else {
            ("depth", camera, self.sequence.stored_depth_size?)
        };
        let size = [size.width, size.height];
        let of_camera = |camera: Camera| DepthConvention {
            camera: Some(camera),
            ..convention.clone()
        };
        let (_, coarse) = self.best(
            focal_hypotheses(camera, size).into_iter().map(of_camera),
            COARSE,
        )?;
        let around = refined(coarse.camera.as_ref()?, FOCAL_STEP);
        let (_, best) = self.best(around.into_iter().map(of_camera), FINE)?;
        let found = best.camera?;
        Some(DepthConvention {
            description: description(camera, &found),
            remedy: Some(section_of(name, &found, camera, stored)),
            differences: convention.differences + 1,
            camera: Some(found),
            ..convention.clone()
        })
    }
}

/// A scale rounded to a common one, if it is near, else to three digits.
fn common_scale(scale: f64) -> f64 {
    POSE_UNITS
        .into_iter()
        .flat_map(|(unit, _)| SCALES.map(|common| common * unit))
        .filter(|common| (scale / common - 1.0).abs() < COMMON_SCALE)
        .min_by(|a, b| {
            let off = |common: &f64| (scale / common - 1.0).abs();
            off(a).total_cmp(&off(b))
        })
        .unwrap_or_else(|| rounded(scale))
}

/// What a scale says about the unit of poses.
fn pose_unit_of(scale: f64) -> &'static str {
    POSE_UNITS
        .into_iter()
        .find(|(unit, _)| {
            SCALES
                .iter()
                .any(|common| (scale / (common * unit) - 1.0).abs() < 1e-6)
        })
        .map_or("", |(_, words)| words)
}

/// Three significant digits.
pub(super) fn rounded(value: f64) -> f64 {
    if !(value.is_finite() && value != 0.0) {
        return value;
    }
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scales_near_a_common_one_are_that() {
        assert_eq!(common_scale(4980.0), 5000.0);
        assert_eq!(common_scale(5.02), 5.0);
        assert_eq!(common_scale(6500.0), 6553.5);
        assert_eq!(common_scale(873.21), 873.0);
        assert_eq!(pose_unit_of(5.0), ", as for poses in millimetres");
        assert_eq!(pose_unit_of(873.0), "");
    }
}
