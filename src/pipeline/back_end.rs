//! What a keyframe adds to the map: clusters, landmarks, free space, surface. Strictly one keyframe after another.

use std::time::{Duration, Instant};

use linecarve_carving::VertexId;
use linecarve_carving::{Carver, CarverOptions, TransactionError};
use linecarve_carving::{ExportOptions, Hull, SurfaceDelta, Triangle};
use linecarve_lines::camera::Camera;
use linecarve_lines::cluster::ClusterOptionsError;
use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;

use super::front_end::Keyframe;
use super::intake::Intake;
use super::options::Options;
use super::provisional::{ProvisionalKeyframes, ProvisionalSetting};
use super::segment_map::SegmentMap;
use super::segment_points::{edge_measurements, measurements};
use super::support::{Finding, Support};
use super::surface_points::KeyframeSurface;
use super::vertex_points::{Observers, VertexPoints};
use crate::mesh::TriangleMesh;

/// Colour of what no keyframe has a colour of: a middle grey.
const UNSEEN: [u8; 3] = [128; 3];

/// Why a keyframe could not be added. The map is then not to be used any further.
#[derive(Debug, thiserror::Error)]
pub enum BackEndError {
    /// A clustering option is out of range.
    #[error(transparent)]
    Cluster(#[from] ClusterOptionsError),
    /// The carver refuses a camera centre or a point.
    #[error("the map refuses keyframe {keyframe}: {source} (check its pose)")]
    Carve {
        /// Number of the keyframe.
        keyframe: usize,
        /// Why.
        source: TransactionError,
    },
}

/// What one keyframe did to the map.
#[derive(Debug, Clone, Copy, Default)]
pub struct MapUpdate {
    /// Points that are new.
    pub new_points: usize,
    /// Older points that were seen again.
    pub observed_again: usize,
    /// Points that moved to the mean of their measurements.
    pub moved_points: usize,
    /// Points that were given up, as more keyframes look through them than see them.
    pub removed_points: usize,
    /// Triangles that the surface gained and lost.
    pub changed_triangles: usize,
    /// Time for the clusters.
    pub clustering: Duration,
    /// Time for choosing points and matching them with older ones.
    pub matching: Duration,
    /// Time for inserting points, walking rays and bringing labels and surface up to date.
    pub carving: Duration,
    /// Time for finding out which triangles have been measured.
    pub support: Duration,
}

impl MapUpdate {
    /// Counts what the keyframe in hand sees, of which the landmarks from number `known` on are new.
    fn count_points(&mut self, intake: &Intake, known: usize) {
        let new_points = intake.points().len() - known;
        self.new_points += new_points;
        self.observed_again += intake.seen().len().saturating_sub(new_points);
    }

    fn count_triangles(&mut self, delta: &SurfaceDelta) {
        self.changed_triangles += delta.added.len() + delta.removed.len();
    }
}

/// The map: segments and clusters, landmarks, and the carved tetrahedralisation.
pub struct BackEnd {
    options: Options,
    camera: Camera,
    noise: SensorNoise,
    median_depth: f64,
    segments: SegmentMap,
    intake: Intake,
    carver: Carver,
    provisional: ProvisionalKeyframes,
    /// Number of keyframes that were added.
    keyframes: usize,
    vertices: VertexPoints,
    support: Support,
}

impl BackEnd {
    /// An empty map for keyframes of `camera`, whose depth has `noise`; `median_depth` is that of the scene in units of
    /// the poses.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(
        options: &Options,
        camera: &Camera,
        noise: SensorNoise,
        median_depth: f64,
    ) -> Result<Self, BackEndError> {
        Ok(Self {
            options: options.clone(),
            camera: camera.clone(),
            noise,
            median_depth,
            segments: SegmentMap::new(options.cluster, median_depth)?,
            intake: Intake::new(options),
            carver: Carver::new(CarverOptions {
                labels: options.carving.labels(),
                hull: if options.surface.keep_hull {
                    Hull::Keep
                } else {
                    Hull::Drop
                },
            }),
            provisional: ProvisionalKeyframes::default(),
            keyframes: 0,
            vertices: VertexPoints::default(),
            support: Support::new(
                options.surface.least_measured_share,
                camera,
                &options.surface_points,
            ),
        })
    }

