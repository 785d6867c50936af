//! Runs that can be resumed after they were killed.

use crate::checkpoint::{Checkpoint, CheckpointError, read_point_keyframe, write_point_keyframe};
use crate::files::WriteError;
use crate::map_points::MapPointOptions;
use crate::pipeline::{
    Keyframe, KeyframeStore, Options, PointFrontEndError, PointKeyframe, find_features,
};
use crate::sequence::Sequence;

/// What a run is, line by line: one that differs cannot go on with what another has stored.
pub(super) fn describe(
    from: &str,
    sequence: &Sequence,
    options: &Options,
    keyframes: &[usize],
) -> String {
    let folder = sequence.folder();
    let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let mut text = format!(
        "linecarve {}\nfrom {from}\nsequence {}\nlayout {}\n",
        env!("CARGO_PKG_VERSION"),
        folder.display(),
        sequence.layout()
    );
    // Parameters that TOML cannot hold do not exist; a run whose parameters are not told is another run.
    text += &toml::to_string(options).unwrap_or_default();
    for frame in keyframes {
        let frame = &sequence.frames()[*frame];
        let pose = frame.world_from_camera;
        let numbers: Vec<String> = pose
            .rotation
            .coords
            .iter()
            .chain(pose.translation.vector.iter())
            .map(ToString::to_string)
            .collect();
        text += &format!("keyframe {} at {}\n", frame.name, numbers.join(" "));
    }
    text
}

/// The features of a keyframe: as stored, or found and stored.
///
/// # Errors
/// When they cannot be stored. That they cannot be found is told inside.
pub(super) fn features(
    checkpoint: &Checkpoint,
    sequence: &Sequence,
    frames: &[usize],
    keyframe: usize,
    options: &MapPointOptions,
) -> Result<Result<PointKeyframe, PointFrontEndError>, CheckpointError> {
    let frame = frames[keyframe];
    let stored = checkpoint
        .load(keyframe)
        .and_then(|bytes| read_point_keyframe(&bytes).ok());
    if let Some(stored) = stored.filter(|stored| stored.frame == frame) {
        return Ok(Ok(stored));
    }
    let found = find_features(sequence, frame, options);
    if let Ok(found) = &found {
        checkpoint.store(keyframe, &write_point_keyframe(found))?;
    }
    Ok(found)
}

/// Keyframes with segments.
pub(super) struct KeptKeyframes<'a> {
    pub(super) checkpoint: &'a Checkpoint,
    /// Indices of the frames of the keyframes.
    pub(super) frames: &'a [usize],
}

impl KeyframeStore for KeptKeyframes<'_> {
    fn load(&self, keyframe: usize) -> Option<Keyframe> {
        let bytes = self.checkpoint.load(keyframe)?;
        let kept: Keyframe = rmp_serde::from_slice(&bytes).ok()?;
        (kept.frame == self.frames[keyframe]).then_some(kept)
    }

    fn store(&self, keyframe: usize, made: &Keyframe) -> Result<(), WriteError> {
        match rmp_serde::to_vec(made) {
            Ok(bytes) => self.checkpoint.store(keyframe, &bytes),
            // What has no bytes is made again by a run that goes on.
            Err(_) => Ok(()),
        }
    }
}
