//! Pose correction from images before depth is estimated: wrong poses are corrected, exact poses stay.

use std::path::Path;

use crate::program::{distort, expect_status, stderr};
use linecarve::Options;
use linecarve::front_end::{ImagePoses, correct_poses};
use linecarve_lines::camera::Camera;
use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use tempfile::TempDir;

const KEYFRAMES: usize = 10;

/// The first images of the sample in a folder of their own, with poses that `change` makes of the true ones.
fn sample(change: impl Fn(usize, Isometry3<f64>) -> Isometry3<f64>) -> TempDir {
    sample_of(KEYFRAMES, change)
}

fn sample_of(
    keyframes: usize,
    change: impl Fn(usize, Isometry3<f64>) -> Isometry3<f64>,
) -> TempDir {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let sequence = Sequence::open(&sample, &OpenOptions::default()).expect("a whole sample");
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(folder.path().join("rgb")).expect("a writable folder");
    let (mut images, mut poses) = (String::new(), String::new());
    for (index, frame) in sequence.frames().iter().take(keyframes).enumerate() {
        let name = format!("rgb/{index}.jpg");
        std::fs::copy(&frame.color, folder.path().join(&name)).expect("a whole sample");
        images += &format!("{index} {name}\n");
        let pose = change(index, frame.world_from_camera);
        let (t, q) = (pose.translation.vector, pose.rotation);
        poses += &format!(
            "{index} {} {} {} {} {} {} {}\n",
            t.x, t.y, t.z, q.i, q.j, q.k, q.w
        );
    }
    let camera = sequence.color_camera();
    let calibration = format!(
        "[color]\nmodel = \"pinhole\"\nfx = {}\nfy = {}\ncx = {}\ncy = {}\n",
        camera.fx(),
        camera.fy(),
        camera.cx(),
        camera.cy()
    );
    for (name, text) in [
        ("rgb.txt", images),
        ("groundtruth.txt", poses),
        ("linecarve.toml", calibration),
    ] {
        std::fs::write(folder.path().join(name), text).expect("a writable folder");
    }
    folder
}

/// Errors of some six pixels in direction and a centimetre in place, other ones for each keyframe.
fn disturbed(index: usize, pose: Isometry3<f64>) -> Isometry3<f64> {
    let wave = |phase: f64| (2.4 * index as f64 + phase).sin();
    let turn = 0.008 * Vector3::new(wave(0.0), wave(1.3), wave(2.9));
    let shift = 0.01 * Vector3::new(wave(0.7), wave(2.1), wave(3.8));
    pose * Isometry3::from_parts(
        Translation3::from(shift),
        UnitQuaternion::from_scaled_axis(turn),
    )
}

fn open(folder: &TempDir) -> Sequence {
    Sequence::open(folder.path(), &OpenOptions::default()).expect("a whole sequence")
}

fn correct(sequence: &Sequence) -> ImagePoses {
    let frames: Vec<usize> = (0..KEYFRAMES).collect();
    correct_poses(sequence, &frames, &Options::default(), || {}).expect("images are there")
}

fn poses(sequence: &Sequence) -> Vec<Isometry3<f64>> {
    let frames = sequence.frames().iter();
    frames.map(|frame| frame.world_from_camera).collect()
}

/// Root mean square of what the direction from each keyframe to the next is wrong by.
fn error_rad(poses: &[Isometry3<f64>], truth: &[Isometry3<f64>]) -> f64 {
    let step = |poses: &[Isometry3<f64>], at: usize| poses[at].inverse() * poses[at + 1];
    let squares = (0..poses.len() - 1).map(|at| {
        let error = step(poses, at).inverse() * step(truth, at);
        error.rotation.angle().powi(2)
    });
    (squares.sum::<f64>() / (poses.len() - 1) as f64).sqrt()
}

