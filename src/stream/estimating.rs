//! The estimates of keyframes whose depth comes from each other, and the map of what there is of them.

use nalgebra::Vector3;

use super::SessionError;
use crate::pipeline::{
    Arrival, BackEnd, DepthSource, Keyframe, Options, SemiDenseFrontEnd, SemiDenseSource,
};
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
    pub(super) map: BackEnd,
    pub(super) source: SemiDenseSource,
    /// Taken off all coordinates.
    pub(super) origin: Vector3<f64>,
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
            map: empty_map(options, live, source)?,
            source,
            origin,
        })
    }

    /// Puts what the front end hands on into map and members; keyframe `id` was the reason. After an error the map is not to be
    /// used any further.
    pub(super) fn take(
        &mut self,
        id: u64,
        arrival: Arrival,
        members: &mut [Member],
    ) -> Result<(), SessionError> {
        let (mut keyframe, is_last) = match arrival {
            Arrival::First { keyframe, .. } => (keyframe, false),
            Arrival::Last(Ok(keyframe)) => (keyframe, true),
            Arrival::Last(Err(source)) => return Err(SessionError::FrontEnd { id, source }),
        };
        // Those that wait are among the newest.
        let mut newest_first = members.iter_mut().rev();
        let Some(member) = newest_first.find(|member| member.frame == keyframe.frame) else {
            return Ok(());
        };
        keyframe.world_from_camera.translation.vector -= self.origin;
        member.estimate = Some(if is_last {
            self.map.push(&keyframe)?;
            Estimate::Last(keyframe)
        } else {
            self.map.push_provisional(&keyframe)?;
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
        let mut map = empty_map(options, live, self.source)?;
        for member in members {
            if let Some(Estimate::Last(keyframe)) = &member.estimate {
                map.push(keyframe)?;
            }
        }
        for member in members {
            if let Some(Estimate::First(keyframe)) = &member.estimate {
                map.push_provisional(keyframe)?;
            }
        }
        self.map = map;
        Ok(())
    }
}

pub(super) fn empty_map(
    options: &Options,
    live: &LiveSequence,
    source: SemiDenseSource,
) -> Result<BackEnd, SessionError> {
    let noise = DepthSource::SemiDense(source).noise();
    let camera = live.sequence().color_camera();
    Ok(BackEnd::new(options, camera, noise, source.median_depth)?)
}
