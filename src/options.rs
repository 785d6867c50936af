//! The parameters of every stage. Users set the few of [`crate::configuration::Configuration`].

use linecarve_carving::CutOptionsError;
use linecarve_lines::ExtractOptions;
use linecarve_lines::cluster::ClusterOptions;
use linecarve_lines::depth::semi_dense::SemiDenseOptionsError;
use linecarve_lines::depth::{EdgeDepthOptions, SensorNoise};
use linecarve_lines::edges::EdgeOptions;
use linecarve_lines::fit::FitOptions;

use crate::front_end::SemiDenseStage;
use crate::map::{
    CutSettings, LabelKind, LandmarkOptions, PointModelOptions, SegmentPointOptions,
    SurfacePointOptions,
};
use linecarve_mesh::diff::Tolerance;
use linecarve_points::{MapPointOptions, PointOptionsError, PoseCorrectionOptions};
use linecarve_sequence::KeyframeOptions;

/// The parameters of every stage.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Which frames become keyframes.
    pub keyframes: KeyframeOptions,
    /// The images.
    pub images: ImageOptions,
    /// The depth camera.
    pub sensor: SensorOptions,
    /// Depth from neighbouring keyframes.
    pub semi_dense: SemiDenseStage,
    /// Edge chains.
    pub edges: EdgeOptions,
    /// The depth of edge pixels.
    pub edge_depth: EdgeDepthOptions,
    /// Segments along chains.
    pub fit: FitOptions,
    /// Clusters of segments.
    pub cluster: ClusterOptions,
    /// Points along segments.
    pub segment_points: SegmentPointOptions,
    /// Points between the segments.
    pub surface_points: SurfacePointOptions,
    /// Points that several keyframes see.
    pub landmarks: LandmarkOptions,
    /// Poses brought into agreement with images.
    pub pose_correction: PoseCorrectionOptions,
    /// Points from features.
    pub map_points: MapPointOptions,
    /// Points that a sequence brings along.
    pub point_model: PointModelOptions,
    /// Free space.
    pub carving: CarvingOptions,
    /// The surface that is written.
    pub surface: SurfaceOptions,
    /// Simplification of the final mesh.
    pub simplify: SimplifySettings,
}

/// The images.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ImageOptions {
    /// Larger images are computed on at a whole fraction of their size, where no side is longer than this; 0: as they are.
    /// Sequences with depth images are left alone.
    pub longest_side_px: u32,
}

impl ImageOptions {
    /// The longest side that an image may have.
    pub fn longest_side(&self) -> u32 {
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

/// The depth camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SensorOptions {
    /// Standard deviation of a depth at the scene's median depth, as a share of it. Inverse depth has the same deviation
    /// everywhere.
    pub relative_noise: f64,
}

impl Default for SensorOptions {
    fn default() -> Self {
        Self {
            relative_noise: SensorNoise::STRUCTURED_LIGHT_RELATIVE,
        }
    }
}

/// Free space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CarvingOptions {
    /// How tetrahedra are labelled.
    pub labels: LabelKind,
    /// With votes, a tetrahedron is free when at least this many rays cross it.
    pub free_threshold: u32,
    /// The weight of the triangle between a camera and a stretch of a segment that it sees, 0 for none: everything in it is
    /// free, not only what lies on the rays to points, which weigh 1, but for cells through which the stretch itself runs. With
    /// the cut it is so sure as the ends, all rays in it together have this weight, and what is behind the stretch is tied to
    /// matter as behind a point. The surface gains a little; a keyframe takes two to three times as long.
    pub segment_weight: u32,
    /// A point gets a ray from a camera only where the camera lies this far, as seen from the point, beside all the rays that
    /// the point has: a camera that stays in one place tells nothing new with each keyframe, and would make all rays dearer.
    /// In degrees; 0 for all rays.
    pub least_ray_angle_deg: f64,
    /// A stretch gets a triangle from a camera only where the camera lies this far, as seen from its ends, beside those that
    /// have triangles the same way there. In degrees; 0 for all triangles.
    pub least_segment_angle_deg: f64,
    /// Settings of the cut.
    pub cut: CutSettings,
}

impl Default for CarvingOptions {
    fn default() -> Self {
        Self {
            labels: LabelKind::default(),
            free_threshold: 1,
            segment_weight: 0,
            least_ray_angle_deg: 2.0,
            least_segment_angle_deg: 15.0,
            cut: CutSettings::default(),
        }
    }
}

/// The surface that is written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceOptions {
    /// Where depth is not dense, triangles with an edge longer than this share of the scene's median depth are left out:
    /// they span what no keyframe measured. Points of edges and corners lie far apart, so that shorter bounds cost more of the
    /// surface than they spare of what is none. `None` keeps all.
    pub longest_edge_share: Option<f64>,
    /// Where depth is dense, triangles are left out of which keyframes measured less than this share; 0 asks no keyframe.
    pub least_measured_share: f64,
    /// Connected pieces of fewer triangles are left out.
    pub minimum_component: usize,
    /// Whether facets on the convex hull of the map are kept.
    pub keep_hull: bool,
    /// Vertices and edges where more than one sheet of the surface meet are split, so that every edge has at most two
    /// triangles.
    pub manifold: bool,
}