#[test]
fn exact_poses_stay() {
    let folder = sample(|_, pose| pose);
    let sequence = open(&folder);
    let corrected = correct(&sequence);
    assert!(!corrected.summary.is_corrected, "{:?}", corrected.summary);
    assert_eq!(corrected.summary.keyframes, KEYFRAMES);
    assert_eq!(corrected.fitted, poses(&sequence));
    assert_eq!(corrected.placed, corrected.fitted);
}

#[test]
fn disturbed_poses_are_brought_back() {
    let truth = poses(&open(&sample(|_, pose| pose)));
    let folder = sample(disturbed);
    let sequence = open(&folder);
    let corrected = correct(&sequence);
    let summary = corrected.summary;
    assert!(summary.is_corrected && summary.turn_px > 2.0, "{summary:?}");
    assert!(summary.points > 100 && summary.reprojection_rms_px < 1.5);
    let before = error_rad(&poses(&sequence), &truth);
    let after = error_rad(&corrected.fitted, &truth);
    assert!(before > 0.008 && after < 0.35 * before, "{before} {after}");
}

#[test]
fn a_keyframe_without_an_image_keeps_its_pose() {
    let folder = sample(disturbed);
    std::fs::write(folder.path().join("rgb/4.jpg"), b"no image").expect("a writable folder");
    let sequence = open(&folder);
    let corrected = correct(&sequence);
    assert!(corrected.summary.is_corrected);
    assert_eq!(corrected.summary.keyframes, KEYFRAMES - 1);
    let given = poses(&sequence);
    for (number, pose) in corrected.fitted.iter().enumerate() {
        assert_eq!(*pose == given[number], number == 4, "keyframe {number}");
    }
}

#[test]
fn a_run_says_what_it_corrected_unless_it_is_told_not_to() {
    let folder = sample(disturbed);
    let out = folder.path().join("out");
    let config = folder.path().join("config.toml");
    let run = |more: &[&str]| {
        let mut arguments: Vec<&str> = [
            "reconstruct",
            folder.path().to_str().expect("temporary paths are UTF-8"),
            "--depth",
            "semi-dense",
            "--every",
            "1",
            "--final-only",
            "--no-page",
            "--no-picture",
            "--out",
            out.to_str().expect("temporary paths are UTF-8"),
        ]
        .to_vec();
        arguments.extend(more);
        let said = stderr(&expect_status(0, arguments));
        let report = std::fs::read(out.join("report.json")).expect("a report");
        let report: serde_json::Value = serde_json::from_slice(&report).expect("JSON");
        (said, report["sequence"]["poses"].clone())
    };
    let (said, told) = run(&[]);
    assert!(said.contains("disagree with the poses of 10"), "{said}");
    assert_eq!(told["is_corrected"], true);
    let written = std::fs::read_to_string(out.join("poses.txt")).expect("poses");
    assert_eq!(written.lines().count(), KEYFRAMES + 1, "{written}");

    std::fs::remove_file(out.join("poses.txt")).expect("a writable folder");
    std::fs::write(&config, "[pose_correction]\nenabled = false\n").expect("a writable folder");
    let (said, told) = run(&["--config", config.to_str().expect("UTF-8")]);
    assert!(!said.contains("disagree"), "{said}");
    assert!(told.is_null());
    assert!(!out.join("poses.txt").exists());
}

/// The comparison of sixteen images with their poses.
fn compare(sequence: &Sequence) -> ImagePoses {
    let frames: Vec<usize> = (0..16).collect();
    correct_poses(sequence, &frames, &Options::default(), || {}).expect("images are there")
}

