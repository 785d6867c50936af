//! `linecarve evaluate`: the sample against its own ground truth, files of every format, bad input.

use std::path::{Path, PathBuf};

use crate::program::{expect_status, linecarve, stderr, text};
use linecarve_mesh::{LineSet, Shape, read_geometry, write_lines_obj, write_mesh_ply};
use nalgebra::{Point3, Similarity3, Vector3};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("assets/room")
        .join(name)
}

/// Runs `evaluate --json` and gives the object.
fn evaluate(shape: &Path, truth: &Path, more: &[&str]) -> serde_json::Value {
    let mut arguments = vec![
        "evaluate",
        text(shape),
        "--ground-truth",
        text(truth),
        "--json",
        "--samples",
        "20000",
    ];
    arguments.extend(more);
    let output = expect_status(0, arguments);
    serde_json::from_slice(&output.stdout).expect("one JSON object")
}

fn number(object: &serde_json::Value, pointer: &str) -> f64 {
    object
        .pointer(pointer)
        .and_then(serde_json::Value::as_f64)
        .unwrap_or_else(|| panic!("{pointer} in {object}"))
}

/// Distance of a point to a triangle by looking at its plane and its edges: another way than the program's.
fn distance_by_hand(point: &Point3<f64>, corners: [Point3<f64>; 3]) -> f64 {
    let [a, b, c] = corners;
    let normal = (b - a).cross(&(c - a));
    let is_above = (0..3).all(|k| {
        let (from, to) = (corners[k], corners[(k + 1) % 3]);
        normal.cross(&(to - from)).dot(&(point - from)) >= 0.0
    });
    if is_above && normal.norm() > 0.0 {
        return (point - a).dot(&normal).abs() / normal.norm();
    }
    (0..3)
        .map(|k| {
            let (from, to) = (corners[k], corners[(k + 1) % 3]);
            let along = to - from;
            let t = ((point - from).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (point - (from + along * t)).norm()
        })
        .fold(f64::INFINITY, f64::min)
}

#[test]
fn distances_at_vertices_are_those_of_all_triangles_in_turn() {
    let folder = tempfile::tempdir().unwrap();
    let truth = read_geometry(&sample("ground-truth.ply")).unwrap();
    // A cloud of points beside the surface, more and less far.
    let cloud: Vec<Point3<f64>> = truth
        .positions
        .iter()
        .step_by(29)
        .enumerate()
        .map(|(i, p)| p + Vector3::new(0.01, -0.02, 0.03) * ((i % 5) as f64))
        .collect();
    let rows: String = cloud
        .iter()
        .map(|p| format!("{} {} {}\n", p.x, p.y, p.z))
        .collect();
    let path = folder.path().join("cloud.xyz");
    std::fs::write(&path, rows).unwrap();
    let found = evaluate(&path, &sample("ground-truth.ply"), &["--roi", "none"]);
    let by_hand: Vec<f64> = cloud
        .iter()
        .map(|point| {
            truth
                .triangles
                .iter()
                .map(|t| distance_by_hand(point, t.map(|i| truth.positions[i as usize])))
                .fold(f64::INFINITY, f64::min)
        })
        .collect();
    let mean = by_hand.iter().sum::<f64>() / by_hand.len() as f64;
    assert!((number(&found, "/accuracy/mean") - mean).abs() < 1e-9);
    let near = by_hand.iter().filter(|d| **d < 0.05).count() as f64 / by_hand.len() as f64;
    assert!((number(&found, "/at/1/precision") - near).abs() < 1e-12);
}

#[test]
fn a_surface_is_exact_and_complete_against_itself_and_runs_give_the_same_bytes() {
    let truth = sample("ground-truth.ply");
    let found = evaluate(&truth, &truth, &[]);
    assert_eq!(number(&found, "/at/0/f"), 1.0);
    assert!(number(&found, "/accuracy/max") < 1e-9);
    let run = |threads: &str| {
        let arguments = [
            "evaluate",
            text(&truth),
            "--ground-truth",
            text(&truth),
            "--align",
            "icp",
            "--threads",
            threads,
        ];
        expect_status(0, arguments).stdout
    };
    let one = run("1");
    assert_eq!(one, run("3"));
    assert!(String::from_utf8_lossy(&one).contains("completeness"));
}

#[test]
fn trajectories_bring_another_frame_and_scale_back() {
    let folder = tempfile::tempdir().unwrap();
    let frame_of_slam = Similarity3::new(
        Vector3::new(3.0, -1.0, 2.0),
        Vector3::new(0.4, 1.0, -0.7),
        12.5,
    );
    let mut mesh = read_geometry(&sample("ground-truth.ply")).unwrap();
    mesh.transform(&frame_of_slam.to_homogeneous());
    let moved = folder.path().join("moved.ply");
    write_mesh_ply(&moved, &mesh.into_mesh()).unwrap();
    let poses = std::fs::read_to_string(sample("groundtruth.txt")).unwrap();
    let estimated: String = poses
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [x, y, z] = [1, 2, 3].map(|k| words[k].parse::<f64>().unwrap());
            let p = frame_of_slam * Point3::new(x, y, z);
            format!("{} {} {} {} 0 0 0 1\n", words[0], p.x, p.y, p.z)
        })
        .collect();
    let trajectory = folder.path().join("estimated.txt");
    std::fs::write(&trajectory, estimated).unwrap();
    let truth = sample("ground-truth.ply");
    let apart = expect_status(
        1,
        [
            "evaluate",
            text(&moved),
            "--ground-truth",
            text(&truth),
            "--samples",
            "1000",
        ],
    );
    assert!(stderr(&apart).contains("units"), "{}", stderr(&apart));
    let real_poses = sample("groundtruth.txt");
    for align in ["trajectories", "icp", "sim3"] {
        let found = evaluate(
            &moved,
            &truth,
            &[
                "--align",
                align,
                "--trajectories",
                text(&trajectory),
                text(&real_poses),
            ],
        );
        assert!(
            (number(&found, "/alignment/scale") - 0.08).abs() < 1e-5,
            "{align}"
        );
        assert!(number(&found, "/accuracy/p95") < 1e-3, "{align}: {found}");
    }
}