impl Default for SurfaceOptions {
    fn default() -> Self {
        Self {
            longest_edge_share: Some(0.5),
            least_measured_share: 0.3,
            minimum_component: 8,
            keep_hull: false,
            manifold: true,
        }
    }
}

/// Simplification of the final mesh.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SimplifySettings {
    /// Largest distance between the mesh and the simplified mesh. `None`: the mesh is not simplified.
    pub tolerance: Option<Tolerance>,
    /// Largest distance by which boundary edges move within the surface. `None`: half the median length of the boundary
    /// edges, at most 20 tolerances.
    pub boundary_tolerance: Option<Tolerance>,
}

/// Why parameters are refused.
#[derive(Debug, thiserror::Error)]
pub enum OptionsError {
    /// A setting of the labels by minimum cut is out of range.
    #[error("carving.cut: {0}")]
    Cut(#[from] CutOptionsError),
    /// A value of the semi-dense depth is out of range.
    #[error(transparent)]
    SemiDense(#[from] SemiDenseOptionsError),
    /// A value is out of range.
    #[error("{key} = {value}: {expected}")]
    Range {
        /// Section and key.
        key: &'static str,
        /// What was given.
        value: String,
        /// What would do.
        expected: &'static str,
    },
    /// An option of the map points, or of the correction of poses, is out of range.
    #[error(transparent)]
    MapPoints(#[from] PointOptionsError),
}

impl Options {
    /// What the front end takes.
    pub fn extract(&self) -> ExtractOptions {
        ExtractOptions {
            edges: self.edges,
            edge_depth: self.edge_depth,
            fit: self.fit,
            samples: self
                .surface_points
                .enabled
                .then_some(self.surface_points.samples),
        }
    }

    /// Checks the ranges of what this module holds itself; the stages check their own when they start.
    ///
    /// # Errors
    /// The first value out of range.
    pub fn validate(&self) -> Result<(), OptionsError> {
        let positive = |key, value: f64| {
            if value.is_finite() && value > 0.0 {
                return Ok(());
            }
            Err(OptionsError::Range {
                key,
                value: value.to_string(),
                expected: "a positive, finite number is needed",
            })
        };
        positive("sensor.relative_noise", self.sensor.relative_noise)?;
        self.semi_dense.validate()?;
        positive("landmarks.lateral_px", self.landmarks.lateral_px)?;
        positive("landmarks.depth_sigmas", self.landmarks.depth_sigmas)?;
        positive(
            "surface_points.agreement_sigmas",
            self.surface_points.agreement_sigmas,
        )?;
        let sigmas = self.surface_points.correction_sigmas;
        if sigmas.is_nan() || sigmas <= 0.0 {
            return Err(OptionsError::Range {
                key: "surface_points.correction_sigmas",
                value: sigmas.to_string(),
                expected: "a positive number is needed, or inf for no corrections",
            });
        }
        positive("landmarks.settling_share", self.landmarks.settling_share)?;
        self.surface_points
            .samples
            .validate()
            .and_then(|()| self.surface_points.refine.validate())
            .map_err(|error| OptionsError::Range {
                key: error.key,
                value: error.value.to_string(),
                expected: error.expected,
            })?;
        if let Some(spacing) = self.segment_points.spacing_px {
            positive("segment_points.spacing_px", spacing)?;
        }
        if let Some(share) = self.surface.longest_edge_share {
            positive("surface.longest_edge_share", share)?;
        }
        let share = self.surface.least_measured_share;
        if !(0.0..=1.0).contains(&share) {
            return Err(OptionsError::Range {
                key: "surface.least_measured_share",
                value: share.to_string(),
                expected: "a share from 0 to 1 is needed",
            });
        }
        for (key, angle) in [
            (
                "carving.least_ray_angle_deg",
                self.carving.least_ray_angle_deg,
            ),
            (
                "carving.least_segment_angle_deg",
                self.carving.least_segment_angle_deg,
            ),
        ] {
            if !(0.0..=45.0).contains(&angle) {
                return Err(OptionsError::Range {
                    key,
                    value: angle.to_string(),
                    expected: "degrees from 0 to 45 are needed",
                });
            }
        }
        positive("carving.cut.sigma_factor", self.carving.cut.sigma_factor)?;
        self.carving.cut.options().validate()?;
        self.map_points.validate()?;
        self.pose_correction.validate()?;
        if self.carving.free_threshold == 0 {
            return Err(OptionsError::Range {
                key: "carving.free_threshold",
                value: "0".to_owned(),
                expected: "with 0 everything would be free; 1 or more is needed",
            });
        }
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
        let faults: [(fn(&mut Options), &str); 5] = [
            (|o| o.landmarks.lateral_px = -1.0, "landmarks.lateral_px"),
            (|o| o.carving.free_threshold = 0, "carving.free_threshold"),
            (
                |o| o.carving.least_ray_angle_deg = f64::NAN,
                "carving.least_ray_angle_deg",
            ),
            (
                |o| o.carving.least_segment_angle_deg = 46.0,
                "carving.least_segment_angle_deg",
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
