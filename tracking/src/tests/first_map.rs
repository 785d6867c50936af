//! The first map of one camera whose frames are answered as they come.

use super::*;

fn live_tracker(looks_ahead: bool) -> Tracker {
    let options = TrackingOptions {
        starts_early: true,
        looks_ahead,
        ..one_camera()
    };
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap()
}

const WAITING: FrameOutcome = FrameOutcome::Lost(NoPose::Waiting);

#[test]
fn frames_wait_for_a_map_and_get_their_poses_with_it() {
    for looks_ahead in [false, true] {
        let mut tracker = live_tracker(looks_ahead);
        let mut first = None;
        for number in 0..24 {
            let outcome = tracker.track(relief(number));
            if outcome == WAITING {
                assert!(first.is_none(), "frame {number}");
                assert_eq!(tracker.waiting(), number + 1);
                assert_eq!(tracker.current_pose(0), None);
                assert_eq!(tracker.scene_depth(), None);
                continue;
            }
            let first = *first.get_or_insert(number);
            let is_tracked = matches!(outcome, FrameOutcome::Tracked { submap: 0, .. });
            assert!(is_tracked, "frame {number}: {outcome:?}");
            assert_eq!(tracker.waiting(), 0);
            for earlier in 0..=first as u32 {
                assert!(tracker.current_pose(earlier).is_some(), "{earlier}");
            }
            tracker.map.check().unwrap();
        }
        let first = first.expect("24 frames start a map");
        assert!((5..20).contains(&first), "{first}");
        let depth = tracker.scene_depth().unwrap();
        assert!((0.7..1.4).contains(&depth), "{depth}");
        let found = tracker.finish();
        for (number, pose) in found.poses.iter().enumerate() {
            // Poses that later frames give are none of a live system.
            let is_late = !looks_ahead && number < first;
            let waited = *pose == FramePose::Unknown(NoPose::Waiting);
            assert_eq!(waited, is_late, "frame {number}: {pose:?}");
            assert_eq!(place(pose).is_some(), !is_late);
        }
    }
}

#[test]
fn a_recording_that_ends_before_the_map_starts_ends_as_one_that_was_there_from_the_beginning() {
    let mut live = live_tracker(true);
    let mut causal = live_tracker(false);
    let camera = Camera::pinhole(200.0, 200.0, 159.5, 119.5).unwrap();
    let options = one_camera();
    let mut recorded = Tracker::new(options, &camera, WIDTH, HEIGHT).unwrap();
    for number in 0..10 {
        assert_eq!(live.track(relief(number)), WAITING);
        causal.track(relief(number));
        recorded.track(relief(number));
    }
    let found = live.finish();
    assert_eq!(found.submaps.len(), 1);
    // Its keyframes are made after the last frame.
    let times = found.times;
    assert!(times.keyframes_ms > 0.0 && times.keyframes_ms <= times.total_ms);
    assert_eq!(found.poses, recorded.finish().poses);
    let none = FramePose::Unknown(NoPose::NoStart);
    assert_eq!(causal.finish().poses, [none; 10]);
}

#[test]
fn a_bounded_number_of_frames_waits() {
    let mut tracker = live_tracker(true);
    for number in 0..210 {
        assert_eq!(tracker.track(covered()), WAITING, "frame {number}");
        assert!(tracker.waiting() < 200);
    }
    // What comes then can still start a map.
    let mut outcome = WAITING;
    let mut number = 0;
    while outcome == WAITING && number < 40 {
        outcome = tracker.track(relief(number));
        number += 1;
    }
    assert!(matches!(outcome, FrameOutcome::Tracked { .. }));
    assert_eq!(tracker.current_pose(5), None);
}

#[test]
fn turning_starts_no_map() {
    let mut tracker = live_tracker(true);
    for number in 0..20 {
        assert_eq!(tracker.track(turned(number)), WAITING, "frame {number}");
    }
}
