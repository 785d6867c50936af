//! Front ends in parallel, the back end in order.

use std::ops::Range;

use linecarve_lines::depth::DepthSensor;
use linecarve_lines::{ExtractError, ExtractOptions};
use rayon::prelude::*;

use super::depth_source::{self, DepthSource};
use super::front_end::{FrontEnd, FrontEndError, Keyframe, KeyframeStore};
use crate::sequence::Sequence;

/// What the front end made of one keyframe.
type Prepared = Result<Keyframe, FrontEndError>;

/// Runs the front end over `frames` of a sequence and hands each result to `consume`, in order, on the calling thread's
/// side: while one group of keyframes is consumed, the next is prepared. Memory holds two groups, each of one keyframe a
/// worker thread, and with depth from neighbours the images of a window. What `consume` sees does not depend on the number of
/// threads.
///
/// `consume` is told the number of the keyframe. With depth from neighbours a keyframe comes when the last of those that may be
/// its neighbours has.
///
/// Keyframes with depth images are taken from `store` where it has them, and kept there. With depth from neighbours there is
/// nothing to keep: a keyframe's depth needs the images around it.
///
/// # Errors
/// When `consume` fails, or the options are out of range. A front end's failure goes to `consume`, which decides whether
/// it ends the run.
pub fn run<E>(
    sequence: &Sequence,
    source: &DepthSource,
    frames: &[usize],
    options: ExtractOptions,
    store: Option<&dyn KeyframeStore>,
    consume: impl FnMut(usize, Prepared) -> Result<(), E> + Send,
) -> Result<(), E>
where
    E: From<ExtractError> + Send,
{
    match source {
        DepthSource::Sensor(sensor) => {
            run_sensor(sequence, sensor, frames, options, store, consume)
        }
        DepthSource::SemiDense(source) => {
            depth_source::run(sequence, source, frames, options, consume)
        }
    }
}

/// The keyframe as it was kept, or made and kept.
fn kept(
    store: Option<&dyn KeyframeStore>,
    keyframe: usize,
    make: impl FnOnce() -> Prepared,
) -> Prepared {
    let Some(store) = store else {
        return make();
    };
    if let Some(kept) = store.load(keyframe) {
        return Ok(kept);
    }
    let made = make()?;
    store.store(keyframe, &made)?;
    Ok(made)
}

/// Keyframes with depth images: each stands for itself.
fn run_sensor<E>(
    sequence: &Sequence,
    sensor: &DepthSensor,
    frames: &[usize],
    options: ExtractOptions,
    store: Option<&dyn KeyframeStore>,
    mut consume: impl FnMut(usize, Prepared) -> Result<(), E> + Send,
) -> Result<(), E>
where
    E: From<ExtractError> + Send,
{
    // Options are checked once, so that building a front end for each worker cannot fail differently.
    FrontEnd::new(sequence, sensor, options)?;
    let group = rayon::current_num_threads().max(1);
    let prepare = |keyframes: Range<usize>| -> Result<Vec<Prepared>, ExtractError> {
        keyframes
            .into_par_iter()
            .map_init(
                || FrontEnd::new(sequence, sensor, options),
                |front_end, keyframe| match front_end {
                    Ok(front_end) => Ok(kept(store, keyframe, || {
                        front_end.process(frames[keyframe], keyframe as u32)
                    })),
                    Err(error) => Err(error.clone()),
                },
            )
            .collect()
    };

    let mut ready = prepare(0..group.min(frames.len()))?;
    let mut start = 0;
    while !ready.is_empty() {
        let next = start + ready.len();
        let (consumed, prepared) = rayon::join(
            || {
                for (offset, keyframe) in ready.drain(..).enumerate() {
                    consume(start + offset, keyframe)?;
                }
                Ok::<(), E>(())
            },
            || prepare(next..(next + group).min(frames.len())),
        );
        consumed?;
        ready = prepared?;
        start = next;
    }
    Ok(())
}
