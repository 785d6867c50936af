//! The map: what keyframes measured, joined and carved. Strictly one keyframe after another.
//!
//! A [`Map`] is one carver and what feeds it: landmarks along segments, map points triangulated from features, or the points
//! of a model. All of them take [`Keyframe`]s and answer with a [`MapUpdate`].

mod depth_validation;
mod error;
mod labels;
mod landmark_fusion;
mod landmarks;
mod lines;
mod model;
mod nearly_parallel;
mod points;
mod provisional;
mod segment_map;
mod segment_points;
mod surface_points;
mod update;
mod vertex_landmarks;

use std::time::Instant;

use linecarve_carving::carver::{Carver, CarverOptions};
use linecarve_carving::surface::{ExportOptions, Hull};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::SensorNoise;
use linecarve_mesh::TriangleMesh;
use linecarve_points::PointMap;
use linecarve_sequence::{Sequence, SparseModel};
use nalgebra::{Isometry3, Point3};

use crate::front_end::Keyframe;
use crate::options::Options;
use lines::LineMap;
use model::ModelMap;
use points::FeatureMap;

pub use error::MapError;
pub use labels::{CutSettings, LabelKind};
pub use landmarks::{LandmarkOptions, Measurement};
pub use model::{ModelCounts, PointModelOptions};
pub use segment_map::SegmentMap;
pub use segment_points::{SegmentPointOptions, measurements};
pub use surface_points::SurfacePointOptions;
pub use update::{FeatureCounts, MapTimes, MapUpdate};

/// Segments, points and free space of the keyframes so far.
///
/// All coordinates are in the frame of computation: that of the poses less the origin of the recording.
pub struct Map {
    options: Options,
    carver: Carver,
    contents: Contents,
    /// Median scene depth where something other than the map's own points tells it.
    median_depth: Option<f64>,
    /// Number of keyframes that were added.
    keyframes: usize,
}

/// What feeds the carver.
enum Contents {
    /// Segments alone; nothing is carved.
    Segments(SegmentMap),
    Lines(Box<LineMap>),
    Features(Box<FeatureMap>),
    Model(ModelMap),
}

impl Map {
    /// A map that only joins segments to clusters; `median_depth` is in units of the poses.
    ///
    /// # Errors
    /// When a clustering option is out of range.
    pub fn of_segments(options: &Options, median_depth: f64) -> Result<Self, MapError> {
        let segments = SegmentMap::new(options.cluster, median_depth)?;
        Ok(Self::new(
            options,
            Contents::Segments(segments),
            Some(median_depth),
        ))
    }

