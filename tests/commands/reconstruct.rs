//! Reconstruction of a rendered sequence: outputs, determinism and accuracy.

use std::path::Path;

use crate::program::{contents, data, expect_status, small_sequence, text};

fn reconstruct(sequence: &Path, out: &Path, threads: &str) {
    expect_status(
        0,
        [
            "reconstruct",
            text(sequence),
            "--every",
            "1",
            "--threads",
            threads,
            "--quiet",
            "--out",
            text(out),
        ],
    );
}

#[test]
fn every_output_is_there_and_repeats_for_any_number_of_threads() {
    let folder = small_sequence(5, "tum");
    let sequence = folder.path().join("sequence");
    let [one, two, again] = ["one", "two", "again"].map(|name| folder.path().join(name));
    reconstruct(&sequence, &one, "1");
    reconstruct(&sequence, &two, "2");
    reconstruct(&sequence, &again, "2");

    let mut first = contents(&one);
    let report = first.remove(Path::new("report.json")).unwrap();
    for name in [
        "mesh.glb",
        "mesh.obj",
        "mesh.ply",
        "segments.glb",
        "segments.obj",
        "segments.ply",
        "clusters.glb",
        "clusters.obj",
        "clusters.ply",
        "feature-edges.glb",
        "feature-edges.obj",
        "feature-edges.ply",
        "scene.glb",
        "picture.png",
        "report.html",
        "keyframes/000000.glb",
        "keyframes/000004.glb",
    ] {
        assert!(first.contains_key(Path::new(name)), "{name} is missing");
    }
    let scene = String::from_utf8_lossy(&first[Path::new("scene.glb")]).into_owned();
    for node in ["surface", "segments", "clusters", "feature-edges"] {
        assert!(scene.contains(&format!("\"name\":\"{node}\"")), "{node}");
    }
    // The page tells durations, too.
    first.remove(Path::new("report.html")).unwrap();
    for other in [&two, &again] {
        let mut second = contents(other);
        for name in ["report.json", "report.html"] {
            second.remove(Path::new(name)).unwrap();
        }
        assert_eq!(
            first.keys().collect::<Vec<_>>(),
            second.keys().collect::<Vec<_>>()
        );
        for (name, bytes) in &first {
            assert!(bytes == &second[name], "{} differs", name.display());
        }
    }

    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    assert_eq!(report["keyframes"].as_array().unwrap().len(), 5);
    assert!(report["result"]["triangles"].as_u64().unwrap() > 100);
    let edges = &report["result"]["feature_edges"];
    assert!(edges["creases"].as_u64().unwrap() > 0);
    assert!(edges["creases_length"].as_f64().unwrap() > 0.0);
    let rays: Vec<u64> = report["keyframes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|keyframe| keyframe["rays"].as_u64().unwrap())
        .collect();
    assert!(rays.is_sorted() && rays[0] > 0, "{rays:?}");
}

#[test]
fn layouts_of_one_scene_agree() {
    // TUM stores depth five times finer, so that only the order of magnitude is the same for all three.
    let mut triangles = Vec::new();
    for layout in ["tum", "7-scenes", "open3d"] {
        let folder = small_sequence(4, layout);
        let out = folder.path().join("out");
        reconstruct(&folder.path().join("sequence"), &out, "2");
        let report = std::fs::read(out.join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
        triangles.push(report["result"]["triangles"].as_f64().unwrap());
    }
    let (least, most) = triangles
        .iter()
        .fold((f64::MAX, 0.0_f64), |(low, high), &n| {
            (low.min(n), high.max(n))
        });
    assert!(least > 0.8 * most, "{triangles:?}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn real_sequences_run_to_the_end() {
    // Least numbers of triangles after the first eight keyframes.
    for (name, least) in [("seven-scenes", 3000), ("livingroom-synthetic", 1500)] {
        let sequence = data(name);
        let out = tempfile::tempdir().unwrap();
        expect_status(
            0,
            [
                "reconstruct",
                text(&sequence),
                "--max-keyframes",
                "8",
                "--quiet",
                "--out",
                text(out.path()),
            ],
        );
        let report = std::fs::read(out.path().join("report.json")).unwrap();
        let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
        let triangles = report["result"]["triangles"].as_u64().unwrap();
        assert!(triangles >= least, "{name}: {triangles}");
        assert!(out.path().join("keyframes/000007.glb").exists());
    }
}
