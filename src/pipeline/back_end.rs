//! What a keyframe adds to the map: clusters, landmarks, free space, surface. Strictly one keyframe after another.

use std::time::{Duration, Instant};

use linecarve_carving::carver::{Carver, CarverOptions, EventError, PointId};
use linecarve_carving::surface::{ExportOptions, Hull};
use linecarve_lines::camera::Camera;
use linecarve_lines::cluster::ClusterOptionsError;
use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;

use super::front_end::Keyframe;
use super::landmarks::{Landmarks, Observed};
use super::options::Options;
use super::segment_map::SegmentMap;
use super::segment_points::measurements;
use crate::mesh::TriangleMesh;

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
    /// Triangles that the surface gained and lost.
    pub changed_triangles: usize,
    /// Time for the clusters.
    pub clustering: Duration,
    /// Time for choosing points and matching them with older ones.
    pub matching: Duration,
    /// Time for inserting points, walking rays and bringing labels and surface up to date.
    pub carving: Duration,
}

/// The map: segments and clusters, landmarks, and the carved tetrahedralisation.
pub struct BackEnd {
    options: Options,
    camera: Camera,
    noise: SensorNoise,
    median_depth: f64,
    keyframes: usize,
    segments: SegmentMap,
    landmarks: Landmarks,
    /// The carver's id of each landmark.
    points: Vec<PointId>,
    carver: Carver,
    /// Landmarks that the current keyframe measured; kept for its memory.
    seen: Vec<u32>,
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
            keyframes: 0,
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
            seen: Vec::new(),
        })
    }

    /// Adds a keyframe.
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
        let clustering = start.elapsed();

        let mut update = MapUpdate {
            clustering,
            ..MapUpdate::default()
        };
        let mut transaction = self.carver.transaction();
        let center = Point3::from(keyframe.world_from_camera.translation.vector);
        let view = transaction.add_view(center).map_err(refused)?;
        self.seen.clear();
        for segment in &keyframe.segments {
            let points = measurements(
                segment,
                &self.camera,
                &keyframe.world_from_camera,
                &self.noise,
                &self.options.segment_points,
            );
            for measurement in points {
                match self.landmarks.observe(&measurement) {
                    Observed::New(landmark) => {
                        let point = transaction
                            .add_point(measurement.point_in_world)
                            .map_err(refused)?;
                        let sigma = self.options.carving.cut.sigma_factor * measurement.sigma;
                        transaction.set_sigma(point, Some(sigma)).map_err(refused)?;
                        self.points.push(point);
                        self.seen.push(landmark);
                        update.new_points += 1;
                    }
                    Observed::Again(landmark) => self.seen.push(landmark),
                }
            }
        }
        // One ray from a camera to a point, however many segments of the keyframe meet in it.
        self.seen.sort_unstable();
        self.seen.dedup();
        update.observed_again = self.seen.len() - update.new_points;
        for landmark in &self.seen {
            transaction
                .add_observation(view, self.points[*landmark as usize], 1)
                .map_err(refused)?;
        }
        update.matching = start.elapsed() - clustering;
        let report = transaction.commit().map_err(refused)?;
        update.carving = start.elapsed() - clustering - update.matching;
        update.changed_triangles = report.surface.added.len() + report.surface.removed.len();
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
        let mesh = self.carver.mesh(&ExportOptions {
            longest_edge: surface
                .longest_edge_share
                .map(|share| share * self.median_depth),
            minimum_component: surface.minimum_component,
            manifold: surface.manifold,
        });
        TriangleMesh {
            positions: mesh.vertices,
            triangles: mesh.triangles,
            colors: None,
        }
    }
}