#[test]
fn a_lens_that_the_calibration_leaves_out_is_found_and_taken_out() {
    let folder = sample_of(16, |_, pose| pose);
    let mut sequence = open(&folder);
    for frame in sequence.frames() {
        distort(&frame.color, sequence.color_camera(), -0.09);
    }
    assert!(!sequence.has_known_distortion());
    let found = compare(&sequence);
    let correction = found.summary.camera.expect("a lens");
    let at_corner = correction.k1 * 0.25 + correction.k2 * 0.0625;
    assert!((at_corner + 0.0225).abs() < 0.004, "{correction:?}");
    assert!(
        (correction.focal_factor - 1.0).abs() < 0.003,
        "{correction:?}"
    );
    assert!(!found.summary.is_corrected, "{:?}", found.summary);
    assert_eq!(found.fitted, poses(&sequence));

    let pinhole = sequence.color_camera().clone();
    sequence.correct_color_camera(&correction).expect("a lens");
    assert!(sequence.has_known_distortion() && sequence.color_camera().is_pinhole());
    assert_ne!(*sequence.color_camera(), pinhole);
    let again = compare(&sequence).summary;
    assert!(again.camera.is_none() && !again.is_corrected, "{again:?}");
    assert!(again.reprojection_rms_px < 1.3, "{again:?}");
}

#[test]
fn a_wrong_camera_under_good_poses_is_recognised() {
    let folder = sample_of(16, |_, pose| pose);
    let mut sequence = open(&folder);
    let exact = compare(&sequence).summary;
    assert!(exact.camera.is_none() && !exact.is_corrected, "{exact:?}");
    let true_camera = sequence.stored_color_camera().clone();
    let true_numbers = numbers(&true_camera);
    for (focal, aspect, shift_px) in [(0.98, 1.0, 0.0), (1.03, 1.0, 0.0), (1.0, 1.02, 6.0)] {
        let wrong = Camera::pinhole(
            true_numbers[0] * focal * aspect,
            true_numbers[1] * focal,
            true_numbers[2] + shift_px,
            true_numbers[3] - shift_px,
        );
        let wrong = wrong.expect("a camera");
        sequence
            .set_stored_color_camera(wrong.clone())
            .expect("a camera");
        let found = compare(&sequence).summary;
        assert!(!found.is_corrected, "{found:?}");
        let correction = found.camera.expect("another camera");
        let corrected = correction.applied_to(&wrong).expect("a camera");
        for (found, expected) in numbers(&corrected).into_iter().zip(true_numbers) {
            assert!((found - expected).abs() < 2.0, "{corrected:?}");
        }
        let held_back = found.held_back.expect("enough matches");
        assert!(held_back.given < 1.03 * held_back.poses, "{held_back:?}");
    }
}

/// Focal lengths and principal point.
fn numbers(camera: &Camera) -> [f64; 4] {
    [camera.fx(), camera.fy(), camera.cx(), camera.cy()]
}

#[test]
fn wrong_poses_do_not_look_like_a_wrong_camera() {
    let folder = sample_of(16, disturbed);
    let found = compare(&open(&folder)).summary;
    assert!(found.is_corrected && found.camera.is_none(), "{found:?}");
    let held_back = found.held_back.expect("enough matches");
    let camera = held_back.camera.expect("a camera without calibrated lens");
    assert!(held_back.poses < 0.8 * camera && camera <= held_back.given);
}

#[test]
fn small_errors_of_poses_are_told_from_the_noise_of_matches() {
    // A tenth of the errors above: half a pixel.
    let truth = poses(&open(&sample_of(16, |_, pose| pose)));
    let folder = sample_of(16, |index, pose| {
        let away = pose.inverse() * disturbed(index, pose);
        pose * Isometry3::from_parts(
            Translation3::from(0.1 * away.translation.vector),
            UnitQuaternion::from_scaled_axis(0.1 * away.rotation.scaled_axis()),
        )
    });
    let sequence = open(&folder);
    let found = compare(&sequence);
    assert!(found.summary.is_corrected, "{:?}", found.summary);
    let before = error_rad(&poses(&sequence), &truth);
    let after = error_rad(&found.fitted, &truth);
    assert!(after < before, "{before} {after}");
}
