//! The program `linecarve-lab` from end to end, and the published table of results.

mod support;

use std::path::Path;

use linecarve_mesh::read_geometry;
use support::{
    blacken, contents, data, expect_status, repository, sample, small_sequence, stderr, text,
};

fn tables(status: i32, sequence: &Path, truth: &Path, more: &[&str]) -> (String, String) {
    let mut arguments = vec![
        "tables",
        text(sequence),
        "--ground-truth",
        text(truth),
        "--quiet",
    ];
    arguments.extend(more);
    let output = expect_status(status, &arguments);
    let error = stderr(&output);
    (String::from_utf8_lossy(&output.stdout).into_owned(), error)
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
    stderr(&expect_status(status, &arguments))
}

#[test]
fn tables_of_the_sample_have_every_method_and_lie_near_the_truth() {
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
    // Depth is exact here: the remaining errors are those of the edges and of the fit.
    for (method, depth, mean_m, reprojection_px) in [
        ("matched", None, 0.05, 2.0),
        ("decoupled", Some("sensor"), 0.01, 1.6),
        ("ransac", Some("sensor"), 0.01, 1.6),
        ("paper", Some("sensor"), 0.01, 1.6),
        ("paper, clustered", Some("sensor"), 0.01, 2.5),
        ("edge-aided", Some("sensor"), 0.005, 1.6),
        ("edge-aided, clustered", Some("sensor"), 0.005, 1.6),
    ] {
        let row = row(method, depth);
        let ends = row["surface"]["ends"]["mean"].as_f64().unwrap();
        assert!(ends > 0.0 && ends < mean_m, "{method}: {ends} m");
        let images = &row["images"];
        let distance = images["reprojection_px"]["mean"].as_f64().unwrap();
        let chance = images["chance_mean_px"].as_f64().unwrap();
        assert!(
            distance < reprojection_px && chance > 2.0 * distance,
            "{method}: {distance} px, {chance} px"
        );
        let explained = images["explained_share"].as_f64().unwrap();
        assert!(explained > 0.2, "{method}: {explained}");
        assert!(row["milliseconds"].as_f64().unwrap() > 0.0);
    }
    // What was measured at the pixels of the ends is exact, for each of them.
    let edge_aided = row("edge-aided", Some("sensor"));
    let [depths, ends] = ["depths", "ends"].map(|name| &edge_aided["surface"][name]);
    assert_eq!(depths["count"], ends["count"]);
    assert!(depths["mean"].as_f64().unwrap() < 0.0005, "{depths}");
    let points = row("points", Some("sensor"));
    assert!(points["vertices"].as_u64().unwrap() > 50_000);
    assert!(points["surface"]["ends"]["median"].as_f64().unwrap() < 0.002);
    assert!(tables["ratios"].as_array().expect("ratios").len() >= 4);
}

