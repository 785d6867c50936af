//! Front ends: from images to keyframes, before anything is fused in the map.
//!
//! A [`FrontEnd`] takes frames in order and returns [`Arrival`]s. It does not depend on the map, so it can work ahead. Its
//! results do not depend on the number of threads.

mod colors;
mod confidence_noise;
mod depth_layers;
mod edge_points;
mod error;
mod feature_scale;
mod features;
mod image_poses;
mod image_scale;
mod keyframe;
mod live;
mod placed_poses;
mod scale;
mod semi_dense;
mod sensor;
mod source;

use std::ops::Range;

use linecarve_lines::ExtractError;
use linecarve_sequence::Sequence;
use rayon::prelude::*;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::options::Options;
use crate::run::Checkpoint;

pub use colors::KeyframeColors;
pub use confidence_noise::ClassSummary;
pub use depth_layers::{
    KeyframeDepths, LayerSummary, class_noise, measure_confidence, read_keyframe_depth,
};
pub use edge_points::EdgePoint;
pub use error::FrontEndError;
pub(crate) use feature_scale::median_feature_depth;
pub use features::FeatureFrontEnd;
pub(crate) use image_poses::empty_point_map;
pub use image_poses::{ImagePoses, ImagePosesError, PoseSummary, correct_poses};
pub use image_scale::{ScaleError, median_depth_from_images};
pub use keyframe::{FeatureKeyframe, Keyframe, LineKeyframe, unmeasurable_warning};
pub(crate) use scale::far_origin;
pub use scale::{median_depth, median_scene_depth};
pub use semi_dense::SemiDenseFrontEnd;
pub(crate) use sensor::KeyframeImages;
pub use sensor::SensorFrontEnd;
pub use source::{SemiDenseSource, Source};

/// A result of a front end.
#[derive(Debug)]
pub enum Arrival {
    /// A keyframe with a first depth estimate. A final arrival of the same number replaces it.
    Provisional {
        /// The keyframe.
        keyframe: Keyframe,
        /// Number of keyframes read between this one and its estimate.
        delay_keyframes: usize,
    },
    /// The final keyframe, or the error of its frame.
    Final(Result<Keyframe, FrontEndError>),
}

/// Arrivals with the numbers of their keyframes, in the order for the map.
pub(crate) type Arrivals = Vec<(usize, Arrival)>;

/// The kinds of front end.
pub enum FrontEnd {
    /// 3D segments, with depth from depth images.
    Sensor(Box<SensorFrontEnd>),
    /// 3D segments, with depth from neighbouring keyframes.
    SemiDense(Box<SemiDenseFrontEnd>),
    /// ORB features.
    Features(FeatureFrontEnd),
    /// Views of a model; no image is read. Each group is one keyframe.
    Views,
}

/// A group of frames that become keyframes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Group<'a> {
    /// Number of the first keyframe.
    pub first: usize,
    /// Positions of the frames in the sequence.
    pub frames: &'a [usize],
    /// Whether this is the last group.
    pub is_last: bool,
}

impl FrontEnd {
    /// The front end of a source. `checkpoint` may hold some of `count` keyframes. With `emits_provisional` keyframes with a first depth
    /// estimate are returned, too.
    ///
    /// # Errors
    /// When an option is out of range.
    pub fn new(
        source: &Source,
        options: &Options,
        count: usize,
        checkpoint: Option<&Checkpoint>,
        emits_provisional: bool,
    ) -> Result<Self, ExtractError> {
        Ok(match source {
            Source::Sensor {
                sensor,
                median_depth,
            } => {
                let extract = options.extract(*median_depth);
                Self::Sensor(Box::new(SensorFrontEnd::new(sensor.clone(), extract)?))
            }
            Source::SemiDense(source) => {
                let extract = options.extract(source.median_depth);
                let front_end =
                    SemiDenseFrontEnd::new(source, count, extract, checkpoint, emits_provisional)?;
                Self::SemiDense(Box::new(front_end))
            }
            Source::MapPoints { .. } => Self::Features(FeatureFrontEnd::new(options.map_points)),
            Source::Model(_) => Self::Views,
        })
    }

