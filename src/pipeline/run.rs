//! Front ends in parallel, the back end in order.

use std::ops::Range;

use linecarve_lines::{ExtractError, ExtractOptions};
use rayon::prelude::*;

use super::depth_source::{self, DepthSource};
use super::front_end::{FrontEnd, FrontEndError, Keyframe};
use crate::checkpoint::Checkpoint;
use linecarve_sequence::Sequence;

/// What the front end hands on.
#[derive(Debug)]
pub enum Arrival {
    /// A keyframe whose depth was estimated from the first of its neighbours: to be taken away again when its last estimate comes.
    First {
        /// The keyframe.
        keyframe: Keyframe,
        /// How many keyframes had come after it by then.
        awaited: usize,
    },
    /// All that there will be of a keyframe.
    Last(Result<Keyframe, FrontEndError>),
}

/// Runs the front end over `frames` of a sequence and hands each result to `consume`, in order, on the calling thread's
/// side: while one group of keyframes is consumed, the next is prepared. Memory holds two groups, each of one keyframe a
/// worker thread, and with depth from neighbours the images of a window. What `consume` sees does not depend on the number of
/// threads.
///
/// `consume` is told the number of the keyframe. With depth from neighbours a keyframe comes when the last of those that may be
/// its neighbours has; when `is_with_first` says so it has come before, as soon as enough of them had.
///
/// Keyframes are taken from `checkpoint` where it has them, and kept there.
///
/// # Errors
/// When `consume` fails, or the options are out of range. A front end's failure goes to `consume`, which decides whether
/// it ends the run.
pub fn run<E>(
    sequence: &Sequence,
    source: &DepthSource,
    frames: &[usize],
    options: ExtractOptions,
    checkpoint: Option<&Checkpoint>,
    is_with_first: bool,
    mut consume: impl FnMut(usize, Arrival) -> Result<(), E> + Send,
) -> Result<(), E>
where
    E: From<ExtractError> + Send,
{
    match source {
        DepthSource::Sensor(sensor) => {
            let front_end = FrontEnd::new(sequence, sensor, options)?;
            let prepare = |front_end: &mut FrontEnd, keyframe: usize| {
                Checkpoint::load_or(checkpoint, keyframe, || {
                    front_end.process(frames[keyframe], keyframe as u32)
                })
            };
            let consume = |number, keyframe| consume(number, Arrival::Last(keyframe));
            run_in_order(frames.len(), || front_end.clone(), prepare, consume)
        }
        DepthSource::SemiDense(source) => depth_source::run(
            sequence,
            source,
            frames,
            options,
            checkpoint,
            is_with_first,
            consume,
        ),
    }
}

/// Prepares 0 to `count` in parallel and hands each result to `consume`, in order: while one group is consumed, the next is
/// prepared. At most two groups, each of one a worker thread, are in memory. Each worker has a state of its own to prepare
/// with. What `consume` sees does not depend on the number of threads.
///
/// # Errors
/// When `consume` fails.
pub(super) fn run_in_order<S, T: Send, E: Send>(
    count: usize,
    state: impl Fn() -> S + Sync + Send,
    prepare: impl Fn(&mut S, usize) -> T + Sync + Send,
    mut consume: impl FnMut(usize, T) -> Result<(), E> + Send,
) -> Result<(), E> {
    let group = rayon::current_num_threads().max(1);
    let prepare_group = |range: Range<usize>| -> Vec<T> {
        range.into_par_iter().map_init(&state, &prepare).collect()
    };
    let mut ready = prepare_group(0..group.min(count));
    let mut start = 0;
    while !ready.is_empty() {
        let next = start + ready.len();
        let (consumed, prepared) = rayon::join(
            || {
                for (offset, item) in ready.drain(..).enumerate() {
                    consume(start + offset, item)?;
                }
                Ok::<(), E>(())
            },
            || prepare_group(next..(next + group).min(count)),
        );
        consumed?;
        ready = prepared;
        start = next;
    }
    Ok(())
}
