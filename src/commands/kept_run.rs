//! Runs that can be resumed after they were killed.

use crate::pipeline::Options;
use linecarve_sequence::Sequence;

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
