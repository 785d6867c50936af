//! The map: fuses keyframes and carves free space, strictly one keyframe after another.
//!
//! A [`Map`] is a carver and its source of points: landmarks along segments, points triangulated from features, or the points
//! of a sparse model. It takes [`Keyframe`]s and returns a [`MapUpdate`] for each.

mod carved;
pub(crate) mod cloud;
mod contents;
mod corrections;
mod depth_evidence;
mod depth_noise;
mod depth_validation;
mod error;
mod export;
mod keyframe_measurements;
mod landmark;
mod landmark_fusion;
mod landmarks;
mod large_nodes;
mod lines;
mod model;
mod observed;
mod points;
mod provisional;
mod ray_selection;
mod segment_map;
mod segment_points;
mod selection;
mod sources;
mod surface;
mod surface_points;
mod update;
mod vertex_adjustment;
mod vertex_fit;
mod vertex_landmarks;
mod view_region;

use std::time::{Duration, Instant};

use linecarve_carving::{Carver, Triangle, TriangleRole, VertexId};
use linecarve_points::PointMap;
use linecarve_sequence::SparseModel;
use nalgebra::{Isometry3, Point3};

use crate::front_end::Keyframe;
use crate::options::Options;
use cloud::{CloudSurface, CloudVertices, JoinedPoint};
use contents::Contents;
use lines::LineMap;

pub use carved::CarvedCounts;
pub use error::MapError;
pub(crate) use export::{close_all_holes, export_options};
pub(crate) use observed::{ObservationChange, ObservedPoint, PointKind};
pub use segment_map::SegmentMap;
pub use selection::ModelCounts;
pub(crate) use selection::{PointSelector, SelectedPoints, center_of};
pub(crate) use sources::carver_options;
use surface::CarvedVertices;
pub use surface::{MapSurface, SurfaceChange};
pub use update::{MapTimes, MapUpdate};

/// Segments, points and free space of the keyframes so far.
///
/// Coordinates are in the frame of computation: that of the poses minus the origin of the recording.
pub struct Map {
    options: Options,
    carver: Carver,
    contents: Contents,
    /// Median scene depth, where it does not come from feature points.
    median_depth: Option<f64>,
    /// Whether depth comes from depth images.
    has_depth_images: bool,
    /// Whether the carver stays as it is after the last keyframe, without cells.
    leaves_carving: bool,
    /// Time of carving after the last keyframe.
    final_carving: Option<Duration>,
    /// The exported surface, where it is followed.
    surface: Option<Box<MapSurface>>,
    /// Number of keyframes added.
    keyframes: usize,
}

impl Map {
    /// Carves an empty map once, in [`finish`](Self::finish), or with every [`push`](Self::push) of a model: the final surface is the same,
    /// sooner and in less memory. Until then there is no surface.
    pub(crate) fn defer_carving(&mut self) {
        if self.keyframes == 0 {
            self.carver = Carver::deferred(carver_options(&self.options));
        }
    }

    /// [Defers](Self::defer_carving) the carving of an empty map and leaves it to others, who take points, views and observations from the
    /// [carver](Self::carver) after [`finish`](Self::finish). Returns whether they can: not with depth images, which are evidence for cells, too.
    pub(crate) fn leave_carving(&mut self) -> bool {
        if !self.has_depth_images {
            self.defer_carving();
        }
        self.leaves_carving = self.carver.is_deferred();
        self.leaves_carving
    }

    /// Adds points with views to a map [of points](Self::of_points).
    ///
    /// # Errors
    /// When the carver rejects a point.
    pub(crate) fn add_points(&mut self, points: &[JoinedPoint]) -> Result<(), MapError> {
        match &mut self.contents {
            Contents::Model(model) => model.add(&mut self.carver, points),
            _ => Err(MapError::WrongKeyframe),
        }
    }

    /// Carves the points of a map [of points](Self::of_points) once and forgets their rays, to need less memory. With `is_closed` the surface
    /// is watertight.
    pub(crate) fn carve_last(&mut self, is_closed: bool) {
        if is_closed {
            self.options.surface.longest_edge_share = None;
            self.options.surface.manifold = true;
        }
        if let Contents::Model(model) = &mut self.contents {
            model.carve_last(&mut self.carver, is_closed);
        }
    }

