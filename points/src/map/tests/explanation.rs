//! Wrong cameras and rolling shutters under exact poses.

use linecarve_lines::camera::Distortion;

use super::*;
use crate::rolling_shutter::camera_motion;

/// A map of a longer walk with images of distortion `k1` that are given as those of a pinhole.
fn through_a_lens(k1: f64, correction: PoseCorrectionOptions) -> PointMap {
    let distortion = Distortion::radial(k1);
    let lens = Camera::with_distortion(525.0, 525.0, 319.5, 239.5, distortion).unwrap();
    let mut room = Room::new(900);
    let mut follower = Follower::default();
    let mut map = PointMap::new(*map().options(), correction, &camera(), 640, 480).unwrap();
    for step in 0..14 {
        map.push(&walk(step), room.seen_through(&lens, &walk(step), 0.4));
        check_references(&map);
        follower.apply(map.changes());
    }
    map.adjust_all();
    follower.apply(map.changes());
    follower.check(&map);
    map
}

#[test]
fn a_lens_that_was_taken_for_none_is_found() {
    let found = through_a_lens(-0.07, PoseCorrectionOptions::default());
    let k1 = found.lens().correction().unwrap().k1;
    assert!((k1 + 0.07).abs() < 0.01, "{k1}");
    let kept = PoseCorrectionOptions {
        lens: false,
        ..PoseCorrectionOptions::default()
    };
    let missed = through_a_lens(-0.07, kept);
    assert_eq!(missed.lens().correction(), None);
    let (with, without) = (error_of_points(&found), error_of_points(&missed));
    assert!(with < 0.5 * without, "{without} {with}");
}

#[test]
fn a_pinhole_stays_one() {
    let map = through_a_lens(0.0, PoseCorrectionOptions::default());
    assert_eq!(map.lens().correction(), None);
}

/// A map of a walk whose rows are read one after the other, and how far its poses are from the given ones, which are those of the
/// middle rows.
fn with_rolling_shutter(readout: f64, is_motion_known: bool) -> (PointMap, f64) {
    let mut room = Room::new(900);
    let correction = PoseCorrectionOptions::default();
    let mut map = PointMap::new(*map().options(), correction, &camera(), 640, 480).unwrap();
    for step in 0..14 {
        let motion = camera_motion(&walk(step), &walk(step + 1), 1);
        let rolling = |in_camera: &Point3<f64>| {
            let mut pixel = camera().project(in_camera)?;
            for _ in 0..4 {
                let time = readout * ((pixel.y + 0.5) / 480.0 - 0.5);
                let part = |first| (time * motion.fixed_rows::<3>(first)).into_owned();
                pixel = camera().project(&(Isometry3::new(part(3), part(0)) * in_camera))?;
            }
            Some(pixel)
        };
        map.push(&walk(step), room.seen_by(&walk(step), 0.4, rolling));
        if is_motion_known {
            map.set_motion(step, motion);
        }
    }
    map.adjust_all();
    let changes = map
        .keyframes()
        .iter()
        .map(|keyframe| keyframe.pose.change());
    let moved = changes.map(|change| change.rotation_rad.max(change.translation));
    let moved = moved.fold(0.0, f64::max);
    (map, moved)
}

#[test]
fn a_rolling_shutter_is_not_taken_for_wrong_poses() {
    let (map, moved) = with_rolling_shutter(0.3, true);
    let readout = map.readout().unwrap();
    assert!((readout - 0.3).abs() < 0.03, "{readout}");
    assert!(moved < 1e-9 && !map.has_adjusted_poses(), "{moved}");
    let (map, moved) = with_rolling_shutter(0.3, false);
    assert_eq!(map.readout(), None);
    assert!(moved > 1e-3 && map.has_adjusted_poses(), "{moved}");
    assert_eq!(with_rolling_shutter(0.0, true).0.readout(), None);
}
