//! Reconstruction from map points: outputs, determinism, images without depth, reasons for an empty surface.

use std::path::Path;

use crate::program::{contents, expect_status, stderr, text};

/// The sample without its depth images, every fourth frame.
fn sample_without_depth(folder: &Path) {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    std::fs::create_dir_all(folder.join("rgb")).expect("a writable folder");
    for name in ["rgb.txt", "groundtruth.txt"] {
        std::fs::copy(sample.join(name), folder.join(name)).expect("a whole sample");
    }
    let sidecar = sample.join("linecarve.toml");
    if sidecar.exists() {
        std::fs::copy(sidecar, folder.join("linecarve.toml")).expect("a whole sample");
    }
    for entry in std::fs::read_dir(sample.join("rgb")).expect("a whole sample") {
        let path = entry.expect("a readable entry").path();
        let name = path.file_name().expect("a file has a name");
        std::fs::copy(&path, folder.join("rgb").join(name)).expect("a whole sample");
    }
}

fn arguments<'a>(sequence: &'a Path, out: &'a Path, threads: &'a str) -> Vec<&'a str> {
    vec![
        "reconstruct",
        text(sequence),
        "--from",
        "map-points",
        "--every",
        "2",
        "--max-keyframes",
        "10",
        "--threads",
        threads,
        "--out",
        text(out),
    ]
}

#[test]
fn images_and_poses_alone_give_a_surface_that_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let [sequence, one, two] = ["sequence", "one", "two"].map(|name| folder.path().join(name));
    sample_without_depth(&sequence);
    expect_status(0, arguments(&sequence, &one, "1"));
    expect_status(0, arguments(&sequence, &two, "2"));
    let (mut first, mut second) = (contents(&one), contents(&two));
    let report = first.remove(Path::new("report.json")).unwrap();
    second.remove(Path::new("report.json")).unwrap();
    // Like the report, the page tells durations.
    for files in [&mut first, &mut second] {
        assert!(files.remove(Path::new("report.html")).is_some());
    }
    for name in [
        "mesh.glb",
        "mesh.obj",
        "mesh.ply",
        "feature-edges.ply",
        "points.ply",
        "picture.png",
        "keyframes/000009.glb",
    ] {
        assert!(first.contains_key(Path::new(name)), "{name} is missing");
    }
    assert!(first.keys().eq(second.keys()));
    for (name, bytes) in &first {
        assert!(bytes == &second[name], "{} differs", name.display());
    }
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["from"], "map-points");
    let number = |pointer: &str| {
        let value = report.pointer(pointer).and_then(serde_json::Value::as_f64);
        value.unwrap_or_else(|| panic!("{pointer} is missing"))
    };
    assert!(number("/result/points") > 300.0 && number("/result/triangles") > 300.0);
    // No lines are known, so that creases alone are edges.
    assert!(number("/result/feature_edges/creases") > 0.0);
    assert_eq!(number("/result/feature_edges/along_lines"), 0.0);
    assert!(number("/result/reprojection_rms_px") < 1.5);
    // The room is 3.6 to 5 m wide: the scale of the poses must come back.
    assert!((1.0..4.0).contains(&number("/sequence/median_depth")));
    assert!(number("/keyframes/5/map_points/observed_again") > 100.0);
}

#[test]
fn one_keyframe_and_blank_images_say_why_there_is_no_surface() {
    let folder = tempfile::tempdir().unwrap();
    let [sequence, out] = ["sequence", "out"].map(|name| folder.path().join(name));
    sample_without_depth(&sequence);
    let mut alone = arguments(&sequence, &out, "1");
    alone[7] = "1";
    let output = expect_status(1, alone);
    assert!(
        stderr(&output).contains("1 keyframe(s) are too few"),
        "{}",
        stderr(&output)
    );
    let edges = linecarve_mesh::read_geometry(&out.join("feature-edges.ply")).unwrap();
    assert!(edges.positions.is_empty() && edges.lines.is_empty());
    for entry in std::fs::read_dir(sequence.join("rgb")).unwrap() {
        let path = entry.unwrap().path();
        let size = image::image_dimensions(&path).unwrap();
        image::RgbImage::from_pixel(size.0, size.1, image::Rgb([90; 3]))
            .save(path)
            .unwrap();
    }
    let output = expect_status(1, arguments(&sequence, &out, "1"));
    assert!(
        stderr(&output).contains("have no corners"),
        "{}",
        stderr(&output)
    );
    // Without motion in the images nothing tells how far away the scene is.
    let mut by_motion = arguments(&sequence, &out, "1");
    by_motion.drain(4..6);
    let output = expect_status(2, by_motion);
    assert!(
        stderr(&output).contains("--min-translation"),
        "{}",
        stderr(&output)
    );
}
