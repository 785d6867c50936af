//! Readers and keyframe selection on recorded data, found through the environment variable `LINECARVE_DATA`.
// Helpers of tests stand outside of test functions, where the lints would otherwise apply.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::PathBuf;

use linecarve_sequence::{
    InspectOptions, KeyframeOptions, OpenOptions, Sequence, inspect, select_keyframes,
};

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

fn chosen(sequence: &Sequence, options: &KeyframeOptions) -> Vec<usize> {
    let few = InspectOptions {
        samples: 9,
        gaps: Vec::new(),
        ..InspectOptions::default()
    };
    let facts = inspect(sequence, &few).unwrap();
    let [_, median_depth, _] = facts.depth.unwrap().percentiles.unwrap();
    let mut last = 0;
    let chosen = select_keyframes(sequence, options, median_depth, |done| last = done).unwrap();
    assert_eq!(last, sequence.frames().len());
    chosen
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
        let metric = KeyframeOptions {
            translation: Some(0.15),
            rotation_degrees: 10.0,
            sharpness_window: 1,
            ..KeyframeOptions::default()
        };
        assert_eq!(chosen(&sequence, &metric).len(), expected, "{name}");
    }
}

#[test]
fn default_motion_knows_no_metre_and_lands_nearby() {
    for (name, expected) in [("seven-scenes", 48), ("livingroom-synthetic", 18)] {
        let Some(sequence) = open(name) else { continue };
        for sharpness_window in [1, 3] {
            let options = KeyframeOptions {
                sharpness_window,
                ..KeyframeOptions::default()
            };
            let keyframes = chosen(&sequence, &options);
            let found = keyframes.len();
            assert!(found.abs_diff(expected) * 5 <= expected, "{name}: {found}");
        }
    }
}

/// The published residuals of these files: median |dz| of 9.5 mm at a gap of 30 recorded frames, of which every third
/// is here, and 314 mm with the inverse poses; 3.1 mm at a gap of 30 frames of the other, of which every fourth is here.
#[test]
fn depth_agrees_under_the_poses_and_not_under_their_inverse() {
    if let Some(sequence) = open("seven-scenes") {
        let facts = inspect(&sequence, &InspectOptions::default()).unwrap();
        println!("{facts:#?}");
        // 7.4 m over all recorded frames, whose jitter every third one leaves out.
        assert!((6.7..7.4).contains(&facts.motion.path_length));
        let depth = facts.depth.unwrap();
        assert!((depth.mean_coverage - 0.89).abs() < 0.02);
        let far = &facts.consistency[1];
        assert!((0.008..0.012).contains(&far.as_read.median_difference));
        let inverse = far
            .others
            .iter()
            .find(|other| other.reading == "the inverse poses (camera from world)")
            .unwrap();
        assert!((0.25..0.38).contains(&inverse.median_difference));
        assert!(facts.warnings.is_empty(), "{:?}", facts.warnings);
    }
    if let Some(sequence) = open("livingroom-synthetic") {
        let options = InspectOptions {
            gaps: vec![1, 7],
            ..InspectOptions::default()
        };
        let facts = inspect(&sequence, &options).unwrap();
        println!("{facts:#?}");
        assert!((0.002..0.005).contains(&facts.consistency[1].as_read.median_difference));
        assert!(facts.warnings.is_empty(), "{:?}", facts.warnings);
    }
}

/// The published figures: 4.50 px from colour edges if depth is taken as registered, 2.31 px with the estimated cameras.
#[test]
fn depth_that_is_not_registered_is_suspected() {
    let options = InspectOptions {
        samples: 1,
        pairs: 1,
        ..InspectOptions::default()
    };
    for (name, is_right) in [
        ("seven-scenes", true),
        ("livingroom-synthetic", true),
        ("seven-scenes", false),
    ] {
        let Some(folder) = data(name) else { return };
        let taken_as_registered = tempfile::NamedTempFile::new().unwrap();
        let calibration = (!is_right).then(|| taken_as_registered.path().to_owned());
        let sequence = Sequence::open(
            &folder,
            &OpenOptions {
                calibration,
                ..OpenOptions::default()
            },
        )
        .unwrap();
        let facts = inspect(&sequence, &options).unwrap();
        println!("{name}: {:?}", facts.registration);
        let is_suspected = facts
            .warnings
            .iter()
            .any(|warning| warning.what.contains("not registered"));
        assert_eq!(is_suspected, !is_right, "{name}: {:?}", facts.registration);
    }
}
