//! Tracking that was interrupted goes on to the same poses, or is refused.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::Duration;

use linecarve::run::RunDescription;
use linecarve::tracking::{
    TrackedSequence, TrackingCheckpoint, TrackingMode, track_watched, tracking_description,
};
use linecarve_sequence::{OpenOptions, Sequence};

const FRAMES: usize = 24;
const INTERRUPTED_AT: usize = 17;

fn room() -> Sequence {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let mut room = Sequence::open(&folder, &OpenOptions::default()).unwrap();
    let first: Vec<usize> = (0..FRAMES).collect();
    room.retain_frames(&first);
    room
}

fn description(room: &Sequence) -> RunDescription {
    tracking_description(room, TrackingMode::Rgbd, &TrackingMode::Rgbd.options())
}

fn track(
    room: &Sequence,
    checkpoint: Option<&mut TrackingCheckpoint>,
    watched: &mut dyn FnMut(usize),
) -> TrackedSequence {
    let mode = TrackingMode::Rgbd;
    let mut watch = |done: &linecarve::tracking::FrameDone<'_>| watched(done.number);
    let silent = Default::default();
    track_watched(
        room,
        mode,
        mode.options(),
        0.01,
        &silent,
        &mut watch,
        checkpoint,
    )
    .unwrap()
}

fn open(
    out: &Path,
    description: RunDescription,
    resume: bool,
) -> Result<TrackingCheckpoint, String> {
    let opened = TrackingCheckpoint::open(out, description, Duration::ZERO, resume);
    opened.map_err(|error| error.to_string())
}

#[test]
fn tracking_that_was_interrupted_goes_on_to_the_same_poses() {
    let (room, out) = (room(), tempfile::tempdir().unwrap());
    let nothing = open(out.path(), description(&room), true).unwrap_err();
    assert!(nothing.contains("leave out --resume"), "{nothing}");

    let whole = track(&room, None, &mut |_| {});
    let mut checkpoint = open(out.path(), description(&room), false).unwrap();
    let killed = catch_unwind(AssertUnwindSafe(|| {
        let mut until = |number| assert!(number != INTERRUPTED_AT, "killed");
        track(&room, Some(&mut checkpoint), &mut until)
    }));
    assert!(killed.is_err());

    // Another recording: an image less, other options, a changed file.
    let mut shorter = description(&room);
    shorter.files.pop();
    shorter.text = shorter.text.replace("features: 1000", "features: 900");
    let refused = open(out.path(), shorter, true).unwrap_err();
    assert!(refused.contains("features: 900"), "{refused}");
    let mut other = description(&room);
    other.files.push(PathBuf::from("other.png"));
    let refused = open(out.path(), other, true).unwrap_err();
    assert!(
        refused.contains("other.png was not part of it"),
        "{refused}"
    );

    let mut checkpoint = open(out.path(), description(&room), true).unwrap();
    let mut again = Vec::new();
    let resumed = track(&room, Some(&mut checkpoint), &mut |number| {
        again.push(number);
    });
    assert_eq!(checkpoint.resumed(), INTERRUPTED_AT);
    assert_eq!(again, (INTERRUPTED_AT..FRAMES).collect::<Vec<_>>());
    assert_eq!(resumed.recording.poses, whole.recording.poses);
    assert_eq!(
        resumed.recording.submaps[0].points,
        whole.recording.submaps[0].points
    );
    checkpoint.finish().unwrap();
    assert_eq!(std::fs::read_dir(out.path()).unwrap().count(), 0);
}
