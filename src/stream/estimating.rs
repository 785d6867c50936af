//! The estimates of keyframes whose depth comes from each other, and the map of what there is of them.

use nalgebra::Vector3;

use super::SessionError;
use crate::front_end::{Arrival, DepthSource, Keyframe, SemiDenseFrontEnd, SemiDenseSource};
use crate::map::Map;
use crate::mapper::Mapper;
use crate::options::Options;
use linecarve_sequence::LiveSequence;

/// A keyframe of the session.
pub(super) struct Member {
    pub(super) id: u64,
    /// Position in the sequence.
    pub(super) frame: usize,
    pub(super) estimate: Option<Estimate>,
}

/// What the front end made of a keyframe; the pose is that of the map, shifted.
pub(super) enum Estimate {
    First(Keyframe),
    Last(Keyframe),
}

impl Estimate {
    pub(super) fn keyframe_mut(&mut self) -> &mut Keyframe {
        match self {
            Self::First(keyframe) | Self::Last(keyframe) => keyframe,
        }
    }
}

/// Estimates under way, and the map of what there is of them.
pub(super) struct Estimating {
    /// `None` when the session is over.
    pub(super) front_end: Option<SemiDenseFrontEnd>,
    pub(super) mapper: Mapper,
    pub(super) source: SemiDenseSource,
}

impl Estimating {
    /// Estimates of nothing yet.
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
        Ok(Self {
            front_end: Some(SemiDenseFrontEnd::live(&source, options.extract())?),
            mapper: Mapper::new(empty_map(options, live, source)?, origin),
            source,
        })
    }

    /// Puts what the front end hands on into map and members; keyframe `id` was the reason. After an error the map is not to be
    /// used any further.
    pub(super) fn take(
        &mut self,
        id: u64,
        (number, arrival): (usize, Arrival),
        members: &mut [Member],
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
        // Those that wait are among the newest.
        let frame = frame_of(keyframe);
        let mut newest_first = members.iter_mut().rev();
        let Some(member) = newest_first.find(|member| Some(member.frame) == frame) else {
            return Ok(());
        };
        let mut keyframe = keyframe.clone();
        keyframe.translate(&-self.mapper.origin());
        self.mapper.take(number, arrival, false)?;
        member.estimate = Some(if is_final {
            Estimate::Last(keyframe)
        } else {
            Estimate::First(keyframe)
        });
        Ok(())
    }

    /// Makes the map anew of what there is of the members; when that fails, it stays as it is.
    pub(super) fn remake_map(
        &mut self,
        members: &[Member],
        options: &Options,
        live: &LiveSequence,
    ) -> Result<(), SessionError> {
        let map = empty_map(options, live, self.source)?;
        let final_ones = members.iter().filter_map(|member| match &member.estimate {
            Some(Estimate::Last(keyframe)) => Some(keyframe),
            _ => None,
        });
        let provisional = members.iter().filter_map(|member| match &member.estimate {
            Some(Estimate::First(keyframe)) => Some(keyframe),
            _ => None,
        });
        Ok(self.mapper.rebuild(map, final_ones, provisional)?)
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
    let noise = DepthSource::SemiDense(source).noise();
    let camera = live.sequence().color_camera();
    Ok(Map::of_lines(options, camera, noise, source.median_depth)?)
}
