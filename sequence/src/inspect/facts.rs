//! Facts about cameras, motion, images, depth and the sparse model.

use linecarve_lines::camera::{Camera, Distortion};
use rayon::prelude::*;
use serde::Serialize;

use super::consistency::DepthConsistency;
use super::epipolar::EpipolarFacts;
use super::image_samples::ImageSamples;
use super::registration::RegistrationFacts;
use super::{evenly_spaced, quantile, skip_unreadable};
use crate::{FrameError, Sequence, Warning};

/// Facts about a sequence.
#[derive(Debug, Clone, Serialize)]
pub struct SequenceFacts {
    /// Name of the detected layout.
    pub layout: &'static str,
    /// Number of frames.
    pub frames: usize,
    /// The colour camera as stored.
    pub color: CameraFacts,
    /// Camera motion; `None` without poses.
    pub motion: Option<MotionFacts>,
    /// Colour images; `None` if none of the sample can be decoded.
    pub images: Option<ImageFacts>,
    /// Depth images; `None` if there are none.
    pub depth: Option<DepthFacts>,
    /// Points of the sparse model; `None` if there are none.
    pub map_points: Option<MapPointFacts>,
    /// Consistency of depth images under the poses, for each gap with comparable pairs.
    pub consistency: Vec<DepthConsistency>,
    /// Distances of matched corners to their epipolar lines; `None` if there are too few.
    pub epipolar: Option<EpipolarFacts>,
    /// Distances of depth discontinuities to colour edges; `None` if there are too few.
    pub registration: Option<RegistrationFacts>,
    /// Conventions under which the files were read.
    pub conventions: Vec<String>,
    /// Non-fatal problems and doubtful conventions.
    pub warnings: Vec<Warning>,
}

/// Camera intrinsics.
#[derive(Debug, Clone, Serialize)]
pub struct CameraFacts {
    /// Image width in pixels; `None` when unknown.
    pub width: Option<u32>,
    /// Image height in pixels; `None` when unknown.
    pub height: Option<u32>,
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point x in pixels; the centre of the top-left pixel is 0.
    pub cx: f64,
    /// Principal point y in pixels.
    pub cy: f64,
    /// `pinhole`, `radial-tangential` or `kannala-brandt`.
    pub model: &'static str,
    /// Coefficients of the model.
    pub distortion: Vec<f64>,
    /// The file or default that the camera comes from.
    pub origin: String,
}

/// Motion of the colour camera, in pose units.
#[derive(Debug, Clone, Serialize)]
pub struct MotionFacts {
    /// Length of the camera path.
    pub path_length: f64,
    /// Side lengths of the bounding box of all camera centres, along the world axes.
    pub extent: [f64; 3],
    /// Median distance between consecutive frames.
    pub median_step: f64,
    /// Largest distance between consecutive frames.
    pub largest_step: f64,
    /// The frame after the largest step; `None` for a single frame.
    pub largest_step_to: Option<String>,
    /// Median rotation between consecutive frames in degrees.
    #[serde(rename = "median_turn_deg")]
    pub median_rotation_deg: f64,
}

/// Brightness and blur of a sample of the images.
#[derive(Debug, Clone, Serialize)]
pub struct ImageFacts {
    /// Number of decoded images.
    pub sampled: usize,
    /// Number of undecodable images.
    pub undecodable: usize,
    /// Least and largest mean grey level.
    pub mean_gray: [f64; 2],
    /// Median sharpness: slope of the strongest edges in grey levels a pixel.
    pub median_sharpness: f64,
    /// Sharpness of the most blurred image relative to the median.
    pub least_relative_sharpness: f64,
    /// Name of the most blurred image.
    pub most_blurred: String,
}

/// Depth of a sample of the frames, in pose units.
#[derive(Debug, Clone, Serialize)]
pub struct DepthFacts {
    /// Whether depth is registered to colour.
    pub registered: bool,
    /// Camera of the loaded depth images.
    pub camera: CameraFacts,
    /// Raw depth units per pose unit.
    pub scale: f64,
    /// Number of frames with a depth image.
    pub frames: usize,
    /// Number of decoded depth images.
    pub sampled: usize,
    /// Number of undecodable images.
    pub undecodable: usize,
    /// Mean share of pixels with known depth.
    pub mean_coverage: f64,
    /// Smallest share in an image.
    pub least_coverage: f64,
    /// Number of values of the decoded images that the camera cannot have measured; they are unknown.
    #[serde(skip_serializing_if = "is_zero")]
    pub unmeasurable: usize,
    /// The 1st, 50th and 99th percentile of known depths; `None` if no depth is known.
    pub percentiles: Option<[f64; 3]>,
}

