//! A map of segments: clusters, landmarks along segments and between them, depth validation and vertex colours.

mod correct;
mod merged;

use std::time::Instant;

use linecarve_carving::{Carver, TransactionError, VertexId, ViewId};
use linecarve_carving::{SurfaceDelta, Triangle, TriangleRole};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::depth_evidence::{Change, DepthEvidence};
use super::depth_noise::DepthNoise;
use super::depth_validation::{DepthValidation, FacetStatus};
use super::error::MapError;
use super::landmark_fusion::LandmarkFusion;
use super::provisional::{ProvisionalContext, ProvisionalKeyframes};
use super::segment_map::SegmentMap;
use super::segment_points::{edge_measurements, measurements};
use super::surface_points::KeyframeSurface;
use super::update::MapUpdate;
use super::vertex_fit::FittedVertices;
use super::vertex_landmarks::{CarvedSurface, VertexLandmarks, VertexViews};
use crate::front_end::LineKeyframe;
use crate::options::Options;

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
    noise: DepthNoise,
    segments: SegmentMap,
    landmarks: LandmarkFusion,
    /// The view of each keyframe.
    views: Vec<ViewId>,
    provisional: ProvisionalKeyframes,
    vertices: VertexLandmarks,
    validation: DepthValidation,
    /// Whether depth comes from depth images.
    is_measured: bool,
    /// Whether triangles are left out that no keyframe with dense depth observes.
    needs_depth: bool,
    /// How far vertices on edges and boundaries move onto segments.
    segment_reach: f64,
    /// Depth as evidence for free and occupied cells, where it comes from depth images.
    evidence: Option<DepthEvidence>,
}

