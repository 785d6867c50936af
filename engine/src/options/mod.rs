//! Parameters of all stages. Users set the subset in [`crate::configuration::Configuration`].

mod labels;
mod map;
mod paper;
mod semi_dense;

use std::fmt::Display;

use linecarve_carving::CutOptionsError;
use linecarve_lines::ExtractOptions;
use linecarve_lines::cluster::ClusterOptions;
use linecarve_lines::depth::semi_dense::SemiDenseOptionsError;
use linecarve_lines::depth::{EdgeDepthOptions, SensorNoise};
use linecarve_lines::edges::EdgeOptions;
use linecarve_lines::fit::FitOptions;
use linecarve_lines::paper::PaperOptions;

use linecarve_mesh::diff::Tolerance;
use linecarve_points::{MapPointOptions, PointOptionsError, PoseCorrectionOptions};
use linecarve_sequence::KeyframeOptions;

pub use labels::{CutSettings, LabelKind};
pub use map::{LandmarkOptions, PointModelOptions, SegmentPointOptions, SurfacePointOptions};
pub use semi_dense::SemiDenseStage;

/// Parameters of all stages.
#[derive(Debug, Clone, Default, PartialEq)]
#[non_exhaustive]
pub struct Options {
    /// Selection of keyframes.
    pub keyframes: KeyframeOptions,
    /// Image loading.
    pub images: ImageOptions,
    /// Depth camera.
    pub sensor: SensorOptions,
    /// Depth from neighbouring keyframes.
    pub semi_dense: SemiDenseStage,
    /// How segments are found and clustered.
    pub lines: LineMethod,
    /// Edge chains.
    pub edges: EdgeOptions,
    /// Depth of edge pixels.
    pub edge_depth: EdgeDepthOptions,
    /// Fitting of segments.
    pub fit: FitOptions,
    /// Clustering of segments.
    pub cluster: ClusterOptions,
    /// Points along segments.
    pub segment_points: SegmentPointOptions,
    /// Points between the segments.
    pub surface_points: SurfacePointOptions,
    /// Fusion of landmarks.
    pub landmarks: LandmarkOptions,
    /// Correction of poses from images.
    pub pose_correction: PoseCorrectionOptions,
    /// Map points from features.
    pub map_points: MapPointOptions,
    /// Points of a sparse model.
    pub point_model: PointModelOptions,
    /// Free-space carving.
    pub carving: CarvingOptions,
    /// Surface export.
    pub surface: SurfaceOptions,
    /// Simplification of the final mesh.
    pub simplify: SimplifySettings,
}

/// How segments are found and clustered.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum LineMethod {
    /// As `fit` and `cluster` say.
    #[default]
    EdgeAided,
    /// As the paper says, to the letter: see [`linecarve_lines::paper`].
    Paper,
}

/// Image loading.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct ImageOptions {
    /// Images with a longer side are downscaled by an integer factor; 0: never. Does not apply where depth is registered to
    /// their pixels.
    pub longest_side_px: u32,
}

impl ImageOptions {
    /// The longest allowed side of an image.
    pub(crate) fn longest_side(&self) -> u32 {
        match self.longest_side_px {
            0 => u32::MAX,
            pixels => pixels,
        }
    }
}

impl Default for ImageOptions {
    fn default() -> Self {
        Self {
            longest_side_px: 1600,
        }
    }
}

/// Depth camera.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SensorOptions {
    /// Standard deviation of depth at the median scene depth, as a share of it. That of inverse depth is constant.
    pub relative_noise: f64,
}

impl Default for SensorOptions {
    fn default() -> Self {
        Self {
            relative_noise: SensorNoise::STRUCTURED_LIGHT_RELATIVE,
        }
    }
}

/// Free-space carving.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct CarvingOptions {
    /// Labelling of tetrahedra.
    pub labels: LabelKind,
    /// With votes: least number of rays through a free tetrahedron.
    pub free_threshold: u32,
    /// Width in degrees of the bins of directions in each of which a point has at most one ray; 0: all rays. Rays from
    /// similar directions add cost, but little evidence.
    pub ray_angle_deg: f64,
    /// Settings of the minimum cut.
    pub cut: CutSettings,
}

impl Default for CarvingOptions {
    fn default() -> Self {
        Self {
            labels: LabelKind::default(),
            free_threshold: 1,
            ray_angle_deg: 30.0,
            cut: CutSettings::default(),
        }
    }
}

/// Surface export.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SurfaceOptions {
    /// Where depth is not dense, triangles with an edge longer than this share of the median scene depth are dropped. `None`
    /// keeps all.
    pub longest_edge_share: Option<f64>,
    /// Where depth is dense, triangles with a smaller measured share than this are dropped, all or what was not measured of them; 0 keeps
    /// all.
    pub least_measured_share: f64,
    /// Connected components with fewer triangles are dropped.
    pub minimum_component: usize,
    /// Which holes of the final surface are closed.
    pub holes: HoleFilling,
    /// Whether facets on the convex hull are kept.
    pub keep_hull: bool,
    /// Whether non-manifold vertices and edges are split, so that every edge has at most two triangles.
    pub manifold: bool,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self {
            longest_edge_share: Some(0.5),
            least_measured_share: 0.3,
            minimum_component: 8,
            holes: HoleFilling::default(),
            keep_hull: false,
            manifold: true,
        }
    }
}

