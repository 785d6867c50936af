//! `linecarve simplify`: remaining feature edges as a file.
use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

use crate::program::{expect_status, stderr};
use linecarve_mesh::feature_edges::{BOUNDARY_COLOR, CREASE_COLOR};
use linecarve_mesh::{LineSet, read_geometry};

/// A trough of two walls of n by n squares that stand upright on each other.
fn trough(n: u32) -> String {
    let mut text = String::new();
    for j in 0..=2 * n {
        for i in 0..=n {
            let (y, z) = (j.min(n), j.saturating_sub(n));
            writeln!(text, "v {i} {y} {z}").unwrap();
        }
    }
    for j in 0..2 * n {
        for i in 0..n {
            let at = |i: u32, j: u32| j * (n + 1) + i + 1;
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            writeln!(text, "f {a} {b} {c}\nf {a} {c} {d}").unwrap();
        }
    }
    text
}

fn simplified(folder: &Path, edges: &str, status: i32) -> String {
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let [mesh, out, edges] = ["trough.obj", "small.ply", edges].map(path);
    let options = ["--tolerance", "0.001", "--rim-tolerance", "0"];
    let arguments = ["simplify", &mesh, "--out", &out, "--feature-edges", &edges];
    stderr(&expect_status(status, arguments.into_iter().chain(options)))
}

#[test]
fn the_edges_that_remain_are_edges_of_the_simplified_mesh() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("trough.obj"), trough(5)).unwrap();
    let read = |name: &str| read_geometry(&folder.path().join(name)).unwrap();
    for name in ["edges.ply", "edges.obj", "edges.glb"] {
        simplified(folder.path(), name, 0);
        let lines: LineSet = read(name).into_lines();
        let colors = lines.colors.as_ref().unwrap();
        let of = |color| {
            let is_it = |line: &&[u32; 2]| line.iter().all(|end| colors[*end as usize] == color);
            lines.lines.iter().filter(is_it).count()
        };
        // Six sides around, and the one where the walls meet.
        assert_eq!((of(CREASE_COLOR), of(BOUNDARY_COLOR)), (1, 6), "{name}");
        assert_eq!(lines.lines.len(), 7);
        let mesh = read("small.ply");
        let corners: BTreeSet<_> = (mesh.positions.iter())
            .map(|p| format!("{:.3?}", p.coords))
            .collect();
        for point in &lines.points {
            assert!(
                corners.contains(&format!("{:.3?}", point.coords)),
                "{name}: {point}"
            );
        }
    }
}

#[test]
fn a_format_that_nobody_knows_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("trough.obj"), trough(2)).unwrap();
    let message = simplified(folder.path(), "edges.stl", 2);
    assert!(
        message.contains("--feature-edges")
            && message.contains("edges.stl")
            && message.contains(".ply"),
        "{message}"
    );
    assert!(!folder.path().join("small.ply").exists());
}

/// Triangles of a mesh on a wall, the floor or the ceiling of the bare room, away from skirting boards.
fn on_planes(path: &Path) -> usize {
    let mesh = read_geometry(path).unwrap();
    let is_on_plane = |triangle: &&[u32; 3]| {
        let corners = triangle.map(|corner| mesh.positions[corner as usize].coords);
        let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
        let walls = [middle.x, middle.x - 4.6, middle.y, middle.y - 3.8];
        let is_near = |distance: &f64| distance.abs() < 0.01;
        let is_inside = middle.x > -0.01;
        let is_on_wall = middle.z > 0.11 && walls.iter().any(is_near);
        is_inside && (is_on_wall || is_near(&middle.z) || is_near(&(middle.z - 2.5)))
    };
    mesh.triangles.iter().filter(is_on_plane).count()
}

/// What is plane in the truth needs a fifth of the triangles and less within two millimetres.
#[test]
fn planes_of_a_room_become_five_times_smaller() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let text = |name: &str| path(name).to_str().unwrap().to_owned();
    let [sequence, out, mesh, lines, small] = [
        "room",
        "out",
        "out/mesh.ply",
        "out/clusters.ply",
        "small.ply",
    ]
    .map(text);
    let synth = ["synth", "bare-room", "--frames", "24", "--size", "480x360"];
    expect_status(0, synth.into_iter().chain(["--out", &sequence, "--quiet"]));
    let reconstruct = ["reconstruct", &sequence, "--out", &out, "--format", "ply"];
    let quiet = ["--final-only", "--no-picture", "--no-page", "--quiet"];
    expect_status(0, reconstruct.into_iter().chain(quiet));
    let simplify = ["simplify", &mesh, "--lines", &lines, "--out", &small];
    let options = ["--tolerance", "0.002", "--json"];
    let output = expect_status(0, simplify.into_iter().chain(options));
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let number = |key: &str| result[key].as_f64().unwrap();
    assert!(number("largest_distance") <= 0.002, "{result}");
    assert!(number("mean_distance") < 0.0005, "{result}");
    assert!(
        4.0 * number("triangles") < number("triangles_before"),
        "{result}"
    );
    let [before, after] = ["out/mesh.ply", "small.ply"].map(|name| on_planes(&path(name)));
    assert!(before > 5000 && 5 * after <= before, "{before} {after}");
}
