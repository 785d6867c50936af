//! Readers and keyframe selection on recorded data, found through the environment variable `LINECARVE_DATA`.
// Helpers of tests stand outside of test functions, where the lints would otherwise apply.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::PathBuf;

use linecarve::keyframes::{KeyframeOptions, MotionOptions, Selection, Translation, select};
use linecarve::sequence::{OpenOptions, Sequence};

fn data(name: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("LINECARVE_DATA") else {
        println!("skipped: LINECARVE_DATA is not set");
        return None;
    };
    let folder = PathBuf::from(root).join(name);
    if !folder.is_dir() {
        println!("skipped: {} is not there", folder.display());
        return None;
    }
    Some(folder)
}

fn open(name: &str) -> Option<Sequence> {
    data(name).map(|folder| Sequence::open(&folder, &OpenOptions::default()).unwrap())
}

fn count(sequence: &Sequence, motion: MotionOptions) -> usize {
    let options = KeyframeOptions {
        selection: Selection::Motion(motion),
        max_count: None,
    };
    let mut last = (0, 0);
    let chosen = select(sequence, &options, &mut |done, total| last = (done, total)).unwrap();
    assert_eq!(last, (sequence.frames().len(), sequence.frames().len()));
    assert!(chosen.warnings.is_empty());
    chosen.keyframes.len()
}

fn metric() -> MotionOptions {
    MotionOptions {
        translation: Translation::Absolute(0.15),
        rotation_deg: 10.0,
        sharpness_window: 1,
        ..MotionOptions::default()
    }
}

#[test]
fn seven_scenes_is_read_with_its_sidecar() {
    let Some(sequence) = open("seven-scenes") else {
        return;
    };
    assert_eq!(sequence.layout(), "7-scenes");
    assert_eq!(sequence.frames().len(), 334);
    assert!(sequence.warnings().is_empty(), "{:?}", sequence.warnings());
    assert_eq!(sequence.color_camera().fx(), 525.8);
    let depth = sequence.depth_calibration().unwrap();
    assert!(!depth.registered);
    assert_eq!((depth.camera.fx(), depth.scale), (585.0, 1000.0));
    // The pose file is of the depth camera; the colour camera lies 30 mm to its right.
    let world_from_depth = sequence.frames()[0].world_from_camera * depth.color_from_depth;
    let stored = [-3.404_563_4e-1, 1.646_981_8e-2, 2.965_691_7e-1];
    let found = world_from_depth.translation.vector;
    assert!(
        (0..3).all(|i| (found[i] - stored[i]).abs() < 1e-12),
        "{found}"
    );
    let offset = depth.color_from_depth.inverse() * nalgebra::Point3::origin();
    assert!((offset.coords - nalgebra::Vector3::new(0.0304, -0.0068, 0.0)).norm() < 1e-12);

    let image = sequence.load_gray(0).unwrap();
    assert_eq!((image.width(), image.height()), (640, 480));
    let depth = sequence.load_depth(0).unwrap().unwrap();
    let known = depth.samples().iter().filter(|&&z| z > 0.0).count();
    assert!(known > 640 * 480 * 7 / 10);
    assert!(depth.samples().iter().all(|&z| (0.0..10.0).contains(&z)));
}

#[test]
fn livingroom_joins_images_and_poses_by_number() {
    let Some(sequence) = open("livingroom-synthetic") else {
        return;
    };
    assert_eq!(sequence.layout(), "open3d-log");
    assert_eq!(sequence.frames().len(), 53);
    assert!(sequence.warnings().is_empty(), "{:?}", sequence.warnings());
    assert_eq!(sequence.color_camera().cx(), 319.5);
    assert!(sequence.depth_calibration().unwrap().registered);
    assert_eq!(sequence.frames()[1].name, "00004");
    assert_eq!(sequence.frames()[1].timestamp_ns, 4);
    assert!(sequence.load_depth(52).unwrap().is_some());
}

#[test]
fn fixed_motion_gives_the_known_keyframes() {
    for (name, expected) in [("seven-scenes", 48), ("livingroom-synthetic", 18)] {
        let Some(sequence) = open(name) else { continue };
        assert_eq!(count(&sequence, metric()), expected, "{name}");
    }
}

#[test]
fn default_motion_knows_no_metre_and_lands_nearby() {
    for (name, expected) in [("seven-scenes", 48), ("livingroom-synthetic", 18)] {
        let Some(sequence) = open(name) else { continue };
        for window in 1..=5 {
            let motion = MotionOptions {
                sharpness_window: window,
                ..MotionOptions::default()
            };
            let options = KeyframeOptions {
                selection: Selection::Motion(motion),
                max_count: None,
            };
            let chosen = select(&sequence, &options, &mut |_, _| {})
                .unwrap()
                .keyframes;
            let mean = chosen
                .iter()
                .filter_map(|k| k.relative_sharpness)
                .sum::<f64>()
                / chosen.len() as f64;
            let least = chosen
                .iter()
                .filter_map(|k| k.relative_sharpness)
                .fold(9.0, f64::min);
            println!(
                "{name} window {window}: {} keyframes, relative sharpness mean {mean:.3} least {least:.3}",
                chosen.len()
            );
        }
        let found = count(&sequence, MotionOptions::default());
        assert!(found.abs_diff(expected) * 5 <= expected, "{name}: {found}");
    }
}