    /// Adds a keyframe. Keyframes are numbered from 0 in the order of insertion.
    ///
    /// # Errors
    /// When the carver rejects its position or one of its points: not finite or out of range. The map must not be used
    /// afterwards.
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
        self.note(&update);
        Ok(update)
    }

    /// Adds a provisional keyframe, whose depth is still refined. [`push`](Self::push) of the same frame removes it without a
    /// trace. Only maps of lines have provisional keyframes.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn push_provisional(&mut self, keyframe: &Keyframe) -> Result<MapUpdate, MapError> {
        let Keyframe::Lines(keyframe) = keyframe else {
            return Err(MapError::WrongKeyframe);
        };
        let lines = self.contents.expect_lines()?;
        let update = lines.push_provisional(&mut self.carver, &self.options, keyframe)?;
        self.note(&update);
        Ok(update)
    }

    /// Finishes the map after the last keyframe: removes provisional keyframes, or adjusts all feature points and poses
    /// together; then carves, where that was deferred.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn finish(&mut self) -> Result<(), MapError> {
        let last = self.keyframes;
        let mut update = match &mut self.contents {
            Contents::Lines(lines) => {
                let frames = lines.provisional_frames();
                lines.remove_provisional(&mut self.carver, &frames, last)?
            }
            Contents::Features(features) => features.finish(&mut self.carver, last)?,
            Contents::Observed(observed) => {
                observed.measure_depth();
                MapUpdate::default()
            }
            Contents::Segments(_) | Contents::Model(_) => MapUpdate::default(),
        };
        if self.leaves_carving {
            return Ok(());
        }
        let is_carved = matches!(self.contents, Contents::Segments(_) | Contents::Model(_));
        if self.carver.is_deferred() && !is_carved {
            let start = Instant::now();
            update.deltas = vec![self.carver.carve().surface];
            if let Some(lines) = self.contents.lines_mut() {
                lines.finish_deferred(&self.carver, &mut update.recolored);
            }
            self.final_carving = Some(start.elapsed());
        }
        if let Some(lines) = self.contents.lines_mut() {
            lines.validate_anew(&self.carver, &mut update.revalidated);
            update.is_all_refitted = true;
        }
        self.note(&update);
        Ok(())
    }

    fn note(&mut self, update: &MapUpdate) {
        if let Some(surface) = &mut self.surface {
            surface.note(update);
        }
    }

    /// Keeps the exported surface up to date from now on, for [`take_surface_change`](Self::take_surface_change).
    pub(crate) fn follow_surface(&mut self) {
        if self.surface.is_none() {
            self.surface = Some(Box::new(self.new_surface()));
        }
    }

    /// An exported surface that has not followed anything yet.
    fn new_surface(&self) -> MapSurface {
        MapSurface::new(&self.carver, &self.export_options(), self.is_fitted())
    }

    /// Whether vertices of the surface lie elsewhere than they are carved.
    fn is_fitted(&self) -> bool {
        self.contents.lines().is_some() || self.cloud().is_some()
    }

    /// Brings the followed surface up to date, and returns its change since the last call; `None` when it is not followed.
    ///
    /// # Complexity
    /// That of the change.
    pub(crate) fn take_surface_change(&mut self) -> Option<SurfaceChange> {
        let mut surface = self.surface.take()?;
        let change = self.update_surface(&mut surface);
        self.surface = Some(surface);
        Some(change)
    }

    /// Brings a surface of this map up to date.
    fn update_surface(&self, surface: &mut MapSurface) -> SurfaceChange {
        let longest = self.export_options().longest_edge;
        let role = |triangle: &Triangle| self.role(triangle, longest);
        match (self.contents.lines(), self.cloud()) {
            (Some(lines), _) => {
                let vertices = lines.fitted_vertices(&self.carver);
                surface.update(&self.carver, longest, role, &vertices)
            }
            (None, Some(cloud)) => {
                let vertices = self.cloud_vertices(cloud);
                surface.update(&self.carver, longest, role, &vertices)
            }
            (None, None) => {
                surface.update(&self.carver, longest, role, &CarvedVertices(&self.carver))
            }
        }
    }

    /// What is known of the points of a dense cloud; `None` for other maps.
    pub(crate) fn cloud(&self) -> Option<&CloudSurface> {
        self.contents.model()?.cloud()
    }

    fn cloud_vertices<'a>(
        &'a self,
        surface: &'a CloudSurface,
    ) -> CloudVertices<'a, impl Fn(VertexId) -> Point3<f64> + Sync + 'a> {
        let position = |vertex| self.carver.tetrahedra().position(vertex);
        CloudVertices { surface, position }
    }

    /// The followed surface as of its last change.
    pub fn followed_surface(&self) -> Option<&MapSurface> {
        self.surface.as_deref()
    }

    /// How a triangle of the carved surface is exported.
    fn role(&self, triangle: &Triangle, longest: Option<f64>) -> TriangleRole {
        if let Some(lines) = self.contents.lines() {
            return lines.role(&self.carver, triangle, longest);
        }
        let is_short =
            longest.is_none_or(|longest| self.carver.has_edges_within(triangle, longest));
        let tetrahedra = self.carver.tetrahedra();
        let corners = || triangle.map(|vertex| tetrahedra.position(vertex));
        match self.cloud() {
            Some(cloud) if is_short && cloud.supports(corners()) => TriangleRole::Exported,
            Some(_) => TriangleRole::Counted,
            None if is_short => TriangleRole::Exported,
            None => TriangleRole::Ignored,
        }
    }

    /// Time of carving after the last keyframe, where it was deferred.
    pub fn final_carving(&self) -> Option<Duration> {
        self.final_carving
    }

    /// The carved tetrahedralisation.
    pub fn carver(&self) -> &Carver {
        &self.carver
    }

    /// Segments and clusters; `None` for maps of points.
    pub fn segments(&self) -> Option<&SegmentMap> {
        match &self.contents {
            Contents::Segments(segments) => Some(segments),
            Contents::Lines(lines) => Some(lines.segments()),
            Contents::Features(_) | Contents::Model(_) | Contents::Observed(_) => None,
        }
    }

    /// Number of segments of provisional keyframes.
    pub fn provisional_segment_count(&self) -> usize {
        let lines = self.contents.lines();
        lines.map_or(0, LineMap::provisional_segment_count)
    }

    /// The feature points; `None` for other maps.
    pub fn feature_points(&self) -> Option<&PointMap> {
        Some(self.contents.features()?.points())
    }

    /// The model in the frame of computation and its point counts; `None` for other maps.
    pub fn model(&self) -> Option<(&SparseModel, ModelCounts)> {
        let model = self.contents.model()?;
        Some((model.model(), model.counts()))
    }

    /// Positions and colours of the model's points carved so far, those of dense clouds joined; `None` for other maps.
    pub fn carved_points(&self) -> Option<impl Iterator<Item = (Point3<f64>, Option<[u8; 3]>)>> {
        Some(self.contents.model()?.carved())
    }

    /// The view of the model with the most carved points, the first of equals.
    pub fn richest_view(&self) -> Option<usize> {
        self.contents.model()?.richest_view()
    }

    /// Poses adjusted by the feature map, in the order of keyframes; `None` for other maps.
    pub fn adjusted_poses(&self) -> Option<Vec<Isometry3<f64>>> {
        let points = self.feature_points()?;
        let keyframes = points.keyframes().iter();
        Some(
            keyframes
                .map(|keyframe| *keyframe.pose.world_from_camera())
                .collect(),
        )
    }

    /// Median scene depth in units of the poses; `None` without points.
    pub fn median_depth(&self) -> Option<f64> {
        let of_points = || match &self.contents {
            Contents::Observed(observed) => observed.median_depth(),
            _ => self.feature_points()?.median_depth(),
        };
        self.median_depth.or_else(of_points)
    }

    /// Positions of the carved points, in the order of their ids.
    pub fn points(&self) -> Vec<Point3<f64>> {
        let points = self.carver.points();
        points
            .filter_map(|point| self.carver.point(point))
            .collect()
    }
}