#[test]
fn tables_as_text_name_rows_and_bars() {
    let folder = small_sequence(8);
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
fn tables_take_a_cloud_align_it_and_carve_surfaces() {
    let folder = small_sequence(5);
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("points");
    lines(0, "points", &sequence, &out, &["--every", "1", "--quiet"]);
    let cloud = out.join("points.ply");
    let more = ["--every", "1", "--align", "sim3", "--surfaces", "--json"];
    let (json, _) = tables(0, &sequence, &cloud, &more);
    let tables: serde_json::Value = serde_json::from_str(&json).expect("one JSON object");
    assert_eq!(tables["ground_truth_triangles"], 0);
    assert!(tables["ground_truth_points"].as_u64().unwrap() > 1000);
    let alignment = &tables["alignment"];
    assert_eq!(alignment["is_reliable"], true, "{alignment}");
    assert!((alignment["scale"].as_f64().unwrap() - 1.0).abs() < 1e-3);
    let surfaces = tables["surfaces"].as_array().expect("surfaces");
    let labels = surfaces.iter().map(|row| row["labels"].as_str().unwrap());
    assert!(labels.clone().any(|name| name == "volume against area"));
    assert_eq!(labels.count() % 6, 0);
    assert!(surfaces[0]["triangles"].as_u64().unwrap() > 0);
    let (_, error) = self::tables(2, &sequence, &cloud, &["--trajectories", "a.txt", "b.txt"]);
    assert!(error.contains("--align"), "{error}");
}

#[test]
fn the_figure_has_a_picture_for_each_method() {
    let folder = small_sequence(8);
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("figure");
    let run = |status, more: &[&str]| {
        let mut arguments = vec!["figure", text(&sequence), "--out", text(&out)];
        arguments.extend(["--every", "1", "--depth", "sensor", "--quiet"]);
        arguments.extend(more);
        stderr(&expect_status(status, &arguments))
    };
    run(0, &[]);
    let names: Vec<_> = contents(&out).into_keys().collect();
    assert_eq!(names.len(), 9, "{names:?}");
    assert!(names.contains(&"figure.png".into()));
    let error = run(2, &["--frame", "nowhere"]);
    assert!(error.contains("nowhere"), "{error}");
}

#[test]
fn lines_agree_with_themselves() {
    let folder = tempfile::tempdir().unwrap();
    let lines = folder.path().join("lines.obj");
    std::fs::write(&lines, "v 0 0 0\nv 1 0 0\nl 1 2\n").unwrap();
    let run = |status, within| {
        let files = [text(&lines), "--reference", text(&lines)];
        let arguments = [&["agreement"][..], &files, &["--within", within]].concat();
        expect_status(status, &arguments)
    };
    let output = run(0, "0.02");
    let found = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(found.matches("100.0 %").count() == 2, "{found}");
    assert!(stderr(&run(2, "0")).contains("--within"));
}

#[test]
fn a_ground_truth_of_lines_is_refused() {
    let folder = small_sequence(2);
    let sequence = folder.path().join("sequence");
    let (_, error) = tables(2, &sequence, &folder.path().join("nowhere.ply"), &[]);
    assert!(error.contains("nowhere.ply"), "{error}");
    let points = folder.path().join("points.obj");
    std::fs::write(&points, "v 0 0 0\nv 1 0 0\nl 1 2\n").unwrap();
    let (_, error) = tables(2, &sequence, &points, &[]);
    assert!(
        error.contains("points.obj") && error.contains("lines and no triangles"),
        "{error}"
    );
}

#[test]
fn each_method_writes_the_same_lines_for_any_number_of_threads() {
    let folder = small_sequence(8);
    let sequence = folder.path().join("sequence");
    for method in [
        "edge-aided",
        "decoupled",
        "ransac",
        "paper",
        "matched",
        "points",
    ] {
        let run = |name: &str, threads: &str| {
            let out = folder.path().join(name);
            let more = ["--every", "1", "--threads", threads, "--quiet"];
            lines(0, method, &sequence, &out, &more);
            let mut files = contents(&out);
            // Durations differ.
            let report = files.remove(Path::new("report.json"));
            assert!(report.is_some(), "{method}: no report");
            files
        };
        let first = run(&format!("{method}-1"), "1");
        let second = run(&format!("{method}-3"), "3");
        assert!(first == second, "{method}: files differ between threads");
        let expected = match method {
            "points" => "points.ply",
            _ => "segments.obj",
        };
        assert!(
            first.contains_key(Path::new(expected)),
            "{method}: {:?}",
            first.keys()
        );
        let found = read_geometry(&folder.path().join(format!("{method}-1/{expected}"))).unwrap();
        assert!(found.lines.len() >= 4 || method == "points", "{method}");
    }
}

#[test]
fn black_images_and_single_keyframes_end_with_status_one_and_a_reason() {
    let folder = small_sequence(3);
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    let error = lines(1, "matched", &sequence, &out, &["--max-keyframes", "1"]);
    assert!(error.contains("three"), "{error}");
    blacken(&sequence);
    for method in ["decoupled", "matched", "points"] {
        let error = lines(1, method, &sequence, &out, &["--every", "1"]);
        assert!(error.contains("linecarve-lab: no "), "{error}");
    }
    let truth = sequence.join("ground-truth.ply");
    let (_, error) = tables(1, &sequence, &truth, &["--every", "1"]);
    assert!(error.contains("black"), "{error}");
}

#[test]
fn a_method_that_needs_depth_images_says_so() {
    let folder = small_sequence(3);
    let sequence = folder.path().join("sequence");
    std::fs::remove_file(sequence.join("depth.txt")).unwrap();
    std::fs::remove_dir_all(sequence.join("depth")).unwrap();
    let out = folder.path().join("out");
    let error = lines(2, "decoupled", &sequence, &out, &["--every", "1"]);
    assert!(error.contains("depth"), "{error}");
}

#[test]
fn depth_from_images_lies_near_the_depth_images() {
    let sample = sample();
    let few = ["depth", text(&sample), "--max-keyframes", "12"];
    let output = expect_status(0, &[&few[..], &["--json", "--quiet"]].concat());
    let rows: serde_json::Value = serde_json::from_slice(&output.stdout).expect("a JSON list");
    let places = rows[0]["places"].as_array().expect("places");
    assert_eq!(places.len(), 4);
    for places in places {
        let number = |key: &str| places[key].as_u64().expect("a count") as f64;
        let covered = number("estimated") / number("compared");
        let within = number("within_two_sigma") / number("estimated");
        let median = places["error"][0].as_f64().expect("an error");
        assert!(covered > 0.8 && within > 0.7 && median < 0.005, "{places}");
    }
    let compared = |at: usize| places[at]["compared"].as_u64().expect("a count");
    assert_eq!((0..3).map(compared).sum::<u64>(), compared(3));
}

#[test]
fn the_ablation_writes_rows_with_their_provenance() {
    let folder = small_sequence(6);
    let sequence = folder.path().join("sequence");
    let document = folder.path().join("ablation.md");
    let output = expect_status(
        0,
        &[
            "ablation",
            text(&sequence),
            "--every",
            "1",
            "--only",
            "measured triangles;",
            "--write",
            text(&document),
            "--date",
            "2026-11-22",
            "--json",
            "--quiet",
        ],
    );
    let rows: serde_json::Value = serde_json::from_slice(&output.stdout).expect("rows as JSON");
    let rows = rows.as_array().expect("a list");
    assert_eq!(rows.len(), 2);
    for row in rows {
        assert!(row["vertices"].as_u64().unwrap() > 10, "{row}");
        assert!(row["f_observed"][2].as_f64().unwrap() > 0.5, "{row}");
    }
    let written = std::fs::read_to_string(&document).unwrap();
    assert!(written.contains("; 2026-11-22.\n"), "{written}");
    assert!(written.contains("linecarve-lab ablation"), "{written}");
    assert!(written.contains("| sequence | measured triangles; cut: the default |"));
}

#[test]
fn benchmarks_put_a_rival_beside_the_reconstruction() {
    let folder = small_sequence(6);
    let sequence = folder.path().join("sequence");
    let truth = sequence.join("ground-truth-observed.ply");
    let [document, readme] = ["benchmarks.md", "README.md"].map(|name| folder.path().join(name));
    std::fs::write(
        &readme,
        "# Title\n\n<!-- results:begin -->\n<!-- results:end -->\n\nMore.\n",
    )
    .unwrap();
    let rival = format!("the truth={},12.5", text(&truth));
    let output = expect_status(
        0,
        &[
            "benchmarks",
            text(&sequence),
            "--every",
            "1",
            "--rival",
            &rival,
            "--write",
            text(&document),
            "--readme",
            text(&readme),
            "--quiet",
        ],
    );
    let table = String::from_utf8(output.stdout).expect("a table");
    assert!(table.contains("| sequence | Linecarve | 6 |"), "{table}");
    assert!(
        table.contains("| sequence | the truth | - | 1.000 / 1.000 / 1.000 |")
            && table.contains("| 12.5 |"),
        "{table}"
    );
    let written = std::fs::read_to_string(&document).unwrap();
    assert!(written.contains(&table), "{written}");
    let readme = std::fs::read_to_string(&readme).unwrap();
    assert!(readme.contains(&table) && readme.ends_with("\n\nMore.\n"));
    // Markers that are missing are not invented.
    std::fs::write(&document, "text").unwrap();
    let output = expect_status(
        2,
        &[
            "ablation",
            text(&sequence),
            "--only",
            "default",
            "--write",
            text(&document),
        ],
    );
    assert!(stderr(&output).contains("ablation:begin"));
}

#[test]
fn results_in_the_readme_stand_in_the_benchmarks() {
    let read = |name: &str| std::fs::read_to_string(repository().join(name)).expect(name);
    let (readme, benchmarks) = (read("README.md"), read("docs/benchmarks.md"));
    let published = linecarve_lab::document::section(&benchmarks, "results");
    let published = published.expect("docs/benchmarks.md has the markers of `results`");
    // A README without markers publishes no results.
    let section = linecarve_lab::document::section(&readme, "results").unwrap_or_default();
    for row in linecarve_lab::document::table_rows(section) {
        assert!(
            linecarve_lab::document::table_rows(published).any(|known| known == row),
            "{row}\nis not in docs/benchmarks.md: run linecarve-lab benchmarks --write docs/benchmarks.md --readme README.md"
        );
    }
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn edge_aided_lines_of_the_living_room_are_the_most_accurate_from_depth_images() {
    let sequence = data("livingroom-synthetic");
    let truth = sequence.join("ground-truth.ply");
    let more = ["--every", "20", "--depth", "sensor", "--json"];
    let (json, _) = tables(0, &sequence, &truth, &more);
    let tables: serde_json::Value = serde_json::from_str(&json).expect("one JSON object");
    let edge_aided = tables["ratios"]
        .as_array()
        .expect("ratios")
        .iter()
        .find(|ratio| ratio["name"] == "edge-aided / decoupled, mean distance of end points")
        .expect("the ratio")["value"]
        .as_f64()
        .expect("a number");
    assert!(edge_aided < 1.0, "{edge_aided}");
}