/// Whether a count is omitted.
#[allow(
    clippy::trivially_copy_pass_by_ref,
    reason = "serde hands over references"
)]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Points of the sparse model.
#[derive(Debug, Clone, Serialize)]
pub struct MapPointFacts {
    /// Number of points.
    pub points: usize,
    /// Number of views, with or without an image.
    pub views: usize,
    /// Mean number of observations of a point.
    #[serde(rename = "mean_sightings")]
    pub mean_observations: f64,
    /// Number of observations with a pixel and a camera.
    pub compared: usize,
    /// Median reprojection error in pixels.
    pub median_reprojection_px: Option<f64>,
    /// Share of the observations whose point is in front of the camera.
    pub share_in_front: f64,
}

impl MapPointFacts {
    /// A warning if points and poses are inconsistent.
    fn warning(&self) -> Option<Warning> {
        /// A few points behind cameras are outliers.
        const MIN_SHARE_IN_FRONT: f64 = 0.95;
        const MAX_REPROJECTION_PX: f64 = 4.0;
        if self.share_in_front < MIN_SHARE_IN_FRONT {
            return Some(Warning::statement(format!(
                "only {:.0} % of the map point observations are in front of their camera: check that points and poses \
                 belong together, and the pose convention",
                100.0 * self.share_in_front
            )));
        }
        let median = self
            .median_reprojection_px
            .filter(|px| *px > MAX_REPROJECTION_PX)?;
        Some(Warning::statement(format!(
            "map points have a median reprojection error of {median:.1} px: check that cameras, poses and points belong \
             together"
        )))
    }
}

fn map_points(sequence: &Sequence) -> Option<MapPointFacts> {
    let model = sequence.sparse_model()?;
    let mut errors = Vec::new();
    let (mut observations, mut in_front) = (0_usize, 0_usize);
    for point in &model.points {
        for observation in &point.observations {
            let Some(view) = model.views.get(observation.view as usize) else {
                continue;
            };
            let point_in_camera = view.world_from_camera.inverse() * point.point_in_world;
            observations += 1;
            in_front += usize::from(point_in_camera.z > 0.0);
            if let (Some([x, y]), Some(camera)) = (observation.pixel, &view.camera)
                && let Some(seen) = camera.project(&point_in_camera)
            {
                errors.push((seen.x - x).hypot(seen.y - y));
            }
        }
    }
    Some(MapPointFacts {
        points: model.points.len(),
        views: model.views.len(),
        mean_observations: observations as f64 / model.points.len().max(1) as f64,
        compared: errors.len(),
        median_reprojection_px: quantile(&mut errors, 0.5),
        share_in_front: in_front as f64 / observations.max(1) as f64,
    })
}

fn camera_facts(camera: &Camera, size: Option<(u32, u32)>, origin: String) -> CameraFacts {
    CameraFacts {
        width: size.map(|s| s.0),
        height: size.map(|s| s.1),
        fx: camera.fx(),
        fy: camera.fy(),
        cx: camera.cx(),
        cy: camera.cy(),
        model: match camera.distortion() {
            Distortion::None => "pinhole",
            Distortion::RadialTangential { .. } => "radial-tangential",
            Distortion::KannalaBrandt { .. } => "kannala-brandt",
        },
        distortion: camera.distortion().coefficients(),
        origin,
    }
}

/// Measures all facts except consistency and registration.
pub(super) fn measure(
    sequence: &Sequence,
    image_samples: &ImageSamples,
    samples: usize,
) -> Result<SequenceFacts, FrameError> {
    let size = sequence.color_size();
    let mut facts = SequenceFacts {
        layout: sequence.layout(),
        frames: sequence.frames().len(),
        color: camera_facts(
            sequence.stored_color_camera(),
            Some((size.width, size.height)),
            sequence.color_camera_source().to_owned(),
        ),
        motion: sequence.has_poses().then(|| motion(sequence)),
        images: images(sequence, image_samples),
        depth: depth(sequence, samples)?,
        map_points: map_points(sequence),
        consistency: Vec::new(),
        epipolar: None,
        registration: None,
        conventions: sequence.conventions().to_vec(),
        warnings: sequence.warnings().to_vec(),
    };
    if let Some(points) = &facts.map_points {
        facts.warnings.extend(points.warning());
    }
    if let Some(depth) = facts
        .depth
        .as_ref()
        .filter(|depth| depth.percentiles.is_none())
    {
        facts.warnings.push(Warning::statement(format!(
            "none of {} depth images has a pixel of known depth: check the depth images",
            depth.sampled
        )));
    }
    Ok(facts)
}

