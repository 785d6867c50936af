//! A map of segments: clusters, landmarks along segments and between them, depth validation and vertex colours.

use std::time::Instant;

use linecarve_carving::VertexId;
use linecarve_carving::{Carver, TransactionError};
use linecarve_carving::{ExportOptions, SurfaceDelta, Triangle};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::SensorNoise;
use linecarve_mesh::TriangleMesh;
use nalgebra::Point3;

use super::depth_validation::{DepthValidation, FacetStatus};
use super::error::MapError;
use super::landmark_fusion::LandmarkFusion;
use super::provisional::{ProvisionalContext, ProvisionalKeyframes};
use super::segment_map::SegmentMap;
use super::segment_points::{edge_measurements, measurements};
use super::surface_points::KeyframeSurface;
use super::update::MapUpdate;
use super::vertex_landmarks::{VertexLandmarks, VertexViews};
use crate::front_end::LineKeyframe;
use crate::options::Options;

/// Colour of vertices without an observed colour: middle grey.
const DEFAULT_COLOR: [u8; 3] = [128; 3];

impl MapUpdate {
    /// Counts the landmarks that the current keyframe observes; those from index `known` on are new.
    fn count_points(&mut self, landmarks: &LandmarkFusion, known: usize) {
        let new_points = landmarks.points().len() - known;
        self.new_points += new_points;
        self.observed_again += landmarks.seen().len().saturating_sub(new_points);
    }
}

/// Segments, clusters, landmarks and depth validation.
pub(super) struct LineMap {
    camera: Camera,
    noise: SensorNoise,
    segments: SegmentMap,
    landmarks: LandmarkFusion,
    provisional: ProvisionalKeyframes,
    vertices: VertexLandmarks,
    validation: DepthValidation,
}

impl LineMap {
    /// An empty map; arguments as in [`Map::of_lines`](super::Map::of_lines).
    ///
    /// # Errors
    /// When an option is out of range.
    pub(super) fn new(
        options: &Options,
        camera: &Camera,
        noise: SensorNoise,
        median_depth: f64,
    ) -> Result<Self, MapError> {
        Ok(Self {
            camera: camera.clone(),
            noise,
            segments: SegmentMap::new(options.cluster, median_depth)?,
            landmarks: LandmarkFusion::new(options),
            provisional: ProvisionalKeyframes::default(),
            vertices: VertexLandmarks::default(),
            validation: DepthValidation::new(
                options.surface.least_measured_share,
                camera,
                &options.surface_points,
            ),
        })
    }

    /// Adds a provisional keyframe.
    ///
    /// # Errors
    /// When the carver rejects its position or one of its points.
    pub(super) fn push_provisional(
        &mut self,
        carver: &mut Carver,
        options: &Options,
        keyframe: &LineKeyframe,
    ) -> Result<MapUpdate, MapError> {
        let start = Instant::now();
        let rejected = |source| MapError::Keyframe {
            keyframe: keyframe.frame,
            source,
        };
        let context = ProvisionalContext {
            options,
            camera: &self.camera,
            noise: &self.noise,
            landmarks: self.landmarks.landmarks(),
            points: self.landmarks.points(),
        };
        let mut transaction = carver.transaction();
        self.provisional
            .add(keyframe, context, &mut transaction)
            .map_err(rejected)?;
        let report = transaction.commit().map_err(rejected)?;
        self.update_validation(carver, &report.surface);
        let mut update = MapUpdate::default();
        update.deltas.push(report.surface);
        update.times.carving = start.elapsed();
        Ok(update)
    }

    /// Removes all provisional keyframes; errors name keyframe `last`.
    ///
    /// # Errors
    /// As [`push_provisional`](Self::push_provisional).
    pub(super) fn remove_provisional(
        &mut self,
        carver: &mut Carver,
        last: usize,
    ) -> Result<(), MapError> {
        if self.provisional.is_empty() {
            return Ok(());
        }
        let rejected = |keyframe| move |source| MapError::Keyframe { keyframe, source };
        let mut transaction = carver.transaction();
        for frame in self.provisional.frames() {
            self.provisional
                .remove(frame, &mut transaction)
                .map_err(rejected(frame))?;
        }
        let report = transaction.commit().map_err(rejected(last))?;
        self.update_validation(carver, &report.surface);
        Ok(())
    }

    /// Updates depth validation after a commit without a new view.
    fn update_validation(&mut self, carver: &Carver, delta: &SurfaceDelta) {
        let views = VertexViews::new(carver, self.landmarks.points(), &self.vertices);
        self.validation.update(views, delta, &[]);
    }

    /// Number of segments of provisional keyframes.
    pub(super) fn provisional_segment_count(&self) -> usize {
        self.provisional.segment_count()
    }

    /// Segments and clusters.
    pub(super) fn segments(&self) -> &SegmentMap {
        &self.segments
    }

    /// Adds keyframe `number`.
    ///
    /// # Errors
    /// When the carver rejects its position or one of its points.
    pub(super) fn push(
        &mut self,
        carver: &mut Carver,
        options: &Options,
        keyframe: &LineKeyframe,
        number: usize,
    ) -> Result<MapUpdate, MapError> {
        let start = Instant::now();
        self.segments.push(keyframe);
        let mut update = MapUpdate::default();
        update.times.clustering = start.elapsed();
        self.add(carver, options, keyframe, &mut update)
            .map_err(|source| MapError::Keyframe {
                keyframe: number,
                source,
            })?;
        Ok(update)
    }