impl LineMap {
    /// An empty map; arguments as in [`Map::of_sensor`](super::Map::of_sensor).
    ///
    /// # Errors
    /// When an option is out of range.
    pub(super) fn new(
        options: &Options,
        camera: &Camera,
        noise: SensorNoise,
        median_depth: f64,
        is_measured: bool,
    ) -> Result<Self, MapError> {
        let samples = &options.surface_points.samples;
        // The spacing of the samples that are kept of a keyframe, at the median scene depth.
        let spacing_px = f64::from(2 * samples.step_px);
        // A window across an edge may have its sample a radius away, and the next sample is up to half a step further.
        let reach_px = f64::from(samples.window_radius_px) + 0.5 * f64::from(samples.step_px);
        let pixel = median_depth / camera.mean_focal_px();
        let spacing = spacing_px * pixel;
        let evidence = DepthEvidence::new(spacing);
        Ok(Self {
            camera: camera.clone(),
            noise: DepthNoise::new(noise),
            segments: SegmentMap::new(options, median_depth)?,
            landmarks: LandmarkFusion::new(options),
            views: Vec::new(),
            provisional: ProvisionalKeyframes::default(),
            vertices: VertexLandmarks::default(),
            validation: DepthValidation::new(
                options.surface.least_measured_share,
                spacing,
                camera,
                &options.surface_points,
            ),
            evidence: (is_measured && options.surface_points.enabled).then_some(evidence),
            is_measured,
            needs_depth: is_measured
                && options.surface_points.enabled
                && options.surface.least_measured_share > 0.0,
            segment_reach: reach_px * pixel,
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
        let mut update = MapUpdate::default();
        let replaced = self.provisional.vertices(carver, keyframe.frame);
        update.recolored.extend(replaced);
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
        let added = self.provisional.vertices(carver, keyframe.frame);
        update.recolored.extend(added);
        self.update_validation(carver, report.surface, &mut update);
        update.times.carving = start.elapsed();
        Ok(update)
    }

    /// Frames of the provisional keyframes, ascending.
    pub(super) fn provisional_frames(&self) -> Vec<usize> {
        self.provisional.frames()
    }

    /// Removes the provisional keyframes of these frames; errors of the whole name keyframe `last`.
    ///
    /// # Errors
    /// As [`push_provisional`](Self::push_provisional).
    pub(super) fn remove_provisional(
        &mut self,
        carver: &mut Carver,
        frames: &[usize],
        last: usize,
    ) -> Result<MapUpdate, MapError> {
        let mut update = MapUpdate::default();
        if frames.is_empty() {
            return Ok(update);
        }
        let rejected = |keyframe| move |source| MapError::Keyframe { keyframe, source };
        let mut transaction = carver.transaction();
        for &frame in frames {
            let vertices = self.provisional.vertices(transaction.before(), frame);
            update.recolored.extend(vertices);
            self.provisional
                .remove(frame, &mut transaction)
                .map_err(rejected(frame))?;
        }
        let report = transaction.commit().map_err(rejected(last))?;
        self.update_validation(carver, report.surface, &mut update);
        Ok(update)
    }

    /// Makes up for what had to wait until a deferred carver has carved. Appends the vertices that have a colour now.
    pub(super) fn finish_deferred(&mut self, carver: &Carver, recolored: &mut Vec<VertexId>) {
        self.vertices
            .update_postponed(carver, self.landmarks.points(), recolored);
    }

    /// Compares all triangles with the depth of all keyframes. Appends those whose status may have changed.
    pub(super) fn validate_anew(&mut self, carver: &Carver, revalidated: &mut Vec<Triangle>) {
        let views = VertexViews::new(carver, self.landmarks.points(), &self.vertices);
        self.validation.validate_anew(views);
        revalidated.extend(self.validation.take_changed());
    }

    /// Updates depth validation after a commit without a new view.
    fn update_validation(&mut self, carver: &Carver, delta: SurfaceDelta, update: &mut MapUpdate) {
        let views = VertexViews::new(carver, self.landmarks.points(), &self.vertices);
        self.validation.update(views, &delta, &[]);
        update.revalidated.extend(self.validation.take_changed());
        update.deltas.push(delta);
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
        let added = self.add(carver, options, keyframe, &mut update);
        added.map_err(|source| MapError::Keyframe {
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
        let replaced = self.provisional.vertices(carver, keyframe.frame);
        update.recolored.extend(replaced);
        let mut transaction = carver.transaction();
        self.provisional.remove(keyframe.frame, &mut transaction)?;
        let view = transaction.add_view(center)?;
        self.views.push(view);
        let known = landmarks.points().len();
        landmarks.begin_keyframe(pose);
        let (noise, validation) = (&mut self.noise, &mut self.validation);
        let surface = observed_surface(keyframe, &self.camera, options, noise, validation);
        for segment in &keyframe.segments {
            let along = measurements(
                segment,
                &self.camera,
                pose,
                &self.noise,
                &options.segment_points,
            );
            landmarks.add_points(&mut transaction, along)?;
        }
        let single = edge_measurements(&keyframe.edge_points, &self.camera, pose, &self.noise);
        landmarks.add_points(&mut transaction, single)?;
        if keyframe.surface.known_count() > 0 {
            landmarks.fuse_surface(&mut transaction, &surface, &options.surface_points)?;
        }
        landmarks.add_colors(keyframe, &surface);
        (update.moved_points, update.removed_points) =
            landmarks.update_landmarks(&mut transaction)?;
        landmarks.add_observations(&mut transaction, view, &center)?;
        update.count_points(landmarks, known);
        self.validation.add_view(view, pose, &keyframe.surface);
        if let (Some(evidence), Some(surface)) =
            (&mut self.evidence, self.validation.surface_of(view))
        {
            evidence.change(&mut transaction, &surface, Change::Add)?;
        }
        update.times.matching = start.elapsed();
        let report = transaction.commit()?;
        let carved = start.elapsed();
        update.times.carving = carved - update.times.matching;

        let affected = landmarks.contradicted().iter().chain(landmarks.seen());
        if carver.is_deferred() {
            self.vertices.postpone(affected.copied());
            return Ok(());
        }
        let recolored = &mut update.recolored;
        let (points, affected) = (landmarks.points(), affected.copied());
        self.vertices.update(carver, points, affected, recolored);
        let views = VertexViews::new(carver, landmarks.points(), &self.vertices);
        self.validation
            .update(views, &report.surface, landmarks.observed());
        let looked_up = landmarks.looked_up();
        (update.in_view).extend(looked_up.filter_map(|landmark| views.vertex(landmark)));
        update.deltas.push(report.surface);
        update.revalidated.extend(self.validation.take_changed());
        update.times.validation = start.elapsed() - carved;
        Ok(())
    }

    /// How a triangle is exported: not when depth contradicts it. Where no keyframe has dense depth, it is left out if there are depth images, else
    /// if an edge is longer than `longest`.
    pub(super) fn role(
        &self,
        surface: &dyn CarvedSurface,
        triangle: &Triangle,
        longest: Option<f64>,
    ) -> TriangleRole {
        let is_exported = match self.validation.status(triangle) {
            FacetStatus::Measured => true,
            FacetStatus::PartlyMeasured(part) => return TriangleRole::Part(part),
            FacetStatus::NotMeasured => false,
            FacetStatus::Unobserved => {
                !self.needs_depth
                    && longest.is_none_or(|longest| surface.has_edges_within(triangle, longest))
            }
        };
        match is_exported {
            true => TriangleRole::Exported,
            false => TriangleRole::Counted,
        }
    }

    /// Where the vertices of the surface lie, and their colours.
    pub(super) fn fitted_vertices<'a>(&'a self, carver: &'a Carver) -> FittedVertices<'a> {
        self.vertices_with(self.colors(carver))
    }

    fn vertices_with<'a>(&'a self, colors: VertexColors<'a>) -> FittedVertices<'a> {
        FittedVertices {
            colors,
            validation: &self.validation,
            is_measured: self.is_measured,
            segments: &self.segments,
            segment_reach: self.segment_reach,
        }
    }

    /// The colours of vertices.
    pub(super) fn colors<'a>(&'a self, carver: &'a Carver) -> VertexColors<'a> {
        VertexColors {
            surface: carver,
            provisional: self.provisional.colors(carver),
            vertices: &self.vertices,
            landmarks: &self.landmarks,
        }
    }
}

/// The surface of a keyframe. What it disagrees about with earlier ones is noted, and holds for it already.
fn observed_surface<'a>(
    keyframe: &'a LineKeyframe,
    camera: &'a Camera,
    options: &Options,
    noise: &mut DepthNoise,
    validation: &mut DepthValidation,
) -> KeyframeSurface<'a> {
    let mut surface = KeyframeSurface::new(
        &keyframe.surface,
        camera,
        &keyframe.world_from_camera,
        &options.surface_points,
        noise.disagreement(),
    );
    if keyframe.surface.known_count() > 0 {
        noise.observe(&surface, validation.in_view_of(&surface));
        surface.set_disagreement(noise.disagreement());
        validation.set_disagreement(noise.disagreement());
    }
    surface
}

/// The colours of the vertices of the triangulation.
pub(super) struct VertexColors<'a> {
    surface: &'a dyn CarvedSurface,
    provisional: FxHashMap<VertexId, [u8; 3]>,
    vertices: &'a VertexLandmarks,
    landmarks: &'a LandmarkFusion,
}

impl VertexColors<'_> {
    /// The colour of a vertex, when one was observed.
    pub(super) fn get(&self, vertex: VertexId) -> Option<[u8; 3]> {
        if let Some(color) = self.provisional.get(&vertex) {
            return Some(*color);
        }
        self.landmarks.landmarks().color(self.landmark(vertex)?)
    }

    /// Where a vertex was carved.
    pub(super) fn position(&self, vertex: VertexId) -> Point3<f64> {
        self.surface.position(vertex)
    }

    /// The landmark at a vertex.
    pub(super) fn landmark(&self, vertex: VertexId) -> Option<u32> {
        let landmark = self.vertices.landmark(vertex)?;
        // Vertex ids are reused: this one may have belonged to a landmark.
        let point = self.landmarks.points()[landmark as usize];
        (self.surface.vertex_of(point) == Some(vertex)).then_some(landmark)
    }
}