    /// Prepares the keyframes of a range alone, which a new front end finds in `checkpoint` or stores there; of those whose depth comes from
    /// neighbours, images around the range are read too. Returns the final keyframes.
    pub(crate) fn prepare_range(
        mut self,
        sequence: &Sequence,
        frames: &[usize],
        range: Range<usize>,
        checkpoint: &Checkpoint,
    ) -> Arrivals {
        match &mut self {
            Self::SemiDense(front_end) => front_end.prepare_range(sequence, frames, range),
            Self::Sensor(_) | Self::Features(_) | Self::Views => {
                let group = Group {
                    first: range.start,
                    frames: &frames[range],
                    is_last: false,
                };
                self.prepare(sequence, group, Some(checkpoint))
            }
        }
    }

    /// Reads a group of keyframes in parallel and returns the arrivals due. `checkpoint` provides and stores keyframes.
    pub(crate) fn prepare(
        &mut self,
        sequence: &Sequence,
        group: Group<'_>,
        checkpoint: Option<&Checkpoint>,
    ) -> Arrivals {
        match self {
            Self::Sensor(front_end) => front_end.prepare(sequence, group, checkpoint),
            Self::SemiDense(front_end) => front_end.prepare(sequence, group),
            Self::Features(front_end) => front_end.prepare(sequence, group, checkpoint),
            Self::Views => {
                let views = group.first..group.first + group.frames.len();
                let last = views.end.saturating_sub(1);
                let keyframe = (!views.is_empty()).then_some(Keyframe::Views(views));
                keyframe
                    .into_iter()
                    .map(|keyframe| (last, Arrival::Final(Ok(keyframe))))
                    .collect()
            }
        }
    }
}

/// Prepares keyframes that do not depend on each other in parallel, each thread with its own copy of `worker`.
fn prepare_independent<W: Clone + Send + Sync, T: Serialize + DeserializeOwned>(
    worker: &W,
    group: Group<'_>,
    checkpoint: Option<&Checkpoint>,
    process: impl Fn(&mut W, usize, usize) -> Result<T, FrontEndError> + Sync,
    into_keyframe: impl Fn(T) -> Keyframe + Sync,
) -> Arrivals {
    let prepare = |worker: &mut W, (index, frame): (usize, &usize)| {
        let number = group.first + index;
        let keyframe = Checkpoint::load_or(checkpoint, number, || process(worker, number, *frame));
        (number, Arrival::Final(keyframe.map(&into_keyframe)))
    };
    let frames = group.frames.par_iter().enumerate();
    frames.map_init(|| worker.clone(), prepare).collect()
}

/// Sends all `frames` through a front end in groups of `group` keyframes, and each arrival to `consume` in order. One group
/// is consumed while the next is prepared. Memory: two groups.
/// `read` frames went through the front end before and are passed over.
///
/// # Errors
/// When `consume` fails.
#[allow(clippy::too_many_arguments, reason = "one call runs a whole recording")]
pub fn run_in_groups<E: Send>(
    front_end: &mut FrontEnd,
    sequence: &Sequence,
    frames: &[usize],
    read: usize,
    group: usize,
    checkpoint: Option<&Checkpoint>,
    mut consume: impl FnMut(usize, Arrival) -> Result<(), E> + Send,
) -> Result<(), E> {
    let mut groups = frames[read..].chunks(group.max(1));
    let mut first = read;
    let mut prepare = || {
        let frames = groups.next()?;
        let group = Group {
            first,
            frames,
            is_last: groups.len() == 0,
        };
        first += frames.len();
        Some(front_end.prepare(sequence, group, checkpoint))
    };
    let mut ready = prepare();
    while let Some(arrivals) = ready {
        let (consumed, prepared) = rayon::join(
            || {
                for (number, arrival) in arrivals {
                    consume(number, arrival)?;
                }
                Ok::<(), E>(())
            },
            &mut prepare,
        );
        consumed?;
        ready = prepared;
    }
    Ok(())
}

/// Number of keyframes prepared at once: one per thread.
pub fn group_size() -> usize {
    rayon::current_num_threads().max(1)
}
