//! The engine as a library: keyframe by keyframe, all at once, and with corrected poses.

use std::path::Path;

use crate::program::small_sequence;
use linecarve::run::CancelToken;
use linecarve::{Input, Options, Reconstruction, Recording, RunOptions, SourceChoice};
use nalgebra::Vector3;

const FRAMES: usize = 6;

fn recording(path: &Path, source: SourceChoice) -> Recording {
    let mut input = Input::from(path);
    input.source = source;
    input.selection.every = Some(1);
    Recording::open(&input, Options::default()).expect("a sequence of this program")
}

fn begin(recording: Recording) -> Reconstruction {
    let mut run = RunOptions::default();
    run.keeps_keyframes = true;
    Reconstruction::new(recording, run).expect("default options are in range")
}

#[test]
fn a_run_goes_on_where_single_steps_ended() {
    let folder = small_sequence(FRAMES, "tum");
    let path = folder.path().join("sequence");
    let mut whole = begin(recording(&path, SourceChoice::Auto));
    whole.run(CancelToken::default(), &mut []).expect("a run");
    for steps in [1, 3, FRAMES] {
        let mut stepped = begin(recording(&path, SourceChoice::Auto));
        for _ in 0..steps {
            assert!(stepped.advance().expect("a step").is_some());
        }
        stepped.run(CancelToken::default(), &mut []).expect("a run");
        assert_eq!(stepped.numbers(), whole.numbers());
        assert!(stepped.surface() == whole.surface(), "after {steps} steps");
    }
    assert!(!whole.surface().is_empty());
}

#[test]
fn carving_once_gives_the_same_surface() {
    let folder = small_sequence(FRAMES, "tum");
    let path = folder.path().join("sequence");
    for (source, least_measured_share) in [
        (SourceChoice::MapPoints, 0.3),
        (SourceChoice::Auto, 0.0),
        (SourceChoice::Auto, 0.3),
    ] {
        let finished = |is_at_once| {
            let mut recording = recording(&path, source);
            recording.options.surface.least_measured_share = least_measured_share;
            let mut run = RunOptions::default();
            run.is_at_once = is_at_once;
            let mut run = Reconstruction::new(recording, run).expect("options in range");
            run.run(CancelToken::default(), &mut []).expect("a run");
            run
        };
        let [each, once] = [false, true].map(finished);
        assert!(!each.surface().is_empty());
        assert!(each.surface() == once.surface(), "{source:?}");
        assert!(once.map().carver().is_deferred());
        assert!(once.map().final_carving().is_some());
        let points = [&each, &once].map(|run| run.map().carver().point_count());
        assert_eq!(points[1], points[0]);
    }
}

#[test]
fn corrected_poses_give_the_map_of_a_run_over_them() {
    let folder = small_sequence(FRAMES, "tum");
    let path = folder.path().join("sequence");
    for source in [SourceChoice::Auto, SourceChoice::MapPoints] {
        let mut moved = recording(&path, source);
        let mut poses = Vec::new();
        for number in [1, 4] {
            let mut pose = moved.sequence.frames()[number].world_from_camera;
            pose.translation.vector += Vector3::new(0.01, -0.005, 0.004);
            poses.push((number, pose));
        }
        moved.sequence.set_poses(poses.iter().copied());
        let mut expected = begin(moved);
        expected
            .run(CancelToken::default(), &mut [])
            .expect("a run");
        let mut corrected = begin(recording(&path, source));
        corrected
            .run(CancelToken::default(), &mut [])
            .expect("a run");
        assert!(corrected.surface() != expected.surface());
        corrected.correct_poses(&poses).expect("poses in range");
        assert!(corrected.surface() == expected.surface(), "{source:?}");
    }
}