/// Which holes of the final surface are closed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HoleFilling {
    /// None.
    None,
    /// Gaps of a single triangle amid others that depth confirms.
    #[default]
    Measured,
    /// All but the largest, whether anything was measured there or not.
    All,
}

/// Simplification of the final mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
#[non_exhaustive]
pub struct SimplifySettings {
    /// Largest distance between the original and the simplified mesh. `None`: no simplification.
    pub tolerance: Option<Tolerance>,
    /// Largest distance by which boundary edges move within the surface. `None`: half the median length of the boundary
    /// edges, at most 20 tolerances.
    pub boundary_tolerance: Option<Tolerance>,
}

/// A parameter is out of range.
#[derive(Debug, thiserror::Error)]
pub enum OptionsError {
    /// A setting of the minimum cut is out of range.
    #[error("carving.cut: {0}")]
    Cut(#[from] CutOptionsError),
    /// A value of semi-dense depth is out of range.
    #[error(transparent)]
    SemiDense(#[from] SemiDenseOptionsError),
    /// A value is out of range.
    #[error("{key} = {value}: {expected}")]
    Range {
        /// Section and key.
        key: &'static str,
        /// The given value.
        value: String,
        /// The expected range.
        expected: &'static str,
    },
    /// An option of map points or pose correction is out of range.
    #[error(transparent)]
    MapPoints(#[from] PointOptionsError),
}

impl Options {
    /// Options of the segment extraction in a scene of this median depth.
    pub fn extract(&self, median_depth: f64) -> ExtractOptions {
        let mut options = ExtractOptions::default();
        options.edges = self.edges;
        options.edge_depth = self.edge_depth;
        options.fit = self.fit;
        options.paper = match self.lines {
            LineMethod::EdgeAided => None,
            LineMethod::Paper => Some(PaperOptions::with_unit(median_depth)),
        };
        options.samples = self
            .surface_points
            .enabled
            .then_some(self.surface_points.samples);
        options
    }

    /// Checks the ranges of values without a check in their own stage.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), OptionsError> {
        let check = |is_valid: bool, key, value: &dyn Display, expected| {
            is_valid.then_some(()).ok_or_else(|| OptionsError::Range {
                key,
                value: value.to_string(),
                expected,
            })
        };
        let positive = |key, value: f64| {
            let expected = "a positive, finite number is needed";
            check(value.is_finite() && value > 0.0, key, &value, expected)
        };
        let angle = |key, degrees: f64| {
            let expected = "an angle from 0 to 45 degrees is needed";
            check((0.0..=45.0).contains(&degrees), key, &degrees, expected)
        };
        positive("sensor.relative_noise", self.sensor.relative_noise)?;
        self.semi_dense.validate()?;
        let landmarks = &self.landmarks;
        positive("landmarks.lateral_px", landmarks.lateral_px)?;
        positive("landmarks.depth_sigmas", landmarks.depth_sigmas)?;
        let points = &self.surface_points;
        positive("surface_points.agreement_sigmas", points.agreement_sigmas)?;
        positive("landmarks.settling_share", landmarks.settling_share)?;
        points
            .samples
            .validate()
            .and_then(|()| points.refine.validate())
            .or_else(|error| check(false, error.key, &error.value, error.expected))?;
        if let Some(spacing) = self.segment_points.spacing_px {
            positive("segment_points.spacing_px", spacing)?;
        }
        if let Some(share) = self.surface.longest_edge_share {
            positive("surface.longest_edge_share", share)?;
        }
        let share = self.surface.least_measured_share;
        check(
            (0.0..=1.0).contains(&share),
            "surface.least_measured_share",
            &share,
            "a share from 0 to 1 is needed",
        )?;
        let carving = &self.carving;
        angle("carving.ray_angle_deg", carving.ray_angle_deg)?;
        positive("carving.cut.sigma_factor", carving.cut.sigma_factor)?;
        carving.cut.options().validate()?;
        self.map_points.validate()?;
        self.pose_correction.validate()?;
        check(
            carving.free_threshold > 0,
            "carving.free_threshold",
            &carving.free_threshold,
            "at least 1 is needed; with 0 everything would be free",
        )?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_are_within_range() {
        Options::default().validate().unwrap();
    }

    #[test]
    fn faults_name_the_key() {
        type Fault = fn(&mut Options);
        let faults: [(Fault, &str); 4] = [
            (|o| o.landmarks.lateral_px = -1.0, "landmarks.lateral_px"),
            (|o| o.carving.free_threshold = 0, "carving.free_threshold"),
            (
                |o| o.carving.ray_angle_deg = f64::NAN,
                "carving.ray_angle_deg",
            ),
            (|o| o.carving.cut.behind_sigmas = -1.0, "behind_sigmas"),
        ];
        for (fault, key) in faults {
            let mut options = Options::default();
            fault(&mut options);
            let message = options.validate().unwrap_err().to_string();
            assert!(message.contains(key), "{message}");
        }
    }
}
