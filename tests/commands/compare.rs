//! `linecarve compare`: both surfaces from the same keyframes.

use std::path::Path;

use crate::program::{contents, expect_status, linecarve, small_sequence, stderr, text};
use serde_json::Value;

fn comparison(out: &Path) -> Value {
    let bytes = std::fs::read(out.join("compare.json")).expect("compare.json is written");
    serde_json::from_slice(&bytes).expect("it is JSON")
}

/// The comparison without what differs from run to run.
fn without_times(mut value: Value) -> Value {
    for surface in value["surfaces"].as_array_mut().unwrap() {
        let surface = surface.as_object_mut().unwrap();
        surface.remove("milliseconds_per_keyframe");
        surface.remove("mean_milliseconds");
    }
    value
}

#[test]
fn both_surfaces_are_measured_and_drawn_and_repeat_for_any_number_of_threads() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    let truth = sequence.join("ground-truth.ply");
    let run = |threads: &str| {
        let out = folder.path().join(threads);
        let output = expect_status(
            0,
            [
                "compare",
                text(&sequence),
                "--ground-truth",
                text(&truth),
                "--every",
                "1",
                "--views",
                "1",
                "--samples",
                "20000",
                "--threads",
                threads,
                "--out",
                text(&out),
            ],
        );
        (out, stderr(&output))
    };
    let (one, said) = run("1");
    let (two, _) = run("2");
    assert!(
        said.contains("F at 0.05") && said.contains("map points"),
        "{said}"
    );

    let found = comparison(&one);
    assert_eq!(found["keyframes"].as_array().unwrap().len(), 6);
    let surfaces = found["surfaces"].as_array().unwrap();
    assert_eq!(surfaces.len(), 2);
    for surface in surfaces {
        let name = surface["name"].as_str().unwrap();
        assert!(surface["triangles"].as_u64().unwrap() > 20, "{surface}");
        assert!(surface["milliseconds_per_keyframe"].as_f64().unwrap() > 0.0);
        let scores = surface["evaluation"]["at"].as_array().unwrap();
        assert_eq!(scores.len(), 3);
        assert!(
            surface["evaluation"]["accuracy"]["mean"].as_f64().unwrap() < 0.5,
            "{name}"
        );
        for format in ["glb", "obj", "ply"] {
            for file in ["mesh", "feature-edges"] {
                let path = one.join(name).join(format!("{file}.{format}"));
                assert!(path.is_file(), "{}", path.display());
            }
        }
    }
    // Every file that is named is there, and the other way round.
    let mut named: Vec<String> = found["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|name| name.as_str().unwrap().to_owned())
        .collect();
    named.sort();
    let first = contents(&one);
    let mut there: Vec<String> = first
        .keys()
        .map(|path| path.to_str().unwrap().to_owned())
        .collect();
    there.sort();
    assert_eq!(named, there);

    assert_eq!(without_times(found), without_times(comparison(&two)));
    let second = contents(&two);
    for (name, bytes) in &first {
        if !["compare.json", "report.html"].contains(&name.to_str().unwrap()) {
            assert!(*bytes == second[name], "{} differs", name.display());
        }
    }
    // Photo, lines, points above; ground truth and errors below; captions, and the colour bar under all.
    let picture = image::open(one.join("pictures/keyframe-000003.png")).unwrap();
    assert_eq!(
        (picture.width(), picture.height()),
        (3 * 320 + 16, 2 * (240 + 34) + 8 + 58)
    );
}

#[test]
fn a_ground_truth_in_other_units_is_told() {
    let folder = small_sequence(4, "tum");
    let sequence = folder.path().join("sequence");
    let millimetres = folder.path().join("millimetres.obj");
    std::fs::write(
        &millimetres,
        "v 0 0 0\nv 5000 0 0\nv 0 4000 0\nv 0 0 3000\nf 1 2 3\nf 1 3 4\n",
    )
    .unwrap();
    let out = folder.path().join("out");
    let output = expect_status(
        0,
        [
            "compare",
            text(&sequence),
            "--ground-truth",
            text(&millimetres),
            "--every",
            "1",
            "--views",
            "0",
            "--samples",
            "1000",
            "--out",
            text(&out),
        ],
    );
    assert!(
        stderr(&output).contains("are their units the same"),
        "{}",
        stderr(&output)
    );
    let warnings = comparison(&out)["warnings"].to_string();
    assert!(warnings.contains("units"), "{warnings}");
}

#[test]
fn an_empty_side_is_told_and_the_rest_is_written() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    // No point is seen by enough keyframes.
    let arguments = [
        "compare",
        text(&sequence),
        "--every",
        "1",
        "--max-keyframes",
        "1",
        "--out",
        text(&out),
    ];
    let output = linecarve(arguments);
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert!(
        stderr(&output).contains("the surface from points is empty"),
        "{}",
        stderr(&output)
    );
    let found = comparison(&out);
    assert_eq!(found["surfaces"][1]["triangles"], 0);
    assert!(found["surfaces"][0]["triangles"].as_u64().unwrap() > 0);
    assert!(found["ground_truth"].is_null());
    assert!(out.join("report.html").is_file() && out.join("pictures/outside.png").is_file());
}

#[test]
fn bad_input_is_refused_before_the_work() {
    let folder = small_sequence(2, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    let lines = folder.path().join("lines.obj");
    std::fs::write(&lines, "v 0 0 0\nv 1 0 0\nl 1 2\n").unwrap();
    let cases: [(&[&str], &str); 4] = [
        (&["--ground-truth", "nowhere.ply"], "nowhere.ply"),
        (&["--ground-truth", text(&lines)], "lines.obj"),
        (&["--thresholds", "0.05,-1"], "-1"),
        (&["--samples", "0"], "samples"),
    ];
    for (arguments, expected) in cases {
        let mut all = vec!["compare", text(&sequence), "--out", text(&out)];
        all.extend(arguments);
        let output = linecarve(all);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(
            stderr(&output).contains(expected),
            "{arguments:?}: {}",
            stderr(&output)
        );
        assert!(!out.join("lines").exists());
    }
}

#[test]
fn errors_are_drawn_by_the_render_command_too() {
    let folder = small_sequence(2, "tum");
    let truth = folder.path().join("sequence/ground-truth.ply");
    let picture = folder.path().join("errors.png");
    let draw = |end: &str| {
        linecarve([
            "render",
            text(&truth),
            "--errors",
            text(&truth),
            "--errors-end",
            end,
            "--size",
            "160x120",
            "--out",
            text(&picture),
        ])
    };
    assert_eq!(draw("0.1").status.code(), Some(0));
    let picture = image::open(&picture).unwrap();
    assert_eq!((picture.width(), picture.height()), (160, 120 + 58));
    let refused = draw("0");
    assert_eq!(refused.status.code(), Some(2));
    assert!(stderr(&refused).contains("--errors-end"));
}