    /// Puts in a keyframe whose depth will still be refined; [`push`](Self::push) of the same frame takes it away again and leaves
    /// the map as if it had never been there. Returns how long it took.
    ///
    /// # Errors
    /// When the carver refuses its position or one of its points: not a number, or out of range.
    pub fn push_provisional(&mut self, keyframe: &Keyframe) -> Result<Duration, BackEndError> {
        let start = Instant::now();
        let refused = |source| BackEndError::Carve {
            keyframe: keyframe.frame,
            source,
        };
        let setting = ProvisionalSetting {
            options: &self.options,
            camera: &self.camera,
            noise: &self.noise,
            landmarks: self.intake.landmarks(),
            points: self.intake.points(),
        };
        let mut transaction = self.carver.transaction();
        self.provisional
            .add(keyframe, setting, &mut transaction)
            .map_err(refused)?;
        let report = transaction.commit().map_err(refused)?;
        self.follow(&report.surface);
        Ok(start.elapsed())
    }

    /// Takes out all keyframes whose last depth has not come and will not.
    ///
    /// # Errors
    /// As [`push_provisional`](Self::push_provisional).
    pub fn withdraw_provisional(&mut self) -> Result<(), BackEndError> {
        if self.provisional.is_empty() {
            return Ok(());
        }
        let mut transaction = self.carver.transaction();
        for keyframe in self.provisional.frames() {
            self.provisional
                .withdraw(keyframe, &mut transaction)
                .map_err(|source| BackEndError::Carve { keyframe, source })?;
        }
        let report = transaction.commit().map_err(|source| BackEndError::Carve {
            keyframe: self.keyframes,
            source,
        })?;
        self.follow(&report.surface);
        Ok(())
    }

    /// Lets what is known about triangles follow a commit that brought no keyframe with dense depth.
    fn follow(&mut self, delta: &SurfaceDelta) {
        let observers = Observers::new(&self.carver, self.intake.points(), &self.vertices);
        self.support.follow(observers, delta, &[]);
    }

    /// How many segments the keyframes have whose depth will still be refined.
    pub fn provisional_segment_count(&self) -> usize {
        self.provisional.segment_count()
    }

