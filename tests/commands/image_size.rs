//! Reduction of large images; those to whose pixels depth is registered keep their size.

use std::path::Path;

use crate::program::{expect_status, stderr};
use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::Point3;
use tempfile::TempDir;

fn sample() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/assets/room"))
}

fn open(folder: &Path) -> Sequence {
    Sequence::open(folder, &OpenOptions::default()).expect("a whole sample")
}

/// The sample without its depth images.
fn images_alone() -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    std::fs::create_dir(folder.path().join("rgb")).expect("a writable folder");
    for frame in open(sample()).frames() {
        let name = frame.color.file_name().expect("a file");
        std::fs::copy(&frame.color, folder.path().join("rgb").join(name)).expect("a whole sample");
    }
    for name in ["rgb.txt", "groundtruth.txt", "linecarve.toml"] {
        std::fs::copy(sample().join(name), folder.path().join(name)).expect("a whole sample");
    }
    folder
}

#[test]
fn images_and_camera_shrink_together() {
    let folder = images_alone();
    let mut sequence = open(folder.path());
    let (camera, image) = (
        sequence.color_camera().clone(),
        sequence.load_gray(3).expect("a whole image"),
    );
    assert!(sequence.limit_image_size(640).is_none());
    let [stored, loaded] = sequence.limit_image_size(300).expect("640 is more");
    assert_eq!((stored.width, stored.height), (640, 480));
    assert_eq!((loaded.width, loaded.height), (213, 160));
    assert_eq!(sequence.color_size(), loaded);

    let (gray, color) = sequence.load_gray_and_color(3).expect("a whole image");
    assert_eq!((gray.width(), gray.height()), (213, 160));
    assert_eq!((color.width(), color.height()), (213, 160));
    assert_eq!(gray, sequence.load_gray(3).expect("a whole image"));
    assert_eq!(color, sequence.load_color(3).expect("a whole image"));
    let point = Point3::new(0.3, -0.2, 2.0);
    let before = camera.project(&point).expect("in front");
    let after = sequence.color_camera().project(&point).expect("in front");
    assert!(((before.x + 0.5) / 3.0 - (after.x + 0.5)).abs() < 1e-9);
    let square = (0..9).map(|at| u32::from(image.row(30 + at / 3)[60 + at % 3]));
    assert_eq!(u32::from(gray.row(10)[20]), (square.sum::<u32>() + 4) / 9);

    assert!(sequence.limit_image_size(u32::MAX).is_none());
    assert_eq!(*sequence.color_camera(), camera);
}

#[test]
fn depth_images_keep_their_partners() {
    let mut sequence = open(sample());
    assert!(sequence.limit_image_size(100).is_none());
    assert_eq!(sequence.color_size().width, 640);
}

/// The pictures of a phone are larger than its depth, which has pixels of its own.
#[test]
fn images_shrink_beside_depth_of_another_size() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let stray = folder.path().join("stray");
    let path = |path: &Path| path.to_str().expect("temporary paths are UTF-8").to_owned();
    let written = ["convert", &path(sample()), "--to", "stray-scanner"];
    expect_status(0, written.into_iter().chain(["--out", &path(&stray)]));
    for entry in std::fs::read_dir(stray.join("depth")).expect("depth images") {
        let file = entry.expect("a depth image").path();
        let small = image::open(&file).expect("a depth image");
        let small = small.resize_exact(160, 120, image::imageops::FilterType::Nearest);
        small.save(file).expect("a writable folder");
    }
    let out = folder.path().join("out");
    let arguments = ["reconstruct", &path(&stray), "--max-keyframes", "6"];
    let fast = ["--max-image-size", "320", "--final-only", "--no-page"];
    let fast = fast.into_iter().chain(["--out", out.to_str().unwrap()]);
    let said = stderr(&expect_status(0, arguments.into_iter().chain(fast)));
    let expected = "640 x 480 are computed on at 320 x 240";
    assert!(said.contains(expected), "{said}");
    let text = |name: &str| path(&out.join(name));
    let truth = path(&sample().join("ground-truth.ply"));
    let compared = ["evaluate", &text("mesh.ply"), "--ground-truth", &truth];
    let found = expect_status(0, compared.into_iter().chain(["--json"]));
    let found: serde_json::Value = serde_json::from_slice(&found.stdout).expect("JSON");
    let median = found["accuracy"]["median"].as_f64().expect("a number");
    // Half a pixel of the small depth is a few millimetres.
    assert!(median < 0.005, "{found}");
}

#[test]
fn runs_say_what_they_compute_on() {
    let folder = images_alone();
    for from in ["lines", "map-points"] {
        let out = folder.path().join(from);
        let arguments = [
            "reconstruct",
            folder.path().to_str().expect("temporary paths are UTF-8"),
            "--from",
            from,
            "--every",
            "2",
            "--max-keyframes",
            "8",
            "--max-image-size",
            "320",
            "--no-page",
            "--final-only",
            "--out",
            out.to_str().expect("temporary paths are UTF-8"),
        ];
        let said = stderr(&expect_status(0, arguments));
        assert!(
            said.contains("640 x 480 are computed on at 320 x 240"),
            "{said}"
        );
        let picture = image::open(out.join("picture.png")).expect("a picture");
        assert_eq!(picture.height(), 240);
        assert!(out.join("mesh.ply").exists());
    }
}
