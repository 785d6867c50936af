//! Every line method end to end: `lines --method` and `tables` on the sample and on damaged input.

mod program;

use std::path::{Path, PathBuf};

use linecarve_mesh::read_geometry;
use program::{contents, expect_status, small_sequence, stderr};

fn text(path: &Path) -> &str {
    path.to_str().expect("temporary paths are UTF-8")
}

fn sample() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room")
}

fn tables(status: i32, sequence: &Path, truth: &Path, more: &[&str]) -> (String, String) {
    let mut arguments = vec![
        "tables",
        text(sequence),
        "--ground-truth",
        text(truth),
        "--quiet",
    ];
    arguments.extend(more);
    let output = expect_status(status, arguments);
    let said = stderr(&output);
    assert!(!said.contains("panicked"), "{said}");
    (String::from_utf8_lossy(&output.stdout).into_owned(), said)
}

fn lines(status: i32, method: &str, sequence: &Path, out: &Path, more: &[&str]) -> String {
    let mut arguments = vec![
        "lines",
        text(sequence),
        "--method",
        method,
        "--format",
        "obj",
        "--out",
        text(out),
    ];
    arguments.extend(more);
    let said = stderr(&expect_status(status, arguments));
    assert!(!said.contains("panicked"), "{said}");
    said
}

/// Makes every image of a sequence black.
fn blacken(sequence: &Path) {
    for entry in std::fs::read_dir(sequence.join("rgb")).expect("the layout has a colour folder") {
        let path = entry.expect("a readable entry").path();
        image::RgbImage::new(320, 240)
            .save(path)
            .expect("a writable image");
    }
}

#[test]
fn the_tables_of_the_sample_have_every_method_and_lie_near_the_truth() {
    let truth = sample().join("ground-truth.ply");
    let (json, _) = tables(0, &sample(), &truth, &["--every", "2", "--json"]);
    let tables: serde_json::Value = serde_json::from_str(&json).expect("one JSON object");
    let row = |method: &str, depth: Option<&str>| {
        tables["rows"]
            .as_array()
            .expect("rows")
            .iter()
            .find(|row| row["method"] == method && row["depth"].as_str() == depth)
            .unwrap_or_else(|| panic!("no row {method} {depth:?} in {json}"))
            .clone()
    };
    // Depth is exact here: what is left is the error of the edge, and of the fit.
    for (method, depth, mean_m, reprojection_px) in [
        ("matched", None, 0.05, 2.0),
        ("decoupled", Some("sensor"), 0.01, 1.6),
        ("edge-aided", Some("sensor"), 0.005, 1.6),
        ("edge-aided, clustered", Some("sensor"), 0.005, 1.6),
    ] {
        let row = row(method, depth);
        let ends = row["surface"]["ends"]["mean"].as_f64().unwrap();
        assert!(ends > 0.0 && ends < mean_m, "{method}: {ends} m");
        let images = &row["images"];
        let off = images["reprojection_px"]["mean"].as_f64().unwrap();
        let chance = images["chance_mean_px"].as_f64().unwrap();
        assert!(
            off < reprojection_px && chance > 2.0 * off,
            "{method}: {off} px, {chance} px"
        );
        let explained = images["explained_share"].as_f64().unwrap();
        assert!(explained > 0.2, "{method}: {explained}");
        assert!(row["milliseconds"].as_f64().unwrap() > 0.0);
    }
    let points = row("points", Some("sensor"));
    assert!(points["vertices"].as_u64().unwrap() > 50_000);
    assert!(points["surface"]["ends"]["median"].as_f64().unwrap() < 0.002);
    assert!(tables["ratios"].as_array().expect("ratios").len() >= 4);
}

#[test]
fn the_tables_as_text_name_rows_and_bars() {
    let folder = small_sequence(8, "tum");
    let sequence = folder.path().join("sequence");
    let save = folder.path().join("lines");
    let truth = sequence.join("ground-truth.ply");
    let (out, _) = tables(
        0,
        &sequence,
        &truth,
        &["--every", "1", "--save", text(&save)],
    );
    for expected in [
        "matched",
        "decoupled",
        "edge-aided, clustered",
        "<= 0.65",
        "Milliseconds",
    ] {
        assert!(out.contains(expected), "{expected} in {out}");
    }
    assert!(save.join("edge-aided-clustered-sensor.obj").is_file());
}

#[test]
fn a_ground_truth_that_is_none_is_refused() {
    let folder = small_sequence(2, "tum");
    let sequence = folder.path().join("sequence");
    let (_, said) = tables(2, &sequence, &folder.path().join("nowhere.ply"), &[]);
    assert!(said.contains("nowhere.ply"), "{said}");
    let points = folder.path().join("points.obj");
    std::fs::write(&points, "v 0 0 0\nv 1 0 0\nl 1 2\n").unwrap();
    let (_, said) = tables(2, &sequence, &points, &[]);
    assert!(
        said.contains("points.obj") && said.contains("triangles"),
        "{said}"
    );
}

#[test]
fn each_method_writes_its_lines_the_same_in_every_run() {
    let folder = small_sequence(8, "tum");
    let sequence = folder.path().join("sequence");
    for method in ["decoupled", "matched", "points"] {
        let run = |name: &str, threads: &str| {
            let out = folder.path().join(name);
            lines(
                0,
                method,
                &sequence,
                &out,
                &["--every", "1", "--threads", threads, "--quiet"],
            );
            let mut files = contents(&out);
            // Durations differ.
            files.remove(Path::new("report.json"));
            files
        };
        let (first, second) = (
            run(&format!("{method}-1"), "1"),
            run(&format!("{method}-3"), "3"),
        );
        assert!(!first.is_empty());
        assert!(first == second, "{method}: files differ between threads");
        let named = if method == "points" {
            "points.ply"
        } else {
            "segments.obj"
        };
        assert!(
            first.contains_key(Path::new(named)),
            "{method}: {:?}",
            first.keys()
        );
        if named == "segments.obj" {
            let found =
                read_geometry(&folder.path().join(format!("{method}-1/segments.obj"))).unwrap();
            assert!(found.lines.len() >= 4, "{method}");
        }
    }
}

#[test]
fn black_images_and_single_keyframes_end_with_status_one_and_a_reason() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    let said = lines(1, "matched", &sequence, &out, &["--max-keyframes", "1"]);
    assert!(said.contains("three"), "{said}");
    blacken(&sequence);
    for method in ["decoupled", "matched", "points"] {
        let said = lines(1, method, &sequence, &out, &["--every", "1"]);
        assert!(said.contains("linecarve: no "), "{said}");
    }
    let truth = sequence.join("ground-truth.ply");
    let (_, said) = tables(1, &sequence, &truth, &["--every", "1"]);
    assert!(said.contains("black"), "{said}");
}

#[test]
fn a_method_that_needs_depth_says_so() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    std::fs::remove_file(sequence.join("depth.txt")).unwrap();
    std::fs::remove_dir_all(sequence.join("depth")).unwrap();
    let out = folder.path().join("out");
    let said = lines(2, "decoupled", &sequence, &out, &["--every", "1"]);
    assert!(said.contains("depth"), "{said}");
}