    /// Adds a keyframe. Keyframes are numbered in the order in which they are added, from 0.
    ///
    /// # Errors
    /// When the carver refuses its position or one of its points: not a number, or out of range.
    pub fn push(&mut self, keyframe: &Keyframe) -> Result<MapUpdate, BackEndError> {
        let number = self.keyframes;
        let refused = |source| BackEndError::Carve {
            keyframe: number,
            source,
        };
        let start = Instant::now();
        self.segments.push(keyframe);
        let mut update = MapUpdate {
            clustering: start.elapsed(),
            ..MapUpdate::default()
        };
        self.intake.disregard(self.provisional.views());
        let mut transaction = self.carver.transaction();
        self.provisional
            .withdraw(keyframe.frame, &mut transaction)
            .map_err(refused)?;
        let center = Point3::from(keyframe.world_from_camera.translation.vector);
        let view = transaction.add_view(center).map_err(refused)?;
        let intake = &mut self.intake;
        let known = intake.points().len();
        intake.begin();
        for segment in &keyframe.segments {
            let along = measurements(
                segment,
                &self.camera,
                &keyframe.world_from_camera,
                &self.noise,
                &self.options.segment_points,
            );
            intake
                .take_segment(&mut transaction, along)
                .map_err(refused)?;
        }
        let single = edge_measurements(
            &keyframe.edge_points,
            &self.camera,
            &keyframe.world_from_camera,
            &self.noise,
        );
        intake
            .take_singly(&mut transaction, single)
            .map_err(refused)?;
        let options = &self.options.surface_points;
        let surface = KeyframeSurface::new(
            &keyframe.surface,
            &self.camera,
            &keyframe.world_from_camera,
            options,
        );
        if keyframe.surface.known_count() > 0 {
            intake
                .take_surface(&mut transaction, &surface, options)
                .map_err(refused)?;
        }
        intake.paint(keyframe, &surface);
        (update.moved_points, update.removed_points) =
            intake.settle(&mut transaction).map_err(refused)?;
        intake
            .observe(&mut transaction, view, &center)
            .map_err(refused)?;
        let carving = &self.options.carving;
        intake
            .observe_between(
                &mut transaction,
                view,
                &center,
                [carving.segment_weight, carving.triangulation_weight],
            )
            .map_err(refused)?;
        update.count_points(intake, known);
        update.matching = start.elapsed() - update.clustering;
        let report = transaction.commit().map_err(refused)?;
        update.count_triangles(&report.surface);
        update.carving = start.elapsed() - update.clustering - update.matching;

        let concerned = intake.contradicted().iter().chain(intake.seen());
        let (carver, points) = (&self.carver, intake.points());
        self.vertices.note(carver, points, concerned.copied());
        let contradictions = self.support.push(
            Observers::new(carver, points, &self.vertices),
            &report.surface,
            intake.observed(),
            &keyframe.world_from_camera,
            &keyframe.surface,
        );
        let halfway = intake.take_unjoined(&self.carver);
        if !(contradictions.is_empty() && halfway.is_empty()) {
            // What the keyframe measured behind the surface that was carved so far becomes points, and what is halfway along
            // segments that cells cross.
            let known = intake.points().len();
            let mut transaction = self.carver.transaction();
            let measured = contradictions
                .iter()
                .filter_map(|pixel| surface.measured_at(pixel));
            intake
                .take_points(&mut transaction, measured.chain(halfway))
                .map_err(refused)?;
            intake.paint(keyframe, &surface);
            intake
                .observe(&mut transaction, view, &center)
                .map_err(refused)?;
            update.count_points(intake, known);
            let report = transaction.commit().map_err(refused)?;
            update.count_triangles(&report.surface);
            let (carver, points) = (&self.carver, intake.points());
            self.vertices
                .note(carver, points, intake.seen().iter().copied());
            let observers = Observers::new(carver, points, &self.vertices);
            self.support
                .follow(observers, &report.surface, intake.observed());
        }
        update.support = start.elapsed() - update.clustering - update.matching - update.carving;
        self.keyframes += 1;
        Ok(update)
    }

    /// Segments and clusters.
    pub fn segments(&self) -> &SegmentMap {
        &self.segments
    }

    /// The carved tetrahedralisation.
    pub fn carver(&self) -> &Carver {
        &self.carver
    }

    /// The surface as it stands, without what the options leave out.
    pub fn surface(&self) -> TriangleMesh {
        let surface = &self.options.surface;
        let export = ExportOptions {
            longest_edge: None,
            minimum_component: surface.minimum_component,
            manifold: surface.manifold,
        };
        let longest = surface
            .longest_edge_share
            .map(|share| share * self.median_depth);
        let is_wanted = |triangle: Triangle| match self.support.of(&triangle) {
            Finding::Measured => true,
            Finding::NotMeasured => false,
            Finding::Unwitnessed => {
                longest.is_none_or(|longest| self.carver.has_edges_within(&triangle, longest))
            }
        };
        let (mesh, origins) = self.carver.mesh_where(&export, is_wanted);
        TriangleMesh {
            positions: mesh.vertices,
            triangles: mesh.triangles,
            colors: self.colors(&origins),
        }
    }

    /// Colours of copies of vertices; `None` when no keyframe had any.
    fn colors(&self, origins: &[Option<VertexId>]) -> Option<Vec<[u8; 3]>> {
        let provisional = self.provisional.colors(&self.carver);
        let colors: Vec<Option<[u8; 3]>> = origins
            .iter()
            .map(|vertex| {
                let vertex = (*vertex)?;
                // Its place in memory may have been that of a landmark before.
                if let Some(color) = provisional.get(&vertex) {
                    return Some(*color);
                }
                let landmark = self.vertices.landmark(vertex)?;
                self.intake.landmarks().color(landmark)
            })
            .collect();
        let has_any = colors.iter().any(Option::is_some);
        has_any.then(|| {
            let color = |color: Option<[u8; 3]>| color.unwrap_or(UNSEEN);
            colors.into_iter().map(color).collect()
        })
    }
}
