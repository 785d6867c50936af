//! Empty maps for each source of points.

use std::sync::Arc;

use linecarve_carving::{Carver, CarverOptions, Hull};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::SensorNoise;
use linecarve_sequence::{Sequence, SparseModel};
use nalgebra::Point3;

use super::contents::Contents;
use super::lines::LineMap;
use super::model::ModelMap;
use super::observed::ObservedMap;
use super::points::FeatureMap;
use super::segment_map::SegmentMap;
use super::{Map, MapError};
use crate::front_end::{SemiDenseSource, Source};
use crate::options::{LandmarkOptions, Options};

impl Map {
    /// A map that only clusters segments; `median_depth` is in units of the poses.
    ///
    /// # Errors
    /// When a clustering option is out of range.
    pub(crate) fn of_segments(options: &Options, median_depth: f64) -> Result<Self, MapError> {
        let segments = SegmentMap::new(options, median_depth)?;
        Ok(Self::new(
            options,
            Contents::Segments(Box::new(segments)),
            Some(median_depth),
        ))
    }

    /// An empty map of a source. A model is in it with the first keyframe.
    ///
    /// # Errors
    /// When an option is out of range, or an observation of a model names a view that does not exist.
    pub fn of_source(
        options: &Options,
        sequence: &Sequence,
        source: &Source,
    ) -> Result<Self, MapError> {
        let camera = sequence.color_camera();
        match source {
            Source::Sensor {
                sensor,
                median_depth,
            } => Self::of_sensor(options, camera, sensor.noise, *median_depth),
            Source::SemiDense(source) => Self::of_semi_dense(options, camera, source),
            Source::MapPoints { median_depth } => {
                Self::of_features(options, sequence, *median_depth)
            }
            Source::Model(model) => Self::of_model(options, Arc::clone(model)),
        }
    }

    /// An empty map of segments observed by `camera` with depth images; `median_depth` is in units of the poses.
    ///
    /// Depth images confirm or reject each triangle, those on the convex hull of all points too: a wall that is measured
    /// without error lies on it. When nothing is compared with them, nothing says that there is a surface on the hull, and none is exported.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn of_sensor(
        options: &Options,
        camera: &Camera,
        noise: SensorNoise,
        median_depth: f64,
    ) -> Result<Self, MapError> {
        let mut options = options.clone();
        let lines = LineMap::new(&options, camera, noise, median_depth, true)?;
        options.surface.keep_hull |= options.surface.least_measured_share > 0.0;
        let contents = Contents::Lines(Box::new(lines));
        let mut map = Self::new(&options, contents, Some(median_depth));
        map.has_depth_images = true;
        Ok(map)
    }

    /// An empty map of segments observed by `camera` with depth from neighbouring keyframes. There is no surface on the convex hull.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn of_semi_dense(
        options: &Options,
        camera: &Camera,
        source: &SemiDenseSource,
    ) -> Result<Self, MapError> {
        let mut options = options.clone();
        let (stage, median_depth) = (&source.options, source.median_depth);
        options.surface_points.refine.largest_gap_px = stage.largest_gap_px;
        if stage.is_dense {
            options.surface_points.agreement_sigmas = stage.agreement_sigmas;
            options.surface_points.refine.bound_sigmas = stage.refine_sigmas;
            options.landmarks = LandmarkOptions {
                lateral_px: stage.lateral_px,
                depth_sigmas: stage.agreement_sigmas,
                ..options.landmarks
            };
        } else {
            options.surface.least_measured_share = 0.0;
        }
        let lines = LineMap::new(&options, camera, source.noise(), median_depth, false)?;
        if stage.is_dense {
            let largest = stage.longest_edge_share;
            let longest = &mut options.surface.longest_edge_share;
            *longest = longest.map(|share| share.min(largest));
        }
        let contents = Contents::Lines(Box::new(lines));
        Ok(Self::new(&options, contents, Some(median_depth)))
    }

    /// An empty map of points triangulated from features of `sequence`. Without `median_depth` the length scale is that of
    /// the points.
    ///
    /// # Errors
    /// When an option is out of range.
    pub(crate) fn of_features(
        options: &Options,
        sequence: &Sequence,
        median_depth: Option<f64>,
    ) -> Result<Self, MapError> {
        let features = FeatureMap::new(options, sequence)?;
        Ok(Self::new(
            options,
            Contents::Features(Box::new(features)),
            median_depth,
        ))
    }

    /// A map of the points of a model, with the model's observations.
    ///
    /// # Errors
    /// When an observation names a view that does not exist.
    pub fn of_model(
        options: &Options,
        model: impl Into<Arc<SparseModel>>,
    ) -> Result<Self, MapError> {
        let model = ModelMap::new(model.into(), options)?;
        let median_depth = model.median_depth();
        let mut options = options.clone();
        // Which triangles on the hull are surface, points and views say.
        options.surface.keep_hull |= model.cloud().is_some();
        Ok(Self::new(
            &options,
            Contents::Model(Box::new(model)),
            median_depth,
        ))
    }

    /// An empty map of points that are added with [`add_points`](Self::add_points) and carved once; `centers` are those of all views.
    ///
    /// # Errors
    /// When the carver rejects a centre.
    pub(crate) fn of_points(
        options: &Options,
        centers: Vec<Point3<f64>>,
        median_depth: Option<f64>,
    ) -> Result<Self, MapError> {
        let mut carver = Carver::deferred(carver_options(options));
        let model = ModelMap::of_views(&mut carver, centers)?;
        let mut map = Self::new(options, Contents::Model(Box::new(model)), median_depth);
        map.carver = carver;
        Ok(map)
    }

    /// An empty map of points whose views and observations come with [`observe`](Self::observe). Without `median_depth` the length
    /// scale is that of the points.
    pub(crate) fn of_observations(options: &Options, median_depth: Option<f64>) -> Self {
        let observed = ObservedMap::new(&options.point_model, options.carving.cut.sigma_factor);
        Self::new(
            options,
            Contents::Observed(Box::new(observed)),
            median_depth,
        )
    }

    fn new(options: &Options, contents: Contents, median_depth: Option<f64>) -> Self {
        Self {
            carver: Carver::new(carver_options(options)),
            options: options.clone(),
            contents,
            median_depth,
            has_depth_images: false,
            leaves_carving: false,
            final_carving: None,
            surface: None,
            keyframes: 0,
        }
    }
}

/// The options of the carver.
pub(crate) fn carver_options(options: &Options) -> CarverOptions {
    let hull = match options.surface.keep_hull {
        true => Hull::Keep,
        false => Hull::Drop,
    };
    CarverOptions::new(options.carving.labels(), hull)
}
