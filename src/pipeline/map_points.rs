//! Map points from features, carved: the counterpart of [`FrontEnd`](super::FrontEnd), [`BackEnd`](super::BackEnd) and
//! [`run`](super::run) for keyframes whose images are looked at for points. No depth is needed.

use std::time::{Duration, Instant};

use linecarve_carving::{Carver, CarverOptions, PointId, TransactionError, ViewId};
use linecarve_carving::{ExportOptions, Hull};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use super::options::Options;
use super::run::run_in_order;
use crate::checkpoint::Checkpoint;
use crate::files::WriteError;
use crate::map_points::{
    FeatureDetector, FeatureError, Features, MapPointOptions, PointChange, PointCounts, PointMap,
    PointMapError,
};
use crate::mesh::TriangleMesh;
use crate::report::{StageTimes, milliseconds};
use crate::sequence::{FrameError, Sequence};

/// A keyframe on its way from image to map.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct PointKeyframe {
    /// Position of the frame in the sequence.
    pub frame: usize,
    /// Pose of the colour camera.
    pub world_from_camera: Isometry3<f64>,
    /// What is in its image.
    pub features: Features,
    /// Milliseconds spent so far.
    pub times: StageTimes,
}

/// Why a keyframe has no features.
#[derive(Debug, thiserror::Error)]
pub enum PointFrontEndError {
    /// The image is missing, broken or of the wrong size.
    #[error(transparent)]
    Image(#[from] FrameError),
    /// The detector refuses the image.
    #[error("frame {frame}: {source}")]
    Features {
        /// Name of the frame.
        frame: String,
        /// Why.
        source: FeatureError,
    },
    /// What was found cannot be kept.
    #[error(transparent)]
    Keep(#[from] WriteError),
}

impl PointFrontEndError {
    /// Whether the fault lies in this frame alone, so that the run can go on without it.
    pub fn is_limited_to_frame(&self) -> bool {
        match self {
            Self::Image(error) => error.is_limited_to_frame(),
            Self::Features { .. } => true,
            Self::Keep(_) => false,
        }
    }
}

/// Why a keyframe could not be added. The map is then not to be used any further.
#[derive(Debug, thiserror::Error)]
pub enum PointBackEndError {
    /// An option is out of range.
    #[error(transparent)]
    Options(#[from] PointMapError),
    /// The carver refuses a camera centre or a point.
    #[error("the map refuses keyframe {keyframe}: {source} (check its pose)")]
    Carve {
        /// Number of the keyframe.
        keyframe: usize,
        /// Why.
        source: TransactionError,
    },
}

/// Reads one frame and finds its features.
///
/// # Errors
/// When the image cannot be read.
pub fn find_features(
    sequence: &Sequence,
    frame: usize,
    options: &MapPointOptions,
) -> Result<PointKeyframe, PointFrontEndError> {
    let start = Instant::now();
    let image = sequence.load_gray(frame)?;
    let loaded = start.elapsed();
    let features = FeatureDetector::new(*options)
        .detect(&image)
        .map_err(|source| PointFrontEndError::Features {
            frame: sequence.frames()[frame].name.clone(),
            source,
        })?;
    Ok(PointKeyframe {
        frame,
        world_from_camera: sequence.frames()[frame].world_from_camera,
        features,
        times: StageTimes {
            load: milliseconds(loaded),
            features: milliseconds(start.elapsed() - loaded),
            ..StageTimes::default()
        },
    })
}

/// What [`find_features`] made of one keyframe.
type Prepared = Result<PointKeyframe, PointFrontEndError>;

/// Finds the features of `frames` of a sequence and hands each keyframe to `consume`, in order. Keyframes are taken from
/// `checkpoint` where it has them, and kept there. What `consume` sees does not depend on the number of threads.
///
/// # Errors
/// When `consume` fails. An image's failure goes to `consume`, which decides whether it ends the run.
pub fn run_map_points<E: Send>(
    sequence: &Sequence,
    frames: &[usize],
    options: &MapPointOptions,
    checkpoint: Option<&Checkpoint>,
    consume: impl FnMut(usize, Prepared) -> Result<(), E> + Send,
) -> Result<(), E> {
    let prepare = |_: &mut (), keyframe: usize| {
        Checkpoint::load_or(checkpoint, keyframe, || {
            find_features(sequence, frames[keyframe], options)
        })
    };
    run_in_order(frames.len(), || (), prepare, consume)
}

/// A map of points for keyframes of a sequence. Nobody looks for a lens that the sequence knows.
///
/// # Errors
/// When an option is out of range.
pub(super) fn empty_map(sequence: &Sequence, options: &Options) -> Result<PointMap, PointMapError> {
    let mut correction = options.pose_correction;
    correction.lens &= !sequence.has_known_lens();
    let size = sequence.color_size();
    PointMap::new(
        options.map_points,
        correction,
        sequence.color_camera(),
        size.width as usize,
        size.height as usize,
    )
}

/// What one keyframe did to the map.
#[derive(Debug, Clone, Copy, Default)]
pub struct PointUpdate {
    /// What became of its features.
    pub counts: PointCounts,
    /// Points that are newly carved.
    pub added: usize,
    /// Points that were carved and moved.
    pub moved: usize,
    /// Points that were carved and are not any more.
    pub removed: usize,
    /// Triangles that the surface gained and lost.
    pub changed_triangles: usize,
    /// Time for matching, triangulation and refinement.
    pub matching: Duration,
    /// Time for changing points, walking rays and bringing labels and surface up to date.
    pub carving: Duration,
}

/// The map: points, and the carved tetrahedralisation that follows them.
pub struct PointBackEnd {
    options: Options,
    /// Of the scene in units of the poses, when something other than the points tells it.
    median_depth: Option<f64>,
    map: PointMap,
    carver: Carver,
    views: Vec<ViewId>,
    /// The carver's id of each point, by the map's.
    points: Vec<Option<PointId>>,
}

impl PointBackEnd {
    /// An empty map for keyframes of `sequence`. `median_depth` is that of the scene in units of the poses, which sets the longest
    /// edge of the surface; without one it is that of the points.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(
        options: &Options,
        sequence: &Sequence,
        median_depth: Option<f64>,
    ) -> Result<Self, PointBackEndError> {
        Ok(Self {
            map: empty_map(sequence, options)?,
            carver: Carver::new(carver_options(options)),
            options: options.clone(),
            median_depth,
            views: Vec::new(),
            points: Vec::new(),
        })
    }

    /// Adds a keyframe.
    ///
    /// # Errors
    /// When the carver refuses its position or one of its points: not a number, or out of range.
    pub fn push(&mut self, keyframe: &PointKeyframe) -> Result<PointUpdate, PointBackEndError> {
        let number = self.views.len();
        let refused = |source| PointBackEndError::Carve {
            keyframe: number,
            source,
        };
        let start = Instant::now();
        let counts = self
            .map
            .push(&keyframe.world_from_camera, keyframe.features.clone());
        let mut update = PointUpdate {
            counts,
            matching: start.elapsed(),
            ..PointUpdate::default()
        };
        self.follow(&mut update).map_err(refused)?;
        update.carving = start.elapsed() - update.matching;
        Ok(update)
    }

    /// Moves all keyframes and points together, after the last one: the surface is then that of points which all
    /// keyframes agree on. With poses taken as they are nothing changes.
    ///
    /// # Errors
    /// As [`push`](Self::push).
    pub fn finish(&mut self) -> Result<(), PointBackEndError> {
        let keyframe = self.views.len().saturating_sub(1);
        self.map.adjust_all();
        self.follow(&mut PointUpdate::default())
            .map_err(|source| PointBackEndError::Carve { keyframe, source })
    }

    /// Lets the carver follow what has changed in the map.
    fn follow(&mut self, update: &mut PointUpdate) -> Result<(), TransactionError> {
        let mut transaction = self.carver.transaction();
        for new in &self.map.keyframes()[self.views.len()..] {
            self.views.push(transaction.add_view(new.center())?);
        }
        for change in self.map.changes() {
            // Changes name points that were added before, and keyframes that were pushed.
            let carved = |points: &[Option<PointId>], point: u32| {
                points
                    .get(point as usize)
                    .copied()
                    .flatten()
                    .expect("a point that changes is carved")
            };
            match *change {
                PointChange::Add {
                    point,
                    point_in_world,
                } => {
                    let index = point.0 as usize;
                    if self.points.len() <= index {
                        self.points.resize(index + 1, None);
                    }
                    let id = transaction.add_point(point_in_world)?;
                    self.points[index] = Some(id);
                    update.added += 1;
                }
                PointChange::Move {
                    point,
                    point_in_world,
                } => {
                    transaction.move_point(carved(&self.points, point.0), point_in_world)?;
                    update.moved += 1;
                }
                PointChange::MoveKeyframe { keyframe, center } => {
                    transaction.move_view(self.views[keyframe as usize], center)?;
                }
                PointChange::Remove { point } => {
                    transaction.remove_point(carved(&self.points, point.0))?;
                    self.points[point.0 as usize] = None;
                    update.removed += 1;
                }
                PointChange::See { keyframe, point } => transaction.add_observation(
                    self.views[keyframe as usize],
                    carved(&self.points, point.0),
                    1,
                )?,
                PointChange::Unsee { keyframe, point } => transaction.remove_observation(
                    self.views[keyframe as usize],
                    carved(&self.points, point.0),
                )?,
            }
        }
        let report = transaction.commit()?;
        update.changed_triangles = report.surface.added.len() + report.surface.removed.len();
        Ok(())
    }

    /// The points.
    pub fn map(&self) -> &PointMap {
        &self.map
    }

    /// The carved tetrahedralisation.
    pub fn carver(&self) -> &Carver {
        &self.carver
    }

    /// The surface as it stands, without what the options leave out.
    pub fn surface(&self) -> TriangleMesh {
        let depth = self.median_depth.or_else(|| self.map.median_depth());
        surface_of(&self.carver, &self.options, depth)
    }
}

/// The carver that the options ask for.
pub(super) fn carver_options(options: &Options) -> CarverOptions {
    CarverOptions {
        labels: options.carving.labels(),
        hull: if options.surface.keep_hull {
            Hull::Keep
        } else {
            Hull::Drop
        },
    }
}

/// The surface without what the options leave out; without a depth no edge is too long.
pub(super) fn surface_of(
    carver: &Carver,
    options: &Options,
    median_depth: Option<f64>,
) -> TriangleMesh {
    let surface = &options.surface;
    let mesh = carver.mesh(&ExportOptions {
        longest_edge: median_depth
            .zip(surface.longest_edge_share)
            .map(|(depth, share)| share * depth),
        minimum_component: surface.minimum_component,
        manifold: surface.manifold,
    });
    TriangleMesh {
        positions: mesh.vertices,
        triangles: mesh.triangles,
        colors: None,
    }
}
