//! Keyframes that come one by one, and the map made from them.

use nalgebra::Vector3;

use super::SessionError;
use super::session_keyframes::SessionKeyframes;
use crate::front_end::{Arrival, FrontEnd, Keyframe, Source};
use crate::map::Map;
use crate::mapper::{Mapper, Taken};
use crate::options::Options;
use linecarve_sequence::{LiveSequence, Sequence};

/// The front end of a live session and the map of its keyframes.
pub(super) struct LiveMapping {
    pub(super) front_end: FrontEnd,
    pub(super) mapper: Mapper,
    pub(super) source: Source,
}

impl LiveMapping {
    /// An empty map.
    pub(super) fn begin(
        options: &Options,
        live: &LiveSequence,
        source: Source,
        origin: Vector3<f64>,
    ) -> Result<Self, SessionError> {
        let mut map = empty_map(options, live.sequence(), &source)?;
        map.keep_measurements();
        let mut mapper = Mapper::new(map, origin);
        mapper.follow_surface();
        Ok(Self {
            front_end: FrontEnd::live(&source, options)?,
            mapper,
            source,
        })
    }

    /// Adds a result of the front end to the map and its keyframe; errors name keyframe `id`. The map must not be used after
    /// an error.
    pub(super) fn add_arrival(
        &mut self,
        id: u64,
        (number, mut arrival): (usize, Arrival),
        keyframes: &mut SessionKeyframes,
    ) -> Result<(), SessionError> {
        let failed = |source| SessionError::FrontEnd { id, source };
        let (frame, provisional) = match &mut arrival {
            Arrival::Provisional { keyframe, .. } => (frame_of(keyframe), Some(keyframe.clone())),
            Arrival::Final(Ok(keyframe)) => {
                keyframe.renumber(keyframes.next_place());
                (frame_of(keyframe), None)
            }
            Arrival::Final(Err(_)) => (None, None),
        };
        let index = frame.and_then(|frame| keyframes.index_of_frame(frame));
        if frame.is_some() && index.is_none() {
            // It was removed meanwhile.
            return Ok(());
        }
        let taken = self.mapper.take(number, arrival, false)?;
        match (taken, index, provisional) {
            (Taken::Skipped(source), ..) => Err(failed(source)),
            (Taken::Keyframe(update), Some(index), _) => {
                keyframes.set_final(index, update.keyframe, update.times);
                Ok(())
            }
            (Taken::Provisional, Some(index), Some(mut keyframe)) => {
                keyframe.translate(&-self.mapper.origin());
                keyframes.set_provisional(index, keyframe);
                Ok(())
            }
            _ => Ok(()),
        }
    }
}

fn frame_of(keyframe: &Keyframe) -> Option<usize> {
    keyframe.lines().map(|lines| lines.frame)
}

/// A map without keyframes.
pub(super) fn empty_map(
    options: &Options,
    sequence: &Sequence,
    source: &Source,
) -> Result<Map, SessionError> {
    Ok(Map::of_source(options, sequence, source)?)
}