    fn add(
        &mut self,
        carver: &mut Carver,
        options: &Options,
        keyframe: &LineKeyframe,
        update: &mut MapUpdate,
    ) -> Result<(), TransactionError> {
        let start = Instant::now();
        let pose = &keyframe.world_from_camera;
        let center = Point3::from(pose.translation.vector);
        let landmarks = &mut self.landmarks;
        let mut transaction = carver.transaction();
        self.provisional.remove(keyframe.frame, &mut transaction)?;
        let view = transaction.add_view(center)?;
        let known = landmarks.points().len();
        landmarks.begin_keyframe();
        for segment in &keyframe.segments {
            let along = measurements(
                segment,
                &self.camera,
                pose,
                &self.noise,
                &options.segment_points,
            );
            landmarks.add_segment_points(&mut transaction, along)?;
        }
        let single = edge_measurements(&keyframe.edge_points, &self.camera, pose, &self.noise);
        landmarks.add_points(&mut transaction, single)?;
        let surface = KeyframeSurface::new(
            &keyframe.surface,
            &self.camera,
            pose,
            &options.surface_points,
        );
        if keyframe.surface.known_count() > 0 {
            landmarks.fuse_surface(&mut transaction, &surface, &options.surface_points)?;
        }
        landmarks.add_colors(keyframe, &surface);
        (update.moved_points, update.removed_points) =
            landmarks.update_landmarks(&mut transaction)?;
        landmarks.add_observations(&mut transaction, view, &center)?;
        landmarks.add_segment_observations(
            &mut transaction,
            view,
            &center,
            options.carving.segment_weight,
        )?;
        update.count_points(landmarks, known);
        update.times.matching = start.elapsed();
        let report = transaction.commit()?;
        let carved = start.elapsed();
        update.times.carving = carved - update.times.matching;

        let affected = landmarks.contradicted().iter().chain(landmarks.seen());
        self.vertices
            .update(carver, landmarks.points(), affected.copied());
        let conflicts = self.validation.push(
            VertexViews::new(carver, landmarks.points(), &self.vertices),
            &report.surface,
            landmarks.observed(),
            pose,
            &keyframe.surface,
        );
        update.deltas.push(report.surface);
        if !conflicts.is_empty() {
            // Measurements behind the carved surface become points.
            let known = landmarks.points().len();
            let mut transaction = carver.transaction();
            let measured = conflicts
                .iter()
                .filter_map(|pixel| surface.measurement_at(pixel));
            landmarks.add_corrections(&mut transaction, measured)?;
            landmarks.add_colors(keyframe, &surface);
            landmarks.add_observations(&mut transaction, view, &center)?;
            update.count_points(landmarks, known);
            let report = transaction.commit()?;
            self.vertices
                .update(carver, landmarks.points(), landmarks.seen().iter().copied());
            let views = VertexViews::new(carver, landmarks.points(), &self.vertices);
            self.validation
                .update(views, &report.surface, landmarks.observed());
            update.deltas.push(report.surface);
        }
        update.times.validation = start.elapsed() - carved;
        Ok(())
    }

    /// The surface without triangles that depth contradicts and, where depth is not dense, without those that have an edge
    /// longer than `options.longest_edge`.
    pub(super) fn surface(&self, carver: &Carver, options: &ExportOptions) -> TriangleMesh {
        let export = ExportOptions {
            longest_edge: None,
            ..*options
        };
        let is_exported = |triangle: Triangle| match self.validation.status(&triangle) {
            FacetStatus::Measured => true,
            FacetStatus::NotMeasured => false,
            FacetStatus::Unobserved => (options.longest_edge)
                .is_none_or(|longest| carver.has_edges_within(&triangle, longest)),
        };
        let (mesh, origins) = carver.mesh_where(&export, is_exported);
        TriangleMesh {
            positions: mesh.vertices,
            triangles: mesh.triangles,
            colors: self.colors(carver, &origins),
        }
    }

    /// Colours of the exported vertices, by their vertices in the triangulation; `None` when none has a colour.
    fn colors(&self, carver: &Carver, origins: &[Option<VertexId>]) -> Option<Vec<[u8; 3]>> {
        let provisional = self.provisional.colors(carver);
        let colors: Vec<Option<[u8; 3]>> = origins
            .iter()
            .map(|vertex| {
                let vertex = (*vertex)?;
                // Vertex ids are reused: this one may have belonged to a landmark.
                if let Some(color) = provisional.get(&vertex) {
                    return Some(*color);
                }
                let landmark = self.vertices.landmark(vertex)?;
                self.landmarks.landmarks().color(landmark)
            })
            .collect();
        let has_any = colors.iter().any(Option::is_some);
        has_any.then(|| {
            let color = |color: Option<[u8; 3]>| color.unwrap_or(DEFAULT_COLOR);
            colors.into_iter().map(color).collect()
        })
    }
}
