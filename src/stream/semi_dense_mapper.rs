//! Incremental semi-dense depth and the map made from it.

use nalgebra::Vector3;

use super::SessionError;
use crate::front_end::{Arrival, DepthSource, Keyframe, SemiDenseFrontEnd, SemiDenseSource};
use crate::map::Map;
use crate::mapper::Mapper;
use crate::options::Options;
use linecarve_sequence::LiveSequence;

/// A keyframe of the session.
pub(super) struct SessionKeyframe {
    pub(super) id: u64,
    /// Position in the sequence.
    pub(super) frame: usize,
    pub(super) estimate: Option<Estimate>,
}

/// The latest estimate of a keyframe; its pose is in the frame of computation.
pub(super) enum Estimate {
    Provisional(Keyframe),
    Final(Keyframe),
}

impl Estimate {
    pub(super) fn keyframe_mut(&mut self) -> &mut Keyframe {
        match self {
            Self::Provisional(keyframe) | Self::Final(keyframe) => keyframe,
        }
    }
}

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
        let mut mapper = Mapper::new(empty_map(options, live, source)?, origin);
        mapper.follow_surface();
        Ok(Self {
            front_end: Some(SemiDenseFrontEnd::live(&source, options.extract())?),
            mapper,
            source,
        })
    }

    /// Adds a result of the front end to the map and its keyframe; errors name keyframe `id`. The map must not be used after
    /// an error.
    pub(super) fn add_arrival(
        &mut self,
        id: u64,
        (number, arrival): (usize, Arrival),
        keyframes: &mut [SessionKeyframe],
    ) -> Result<(), SessionError> {
        let (keyframe, is_final) = match &arrival {
            Arrival::Provisional { keyframe, .. } => (keyframe, false),
            Arrival::Final(Ok(keyframe)) => (keyframe, true),
            Arrival::Final(Err(_)) => {
                let Arrival::Final(Err(source)) = arrival else {
                    return Ok(());
                };
                return Err(SessionError::FrontEnd { id, source });
            }
        };
        // Keyframes with pending estimates are among the newest.
        let frame = frame_of(keyframe);
        let mut newest_first = keyframes.iter_mut().rev();
        let Some(session_keyframe) = newest_first.find(|other| Some(other.frame) == frame) else {
            return Ok(());
        };
        let mut keyframe = keyframe.clone();
        keyframe.translate(&-self.mapper.origin());
        self.mapper.take(number, arrival, false)?;
        session_keyframe.estimate = Some(if is_final {
            Estimate::Final(keyframe)
        } else {
            Estimate::Provisional(keyframe)
        });
        Ok(())
    }

    /// Rebuilds the map from the current estimates. On an error it is unchanged.
    pub(super) fn rebuild_map(
        &mut self,
        keyframes: &[SessionKeyframe],
        options: &Options,
        live: &LiveSequence,
    ) -> Result<(), SessionError> {
        let map = empty_map(options, live, self.source)?;
        let finals = keyframes
            .iter()
            .filter_map(|keyframe| match &keyframe.estimate {
                Some(Estimate::Final(keyframe)) => Some(keyframe),
                _ => None,
            });
        let provisional = keyframes
            .iter()
            .filter_map(|keyframe| match &keyframe.estimate {
                Some(Estimate::Provisional(keyframe)) => Some(keyframe),
                _ => None,
            });
        Ok(self.mapper.rebuild(map, finals, provisional)?)
    }
}

fn frame_of(keyframe: &Keyframe) -> Option<usize> {
    match keyframe {
        Keyframe::Lines(keyframe) => Some(keyframe.frame),
        Keyframe::Features(_) | Keyframe::Views(_) => None,
    }
}

pub(super) fn empty_map(
    options: &Options,
    live: &LiveSequence,
    source: SemiDenseSource,
) -> Result<Map, SessionError> {
    let depth = DepthSource::SemiDense(source);
    let camera = live.sequence().color_camera();
    Ok(Map::of_lines(options, camera, &depth, source.median_depth)?)
}
