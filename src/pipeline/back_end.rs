//! What a keyframe adds to the map: clusters, landmarks, free space, surface. Strictly one keyframe after another.

use std::time::{Duration, Instant};

use linecarve_carving::carver::{Carver, CarverOptions, EventError, PointId, ViewId};
use linecarve_carving::surface::{ExportOptions, Hull, Triangle};
use linecarve_carving::tetrahedralization::VertexId;
use linecarve_lines::camera::Camera;
use linecarve_lines::cluster::ClusterOptionsError;
use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;

use super::front_end::Keyframe;
use super::intake::{Intake, IntakeScratch, settle};
use super::landmarks::{Landmarks, Measurement};
use super::options::Options;
use super::segment_map::SegmentMap;
use super::segment_points::measurements;
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
        source: EventError,
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

/// The map: segments and clusters, landmarks, and the carved tetrahedralisation.
pub struct BackEnd {
    options: Options,
    camera: Camera,
    noise: SensorNoise,
    median_depth: f64,
    segments: SegmentMap,
    landmarks: Landmarks,
    /// The carver's id of each landmark.
    points: Vec<PointId>,
    carver: Carver,
    scratch: IntakeScratch,
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
            landmarks: Landmarks::new(options.landmarks),
            points: Vec::new(),
            carver: Carver::new(CarverOptions {
                labels: options.carving.labels(),
                hull: if options.surface.keep_hull {
                    Hull::Keep
                } else {
                    Hull::Drop
                },
            }),
            scratch: IntakeScratch::default(),
            keyframes: 0,
            vertices: VertexPoints::default(),
            support: Support::new(
                options.surface.least_measured_share,
                camera,
                &options.surface_points,
            ),
        })
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
        let camera = self.camera.clone();
        let mut transaction = self.carver.transaction();
        let center = Point3::from(keyframe.world_from_camera.translation.vector);
        let view = transaction.add_view(center).map_err(refused)?;
        let mut intake = Intake {
            landmarks: &mut self.landmarks,
            points: &mut self.points,
            transaction: &mut transaction,
            scratch: &mut self.scratch,
            sigma_factor: self.options.carving.cut.sigma_factor,
            new_points: 0,
        };
        intake.begin();
        for segment in &keyframe.segments {
            intake
                .take_segment(measurements(
                    segment,
                    &camera,
                    &keyframe.world_from_camera,
                    &self.noise,
                    &self.options.segment_points,
                ))
                .map_err(refused)?;
        }
        let options = self.options.surface_points;
        let surface = KeyframeSurface::new(
            &keyframe.surface,
            &camera,
            &keyframe.world_from_camera,
            &options,
        );
        if keyframe.surface.known_count() > 0 {
            intake.take_surface(&surface, &options).map_err(refused)?;
        }
        intake.paint(keyframe, &surface);
        update.new_points = intake.new_points;

        let IntakeScratch {
            seen,
            contradicted,
            stretches,
            edges,
            ..
        } = &mut self.scratch;
        let concerned = contradicted.iter().chain(&*seen).copied();
        (update.moved_points, update.removed_points) = settle(
            &mut self.landmarks,
            &self.points,
            &mut transaction,
            concerned,
        )
        .map_err(refused)?;
        let landmarks = &self.landmarks;
        let is_in_use = |landmark: &u32| landmarks.is_in_use(*landmark);
        // One ray from a camera to a point, however many segments of the keyframe meet in it.
        seen.retain(is_in_use);
        update.observed_again = seen.len().saturating_sub(update.new_points);
        for landmark in &*seen {
            transaction
                .add_observation(view, self.points[*landmark as usize], 1)
                .map_err(refused)?;
        }
        let carving = &self.options.carving;
        for (pairs, weight) in [
            (stretches, carving.segment_weight),
            (edges, carving.triangulation_weight),
        ] {
            if weight == 0 {
                continue;
            }
            pairs.sort_unstable();
            pairs.dedup();
            for ends in pairs.iter().filter(|ends| ends.iter().all(is_in_use)) {
                let ends = ends.map(|landmark| self.points[landmark as usize]);
                transaction
                    .add_segment(view, ends, weight)
                    .map_err(refused)?;
            }
        }
        update.matching = start.elapsed() - update.clustering;
        let report = transaction.commit().map_err(refused)?;
        update.carving = start.elapsed() - update.clustering - update.matching;
        update.changed_triangles = report.surface.added.len() + report.surface.removed.len();
        let concerned = self.scratch.contradicted.iter().chain(&self.scratch.seen);
        self.vertices
            .note(&self.carver, &self.points, concerned.copied());
        let observers = Observers {
            carver: &self.carver,
            points: &self.points,
            vertices: &self.vertices,
        };
        let contradictions = self.support.push(
            observers,
            &report.surface,
            &keyframe.world_from_camera,
            &keyframe.surface,
        );
        if !contradictions.is_empty() {
            let measured = contradictions
                .iter()
                .filter_map(|pixel| surface.measured_at(pixel));
            self.correct(keyframe, view, &surface, measured, &mut update)
                .map_err(refused)?;
        }
        update.support = start.elapsed() - update.clustering - update.matching - update.carving;
        self.keyframes += 1;
        Ok(update)
    }

    /// Adds points that the last keyframe measured behind the surface that was carved so far.
    fn correct(
        &mut self,
        keyframe: &Keyframe,
        view: ViewId,
        surface: &KeyframeSurface<'_>,
        measured: impl Iterator<Item = Measurement>,
        update: &mut MapUpdate,
    ) -> Result<(), EventError> {
        let before = std::mem::take(&mut self.scratch.seen);
        let mut transaction = self.carver.transaction();
        let mut intake = Intake {
            landmarks: &mut self.landmarks,
            points: &mut self.points,
            transaction: &mut transaction,
            scratch: &mut self.scratch,
            sigma_factor: self.options.carving.cut.sigma_factor,
            new_points: 0,
        };
        intake.take_points(measured, &before)?;
        intake.paint(keyframe, surface);
        let new_points = intake.new_points;
        update.new_points += new_points;
        update.observed_again += self.scratch.seen.len().saturating_sub(new_points);
        for landmark in &self.scratch.seen {
            transaction.add_observation(view, self.points[*landmark as usize], 1)?;
        }
        let report = transaction.commit()?;
        update.changed_triangles += report.surface.added.len() + report.surface.removed.len();
        let concerned = self.scratch.seen.iter().copied();
        self.vertices.note(&self.carver, &self.points, concerned);
        let observers = Observers {
            carver: &self.carver,
            points: &self.points,
            vertices: &self.vertices,
        };
        self.support.correct(observers, &report.surface);
        Ok(())
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
        let tetrahedra = self.carver.tetrahedra();
        let is_short = |[a, b, c]: Triangle| {
            longest.is_none_or(|longest| {
                [(a, b), (b, c), (c, a)].iter().all(|(from, to)| {
                    nalgebra::distance(&tetrahedra.position(*from), &tetrahedra.position(*to))
                        <= longest
                })
            })
        };
        let is_wanted = |triangle: Triangle| match self.support.of(&triangle) {
            Finding::Measured => true,
            Finding::NotMeasured => false,
            Finding::Unwitnessed => is_short(triangle),
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
        let colors: Vec<Option<[u8; 3]>> = origins
            .iter()
            .map(|vertex| {
                let landmark = self.vertices.landmark((*vertex)?)?;
                self.landmarks.color(landmark)
            })
            .collect();
        let has_any = colors.iter().any(Option::is_some);
        has_any.then(|| {
            let color = |color: Option<[u8; 3]>| color.unwrap_or(UNSEEN);
            colors.into_iter().map(color).collect()
        })
    }
}