    /// An empty map of segments seen by `camera`, whose depth has `noise`; `median_depth` is in units of the poses.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn of_lines(
        options: &Options,
        camera: &Camera,
        noise: SensorNoise,
        median_depth: f64,
    ) -> Result<Self, MapError> {
        let lines = LineMap::new(options, camera, noise, median_depth)?;
        Ok(Self::new(
            options,
            Contents::Lines(Box::new(lines)),
            Some(median_depth),
        ))
    }

    /// An empty map of points triangulated from features of `sequence`. Without `median_depth` the length scale is that of the
    /// points.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn of_features(
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

    /// A map of the points of a model, which come with the views that see them.
    ///
    /// # Errors
    /// When the model names a view that it does not have.
    pub fn of_model(options: &Options, model: SparseModel) -> Result<Self, MapError> {
        let model = ModelMap::new(model, &options.point_model)?;
        let median_depth = model.median_depth();
        Ok(Self::new(options, Contents::Model(model), median_depth))
    }

    fn new(options: &Options, contents: Contents, median_depth: Option<f64>) -> Self {
        Self {
            carver: Carver::new(CarverOptions {
                labels: options.carving.labels(),
                hull: if options.surface.keep_hull {
                    Hull::Keep
                } else {
                    Hull::Drop
                },
            }),
            options: options.clone(),
            contents,
            median_depth,
            keyframes: 0,
        }
    }

    /// Adds a keyframe. Keyframes are numbered in the order in which they are added, from 0.
    ///
    /// # Errors
    /// When the carver refuses its position or one of its points: not a number, or out of range. The map is then not to be
    /// used any further.
    pub fn push(&mut self, keyframe: &Keyframe) -> Result<MapUpdate, MapError> {
        let carver = &mut self.carver;
        let number = self.keyframes;
        let mut update = match (&mut self.contents, keyframe) {
            (Contents::Segments(segments), Keyframe::Lines(keyframe)) => {
                let start = Instant::now();
                segments.push(keyframe);
                MapUpdate {
                    times: MapTimes {
                        clustering: start.elapsed(),
                        ..MapTimes::default()
                    },
                    ..MapUpdate::default()
                }
            }
            (Contents::Lines(lines), Keyframe::Lines(keyframe)) => {
                lines.push(carver, &self.options, keyframe, number)?
            }
            (Contents::Features(features), Keyframe::Features(keyframe)) => {
                features.push(carver, keyframe, number)?
            }
            (Contents::Model(model), Keyframe::Views(views)) => {
                model.push(carver, views.clone())?
            }
            _ => return Err(MapError::WrongKeyframe),
        };
        update.clusters = self.segments().map_or(0, SegmentMap::cluster_count);
        self.keyframes += 1;
        Ok(update)
    }

    /// Adds a keyframe whose depth will still be refined. [`push`](Self::push) of the same frame removes it again and leaves
    /// the map as if it had never been there. Maps of features and models have no such keyframes.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn push_provisional(&mut self, keyframe: &Keyframe) -> Result<MapUpdate, MapError> {
        match (&mut self.contents, keyframe) {
            (Contents::Lines(lines), Keyframe::Lines(keyframe)) => {
                lines.push_provisional(&mut self.carver, &self.options, keyframe)
            }
            _ => Err(MapError::WrongKeyframe),
        }
    }

    /// Ends the map after the last keyframe: removes keyframes whose final depth will not come; points from features and
    /// their poses are adjusted all together.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn finish(&mut self) -> Result<(), MapError> {
        let last = self.keyframes;
        match &mut self.contents {
            Contents::Lines(lines) => lines.remove_provisional(&mut self.carver, last),
            Contents::Features(features) => features.finish(&mut self.carver, last),
            Contents::Segments(_) | Contents::Model(_) => Ok(()),
        }
    }

    /// The carved tetrahedralisation.
    pub fn carver(&self) -> &Carver {
        &self.carver
    }

    /// Segments and clusters; `None` when the map is made of points.
    pub fn segments(&self) -> Option<&SegmentMap> {
        match &self.contents {
            Contents::Segments(segments) => Some(segments),
            Contents::Lines(lines) => Some(lines.segments()),
            Contents::Features(_) | Contents::Model(_) => None,
        }
    }

    /// Number of segments of keyframes whose depth will still be refined.
    pub fn provisional_segment_count(&self) -> usize {
        match &self.contents {
            Contents::Lines(lines) => lines.provisional_segment_count(),
            _ => 0,
        }
    }

    /// The points triangulated from features, when the map is made of them.
    pub fn feature_points(&self) -> Option<&PointMap> {
        match &self.contents {
            Contents::Features(features) => Some(features.points()),
            _ => None,
        }
    }

    /// The model in the frame of computation and what became of its points, when the map is made of one.
    pub fn model(&self) -> Option<(&SparseModel, ModelCounts)> {
        match &self.contents {
            Contents::Model(model) => Some((model.model(), model.counts())),
            _ => None,
        }
    }

    /// The points of the model that are carved so far, when the map is made of one.
    pub fn carved_model(&self) -> Option<SparseModel> {
        match &self.contents {
            Contents::Model(model) => Some(model.carved()),
            _ => None,
        }
    }

    /// The view of the model that sees most of the carved points, of equals the first.
    pub fn richest_view(&self) -> Option<usize> {
        match &self.contents {
            Contents::Model(model) => model.richest_view(),
            _ => None,
        }
    }

    /// Poses as the images correct them while the map grows, in the order of keyframes; `None` where the map takes poses as
    /// they are.
    pub fn adjusted_poses(&self) -> Option<Vec<Isometry3<f64>>> {
        let points = self.feature_points()?;
        let keyframes = points.keyframes().iter();
        Some(
            keyframes
                .map(|keyframe| *keyframe.pose.world_from_camera())
                .collect(),
        )
    }

    /// Median scene depth in units of the poses; `None` without any point.
    pub fn median_depth(&self) -> Option<f64> {
        self.median_depth
            .or_else(|| self.feature_points()?.median_depth())
    }

    /// Positions of the carved points, in the order of their ids.
    pub fn points(&self) -> Vec<Point3<f64>> {
        let points = self.carver.points();
        points
            .filter_map(|point| self.carver.point(point))
            .collect()
    }

    /// The surface as it stands, without what `options.surface` leaves out.
    ///
    /// # Complexity
    /// Linear in the size of the surface, and sorting of its vertices.
    pub fn surface(&self) -> TriangleMesh {
        let surface = &self.options.surface;
        let longest_edge = self
            .median_depth()
            .zip(surface.longest_edge_share)
            .map(|(depth, share)| share * depth);
        let export = ExportOptions {
            longest_edge,
            minimum_component: surface.minimum_component,
            manifold: surface.manifold,
        };
        if let Contents::Lines(lines) = &self.contents {
            return lines.surface(&self.carver, &export);
        }
        let mesh = self.carver.mesh(&export);
        TriangleMesh {
            positions: mesh.vertices,
            triangles: mesh.triangles,
            colors: None,
        }
    }
}
