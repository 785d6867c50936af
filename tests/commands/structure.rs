//! `linecarve structure`: planes of a mesh and of a run, the same bytes for any number of threads.

use std::fmt::Write;
use std::path::Path;

use crate::program::{expect_status, stderr, text};

/// Floor, ceiling and four walls of n by n squares of a tenth, z up, seen from inside.
fn room(n: u32) -> String {
    let mut text = String::new();
    let mut vertices = 0;
    let at = |it: u32| f64::from(it) * 0.1;
    for axis in 0..3 {
        for is_high in [false, true] {
            for j in 0..=n {
                for i in 0..=n {
                    let mut position = [0.0; 3];
                    position[axis] = if is_high { at(n) } else { 0.0 };
                    position[(axis + 1) % 3] = at(i);
                    position[(axis + 2) % 3] = at(j);
                    let [x, y, z] = position;
                    writeln!(text, "v {x:.4} {y:.4} {z:.4}").unwrap();
                }
            }
            for (j, i) in (0..n).flat_map(|j| (0..n).map(move |i| (j, i))) {
                let at = |i: u32, j: u32| vertices + j * (n + 1) + i + 1;
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                match is_high {
                    false => writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}"),
                    true => writeln!(text, "f {a} {c} {b}\nf {a} {d} {c}"),
                }
                .unwrap();
            }
            vertices += (n + 1) * (n + 1);
        }
    }
    text
}

const FILES: [&str; 8] = [
    "structure.json",
    "structure.glb",
    "structure.obj",
    "structure.mtl",
    "structure.dxf",
    "structure.ifc",
    "structure.usda",
    "plan.svg",
];

fn run(input: &Path, out: &Path, threads: &str) -> serde_json::Value {
    let [input, out] = [input, out].map(|path| path.to_str().unwrap());
    let arguments = ["structure", input, "--out", out, "--up", "0,0,1", "--json"];
    let output = expect_status(0, arguments.into_iter().chain(["--threads", threads]));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn a_room_is_six_polygons_in_every_format_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("room.obj");
    std::fs::write(&mesh, room(24)).unwrap();
    let outs = ["one", "two"].map(|name| folder.path().join(name));
    let found = run(&mesh, &outs[0], "1");
    assert_eq!(run(&mesh, &outs[1], "3"), found);
    for name in FILES {
        let [one, two] = outs
            .each_ref()
            .map(|out| std::fs::read(out.join(name)).unwrap());
        assert!(!one.is_empty() && one == two, "{name}");
    }
    assert_eq!(found["polygons"], 6);
    assert_eq!(found["corners"], 24);
    let distances = found["distances"].as_array().unwrap();
    assert_eq!(distances.len(), 3);
    for distance in distances {
        assert!(
            (distance["value"].as_f64().unwrap() - 2.4).abs() < 1e-6,
            "{distance}"
        );
    }
}

#[test]
fn what_has_no_plane_is_a_negative_result() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("one.obj");
    std::fs::write(&mesh, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let out = folder.path().join("out");
    let arguments = [
        "structure",
        mesh.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    let message = stderr(&expect_status(1, arguments));
    assert!(message.contains("no plane was found"), "{message}");
}

#[test]
fn points_are_no_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let points = folder.path().join("points.obj");
    std::fs::write(&points, "v 0 0 0\nv 1 0 0\nv 0 1 0\n").unwrap();
    let out = folder.path().join("out");
    let arguments = ["structure", text(&points), "--out", text(&out)];
    let message = stderr(&expect_status(2, arguments));
    assert!(
        message.contains("has no triangles") && message.contains("linecarve mesh"),
        "{message}"
    );
}
