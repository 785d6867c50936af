//! Incremental semi-dense depth and the map made from it.

use nalgebra::Vector3;

use super::SessionError;
use super::session_keyframes::SessionKeyframes;
use crate::front_end::{Arrival, DepthSource, Keyframe, SemiDenseFrontEnd, SemiDenseSource};
use crate::map::Map;
use crate::mapper::{Mapper, Taken};
use crate::options::Options;
use linecarve_sequence::LiveSequence;

/// The front end of a live session and the map of its estimates.
pub(super) struct SemiDenseMapper {
    /// `None` after the end of the session.
    pub(super) front_end: Option<SemiDenseFrontEnd>,
    pub(super) mapper: Mapper,
    pub(super) source: SemiDenseSource,
}

impl SemiDenseMapper {
    /// An empty map.
    pub(super) fn begin(
        options: &Options,
        live: &LiveSequence,
        median_depth: f64,
        origin: Vector3<f64>,
    ) -> Result<Self, SessionError> {
        let source = SemiDenseSource {
            options: options.semi_dense,
            median_depth,
        };
        let mut map = empty_map(options, live, source)?;
        map.keep_measurements();
        let mut mapper = Mapper::new(map, origin);
        mapper.follow_surface();
        Ok(Self {
            front_end: Some(SemiDenseFrontEnd::live(
                &source,
                options.extract(median_depth),
            )?),
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
                keyframes.set_final(index, update.keyframe);
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
    match keyframe {
        Keyframe::Lines(keyframe) => Some(keyframe.frame),
        Keyframe::Features(_) | Keyframe::Views(_) => None,
    }
}

/// A map without keyframes.
pub(super) fn empty_map(
    options: &Options,
    live: &LiveSequence,
    source: SemiDenseSource,
) -> Result<Map, SessionError> {
    let depth = DepthSource::SemiDense(Box::new(source));
    let camera = live.sequence().color_camera();
    Ok(Map::of_lines(options, camera, &depth, source.median_depth)?)
}