#[test]
fn lines_and_unobserved_parts_are_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let truth = sample("ground-truth.ply");
    let shape = read_geometry(&truth).unwrap();
    let edges: Vec<[Point3<f64>; 2]> = shape
        .triangles
        .iter()
        .step_by(50)
        .map(|t| {
            [
                shape.positions[t[0] as usize],
                shape.positions[t[1] as usize],
            ]
        })
        .collect();
    let lines = folder.path().join("lines.obj");
    write_lines_obj(&lines, &LineSet::from_segments(edges.iter().copied())).unwrap();
    let found = evaluate(&lines, &truth, &[]);
    assert_eq!(found["shape"]["kind"], "lines");
    assert_eq!(number(&found, "/vertices/count"), 2.0 * edges.len() as f64);
    assert!(number(&found, "/vertices/max") < 1e-5);
    assert!(found["completeness"].is_null());

    // A screen behind the walls, which no keyframe sees, costs precision unless it is left out.
    let mut with_screen = shape.clone();
    let (low, high) = shape.bounds().unwrap();
    let x = high.x + 1.5;
    with_screen.append(Shape {
        positions: vec![
            Point3::new(x, low.y, low.z),
            Point3::new(x, high.y, low.z),
            Point3::new(x, low.y, high.z),
        ],
        triangles: vec![[0, 1, 2]],
        colors: Some(vec![[0; 3]; 3]),
        ..Shape::default()
    });
    let path = folder.path().join("screen.ply");
    write_mesh_ply(&path, &with_screen.into_mesh()).unwrap();
    let room = sample("");
    let whole = evaluate(&path, &truth, &["--roi", "none"]);
    let observed = evaluate(
        &path,
        &truth,
        &[
            "--roi",
            "none",
            "--observed",
            text(&room),
            "--every",
            "3",
            "--far",
            "20",
        ],
    );
    assert!(number(&whole, "/at/2/precision") < 0.97);
    assert_eq!(number(&observed, "/at/0/precision"), 1.0);
    let share = number(&observed, "/observed/share");
    assert!((0.3..0.97).contains(&share), "{share}");
}

#[test]
fn an_error_picture_can_be_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let truth = sample("ground-truth.ply");
    let picture = folder.path().join("errors.glb");
    evaluate(&truth, &truth, &["--heat-map", text(&picture)]);
    let shape = read_geometry(&picture).unwrap();
    let colors = shape.colors.unwrap();
    assert!(colors.iter().all(|color| *color == [68, 1, 84]));
}

#[test]
fn bad_files_and_options_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let truth = sample("ground-truth.ply");
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path
    };
    let good = std::fs::read(&truth).unwrap();
    for (path, word) in [
        (write("cut.ply", &good[..good.len() / 2]), "cut"),
        (write("nothing.ply", b""), "empty"),
        (
            write("garbage.glb", b"glTF\x02\0\0\0\xff\xff\xff\xff"),
            "glTF",
        ),
        (write("garbage.stl", b"solid x\nfacet maybe\n"), "STL"),
        (write("garbage.obj", b"v 1 2\n"), "line 1"),
        (
            write("nan.obj", b"v 1 2 nan\nv 0 0 0\nv 1 0 0\nf 1 2 3\n"),
            "not finite",
        ),
        (write("range.obj", b"v 0 0 0\nf 1 2 3\n"), "there are 1"),
        (write("mesh.fbx", b"Kaydara"), "format is not known"),
        (folder.path().join("missing.ply"), "cannot read"),
    ] {
        for (shape, against) in [(&path, &truth), (&truth, &path)] {
            let output = linecarve(["evaluate", text(shape), "--ground-truth", text(against)]);
            let said = stderr(&output);
            let name = path.file_name().unwrap().to_str().unwrap();
            assert_eq!(output.status.code(), Some(2), "{name}: {said}");
            assert!(said.contains(name) && said.contains(word), "{name}: {said}");
            assert!(!said.contains("panicked"), "{said}");
        }
    }
    let empty = write("empty.obj", b"");
    let output = expect_status(
        1,
        ["evaluate", text(&empty), "--ground-truth", text(&truth)],
    );
    assert!(stderr(&output).contains("empty.obj"));
    let output = expect_status(
        2,
        ["evaluate", text(&truth), "--ground-truth", text(&empty)],
    );
    assert!(stderr(&output).contains("ground truth holds nothing"));
    for bad in [
        &["--thresholds", "0"][..],
        &["--samples", "0"],
        &["--roi", "1,1,1,0,0,0"],
        &["--roi", "somewhere"],
        &["--align", "trajectories"],
    ] {
        let mut arguments = vec!["evaluate", text(&truth), "--ground-truth", text(&truth)];
        arguments.extend(bad);
        expect_status(2, arguments);
    }
}
