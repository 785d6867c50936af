//! What a keyframe adds to the map: clusters, landmarks, free space, surface. Strictly one keyframe after another.

use std::time::{Duration, Instant};

use linecarve_carving::carver::{Carver, CarverOptions, EventError, PointId, Transaction};
use linecarve_carving::surface::{ExportOptions, Hull};
use linecarve_lines::camera::Camera;
use linecarve_lines::cluster::ClusterOptionsError;
use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;

use super::front_end::Keyframe;
use super::landmarks::{Landmarks, Measurement, Observed, Settled};
use super::options::Options;
use super::segment_map::SegmentMap;
use super::segment_points::measurements;
use super::surface_points::{KeyframeSurface, Verdict};
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
    /// Landmarks that are to be settled besides those seen.
    touched: Vec<u32>,
    /// What the current keyframe says about landmarks.
    verdicts: Vec<(u32, Verdict)>,
    /// Vertex of each landmark in the triangulation of the current keyframe, `u32::MAX` without one.
    vertex_of: Vec<u32>,
}

/// Where the measurements of one keyframe go.
struct Measured<'a, 'b> {
    landmarks: &'a mut Landmarks,
    points: &'a mut Vec<PointId>,
    transaction: &'a mut Transaction<'b>,
    seen: &'a mut Vec<u32>,
    /// What a standard deviation is multiplied by for the carver.
    sigma_factor: f64,
    new_points: usize,
}

impl Measured<'_, '_> {
    /// Joins a measurement to its landmark, which is returned.
    fn take(&mut self, measurement: &Measurement) -> Result<u32, EventError> {
        let landmark = match self.landmarks.observe(measurement) {
            Observed::New(landmark) => {
                let point = self.transaction.add_point(measurement.point_in_world)?;
                let sigma = self.sigma_factor * measurement.sigma;
                self.transaction.set_sigma(point, Some(sigma))?;
                self.points.push(point);
                self.new_points += 1;
                landmark
            }
            Observed::Again(landmark) => landmark,
        };
        self.seen.push(landmark);
        Ok(landmark)
    }
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
            touched: Vec::new(),
            verdicts: Vec::new(),
            vertex_of: Vec::new(),
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
        self.touched.clear();
        let measured = &mut Measured {
            landmarks: &mut self.landmarks,
            points: &mut self.points,
            transaction: &mut transaction,
            seen: &mut self.seen,
            sigma_factor: self.options.carving.cut.sigma_factor,
            new_points: 0,
        };
        let mut chains: Vec<[u32; 2]> = Vec::new();
        for segment in &keyframe.segments {
            let mut last = None;
            for measurement in measurements(
                segment,
                &self.camera,
                &keyframe.world_from_camera,
                &self.noise,
                &self.options.segment_points,
            ) {
                let landmark = measured.take(&measurement).map_err(refused)?;
                chains.extend(last.map(|last| [last, landmark]));
                last = Some(landmark);
            }
        }
        if keyframe.surface.known_count() > 0 {
            let surface = KeyframeSurface::new(
                &keyframe.surface,
                &self.camera,
                &keyframe.world_from_camera,
                &self.options.surface_points,
            );
            let mut vertices = Vec::new();
            self.vertex_of.clear();
            self.vertex_of.resize(measured.points.len(), u32::MAX);
            for landmark in measured.seen.iter() {
                let vertex_of = &mut self.vertex_of[*landmark as usize];
                if *vertex_of == u32::MAX
                    && let Some(vertex) = surface.vertex(&measured.landmarks.position(*landmark))
                {
                    *vertex_of = vertices.len() as u32;
                    vertices.push(vertex);
                }
            }
            self.verdicts.clear();
            for (landmark, position) in measured.landmarks.iter() {
                if self.vertex_of[landmark as usize] == u32::MAX {
                    match surface.judge(&position) {
                        Verdict::Silent => {}
                        verdict => self.verdicts.push((landmark, verdict)),
                    }
                }
            }
            for (landmark, verdict) in &self.verdicts {
                if let Verdict::Confirmed {
                    vertex,
                    measurement,
                } = verdict
                {
                    measured.landmarks.confirm(*landmark, measurement);
                    measured.seen.push(*landmark);
                    self.vertex_of[*landmark as usize] = vertices.len() as u32;
                    vertices.push(*vertex);
                } else {
                    measured.landmarks.contradict(*landmark);
                    self.touched.push(*landmark);
                }
            }
            let vertex_of = |landmark: u32| self.vertex_of[landmark as usize];
            let lines: Vec<[u32; 2]> = chains
                .iter()
                .map(|[a, b]| [vertex_of(*a), vertex_of(*b)])
                .collect();
            for measurement in
                surface.missing(&vertices, &lines, &self.options.surface_points.refine)
            {
                measured.take(&measurement).map_err(refused)?;
            }
        }
        update.new_points = measured.new_points;
        self.touched.extend(&self.seen);
        for landmark in &self.touched {
            let point = self.points[*landmark as usize];
            match self.landmarks.settle(*landmark) {
                Settled::Stays => {}
                Settled::Moved(position) => {
                    transaction.move_point(point, position).map_err(refused)?;
                    update.moved_points += 1;
                }
                Settled::GivenUp => {
                    transaction.remove_point(point).map_err(refused)?;
                    update.removed_points += 1;
                }
            }
        }
        // One ray from a camera to a point, however many segments of the keyframe meet in it.
        self.seen.sort_unstable();
        self.seen.dedup();
        let landmarks = &self.landmarks;
        self.seen.retain(|landmark| landmarks.is_in_use(*landmark));
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