fn motion(sequence: &Sequence) -> MotionFacts {
    let frames = sequence.frames();
    let mut steps = Vec::new();
    let mut rotations = Vec::new();
    let mut largest: Option<(f64, usize)> = None;
    for (index, pair) in frames.windows(2).enumerate() {
        let [from, to] = [0, 1].map(|i| &pair[i].world_from_camera);
        let step = (to.translation.vector - from.translation.vector).norm();
        steps.push(step);
        rotations.push(to.rotation.angle_to(&from.rotation).to_degrees());
        if largest.is_none_or(|(most, _)| step > most) {
            largest = Some((step, index + 1));
        }
    }
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for frame in frames {
        for axis in 0..3 {
            let value = frame.world_from_camera.translation.vector[axis];
            low[axis] = low[axis].min(value);
            high[axis] = high[axis].max(value);
        }
    }
    MotionFacts {
        path_length: steps.iter().fold(0.0, |sum, step| sum + step),
        extent: [0, 1, 2].map(|axis| (high[axis] - low[axis]).max(0.0)),
        median_step: quantile(&mut steps, 0.5).unwrap_or(0.0),
        largest_step: largest.map_or(0.0, |(step, _)| step),
        largest_step_to: largest.map(|(_, index)| frames[index].name.clone()),
        median_rotation_deg: quantile(&mut rotations, 0.5).unwrap_or(0.0),
    }
}

fn images(sequence: &Sequence, image_samples: &ImageSamples) -> Option<ImageFacts> {
    let measured: Vec<Option<(usize, f64, f64)>> = image_samples
        .sampled()
        .map(|(frame, sample)| sample.map(|sample| (frame, sample.mean_gray, sample.sharpness)))
        .collect();
    let known: Vec<(usize, f64, f64)> = measured.iter().flatten().copied().collect();
    let &first = known.first()?;
    let mut all: Vec<f64> = known.iter().map(|row| row.2).collect();
    let median_sharpness = quantile(&mut all, 0.5).unwrap_or(0.0);
    let blurred = known.iter().fold(
        first,
        |least, row| if row.2 < least.2 { *row } else { least },
    );
    Some(ImageFacts {
        sampled: known.len(),
        undecodable: measured.len() - known.len(),
        mean_gray: known.iter().fold([first.1; 2], |[low, high], row| {
            [low.min(row.1), high.max(row.1)]
        }),
        median_sharpness,
        least_relative_sharpness: if median_sharpness > 0.0 {
            blurred.2 / median_sharpness
        } else {
            1.0
        },
        most_blurred: sequence.frames()[blurred.0].name.clone(),
    })
}

fn depth(sequence: &Sequence, samples: usize) -> Result<Option<DepthFacts>, FrameError> {
    /// Every how many pixels one enters the percentiles.
    const STRIDE: usize = 61;
    let Some(calibration) = sequence.depth_calibration() else {
        return Ok(None);
    };
    let with_depth: Vec<usize> = (0..sequence.frames().len())
        .filter(|&index| sequence.frames()[index].depth.is_some())
        .collect();
    let measured = evenly_spaced(with_depth.len(), samples)
        .par_iter()
        .map(|&at| {
            let loaded =
                skip_unreadable(sequence.load_depth_with_excess(with_depth[at]))?.flatten();
            Ok(loaded.map(|loaded| {
                let (depth, unmeasurable) = (loaded.depth, loaded.unmeasurable);
                let all = depth.samples();
                let known = all.iter().filter(|&&z| z > 0.0).count();
                let few: Vec<f64> = all
                    .iter()
                    .step_by(STRIDE)
                    .filter(|&&z| z > 0.0)
                    .map(|&z| f64::from(z))
                    .collect();
                (
                    known as f64 / all.len().max(1) as f64,
                    few,
                    (depth.width(), depth.height()),
                    unmeasurable,
                )
            }))
        })
        .collect::<Result<Vec<_>, FrameError>>()?;
    let sampled = measured.iter().flatten().count();
    let coverage = || measured.iter().flatten().map(|row| row.0);
    let mut depths: Vec<f64> = measured
        .iter()
        .flatten()
        .flat_map(|row| row.1.iter().copied())
        .collect();
    let percentiles = match [0.01, 0.5, 0.99].map(|share| quantile(&mut depths, share)) {
        [Some(low), Some(middle), Some(high)] => Some([low, middle, high]),
        _ => None,
    };
    let size = measured
        .iter()
        .flatten()
        .next()
        .map(|row| (row.2.0 as u32, row.2.1 as u32));
    let origin = if calibration.registered {
        "registered to colour"
    } else {
        "a separate camera"
    };
    Ok(Some(DepthFacts {
        registered: calibration.registered,
        camera: camera_facts(&calibration.camera, size, origin.to_owned()),
        scale: calibration.scale,
        frames: with_depth.len(),
        sampled,
        undecodable: measured.len() - sampled,
        mean_coverage: coverage().sum::<f64>() / sampled.max(1) as f64,
        least_coverage: coverage().fold(1.0, f64::min) * f64::from(u8::from(sampled > 0)),
        unmeasurable: measured.iter().flatten().map(|row| row.3).sum(),
        percentiles,
    }))
}
