//! `linecarve diff`: exit status, reports and the golden mesh of the sample.

use std::path::{Path, PathBuf};

use crate::program::{expect_status, linecarve, stderr, text};
use linecarve_mesh::{TriangleMesh, read_geometry, write_glb, write_mesh_obj, write_mesh_ply};
use nalgebra::Vector3;

/// Set to write the golden mesh anew in place of comparing with it.
const BLESS: &str = "LINECARVE_BLESS";

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn golden() -> PathBuf {
    project("assets/golden/room.ply")
}

fn room() -> TriangleMesh {
    read_geometry(&project("assets/room/ground-truth.ply"))
        .expect("the sample has its ground truth")
        .into_mesh()
}

#[test]
fn the_sample_gives_its_golden_mesh() {
    let out = tempfile::tempdir().unwrap();
    let sample = project("assets/room");
    expect_status(
        0,
        [
            "reconstruct",
            text(&sample),
            "--format",
            "ply",
            "--final-only",
            "--no-picture",
            "--every",
            "20",
            "--quiet",
            "--out",
            text(out.path()),
        ],
    );
    let mesh = out.path().join("mesh.ply");
    if std::env::var_os(BLESS).is_some() {
        std::fs::create_dir_all(golden().parent().unwrap()).unwrap();
        std::fs::copy(&mesh, golden()).unwrap();
        return;
    }
    // The same code gives the same bytes; the tolerance is for processors whose mathematics round otherwise.
    let output = linecarve(["diff", text(&golden()), text(&mesh), "--tolerance", "1e-6"]);
    assert_eq!(
        output.status.code(),
        Some(0),
        "{}\n{}\nIf the change is meant, write the golden mesh anew: {BLESS}=1 cargo test --test commands golden",
        String::from_utf8_lossy(&output.stdout),
        stderr(&output)
    );
}

#[test]
fn one_vertex_of_the_golden_mesh_moved_by_1_cm_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = read_geometry(&golden()).unwrap().into_mesh();
    for (vertex, direction) in [
        (0, Vector3::x()),
        (mesh.positions.len() / 2, Vector3::y()),
        (mesh.positions.len() - 1, Vector3::new(0.6, 0.0, -0.8)),
    ] {
        let mut moved = mesh.clone();
        moved.positions[vertex] += direction * 0.01;
        let path = folder.path().join("moved.ply");
        write_mesh_ply(&path, &moved).unwrap();
        let output = expect_status(1, ["diff", text(&golden()), text(&path), "--json"]);
        let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(found["is_same"], false);
        let worst = &found["worst_vertex"];
        assert_eq!(worst["vertex"], vertex, "{found}");
        let distance = worst["distance"].as_f64().unwrap();
        assert!((0.004..0.0101).contains(&distance), "{distance}");
    }
    // The distance of a vertex from its own triangles is 0 up to rounding, of which thin triangles have more.
    let golden = golden();
    let itself = ["diff", text(&golden), text(&golden), "--tolerance", "1e-6"];
    expect_status(0, itself);
}

#[test]
fn formats_of_the_same_mesh_are_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = room();
    let path = |name: &str| folder.path().join(name);
    write_mesh_obj(&path("a.obj"), &mesh).unwrap();
    let part = [linecarve_mesh::GlbPart {
        name: "room",
        geometry: linecarve_mesh::Geometry::Mesh(&mesh),
        color: [200; 3],
    }];
    write_glb(&path("a.glb"), &part, &Vector3::zeros()).unwrap();
    for name in ["a.obj", "a.glb"] {
        let expected = project("assets/room/ground-truth.ply");
        expect_status(
            0,
            [
                "diff",
                text(&expected),
                text(&path(name)),
                "--tolerance",
                "0.0001%",
            ],
        );
    }
}

#[test]
fn differences_are_reported_in_every_form() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let mut mesh = room();
    mesh.triangles.truncate(mesh.triangles.len() / 2);
    write_mesh_ply(&path("half.ply"), &mesh).unwrap();
    let expected = project("assets/room/ground-truth.ply");
    let output = expect_status(
        1,
        [
            "diff",
            text(&expected),
            text(&path("half.ply")),
            "--tolerance",
            "1%",
            "--junit",
            text(&path("report.xml")),
            "--heat-map",
            text(&path("heat.glb")),
        ],
    );
    let said = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        said.contains("DIFFERENT") && said.contains("triangle"),
        "{said}"
    );
    assert!(stderr(&output).contains("half.ply differs from"));
    let report = std::fs::read_to_string(path("report.xml")).unwrap();
    assert!(report.contains("<failure"), "{report}");
    let heat = read_geometry(&path("heat.glb")).unwrap();
    let colors = heat.colors.unwrap();
    let bright = colors.iter().filter(|color| color[0] > 150).count();
    let dark = colors.iter().filter(|color| **color == [68, 1, 84]).count();
    assert!(bright > 0 && dark > 0, "{bright} bright, {dark} dark");

    // With the topology and the missing part put up with, the rest is the same.
    expect_status(
        0,
        [
            "diff",
            text(&expected),
            text(&path("half.ply")),
            "--check",
            "orientation",
        ],
    );
}

#[test]
fn what_cannot_be_compared_is_status_2_and_an_error_in_the_report() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let expected = project("assets/room/ground-truth.ply");
    std::fs::write(path("cloud.xyz"), "0 0 0\n1 1 1\n").unwrap();
    std::fs::write(path("broken.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n").unwrap();
    for (name, word) in [
        ("cloud.xyz", "points but no triangles"),
        ("broken.obj", "broken.obj"),
        ("missing.ply", "cannot read"),
    ] {
        let report = path("report.xml");
        let output = expect_status(
            2,
            [
                "diff",
                text(&expected),
                text(&path(name)),
                "--junit",
                text(&report),
            ],
        );
        assert!(stderr(&output).contains(word), "{}", stderr(&output));
        let report = std::fs::read_to_string(report).unwrap();
        assert!(report.contains("<error"), "{report}");
    }
    for bad in ["-1", "5cm", "nan"] {
        let tolerance = format!("--tolerance={bad}");
        expect_status(2, ["diff", text(&expected), text(&expected), &tolerance]);
    }
}

#[test]
fn an_empty_mesh_differs_from_a_full_one() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("empty.ply");
    write_mesh_ply(&empty, &TriangleMesh::default()).unwrap();
    let full = project("assets/room/ground-truth.ply");
    expect_status(1, ["diff", text(&full), text(&empty)]);
    expect_status(1, ["diff", text(&empty), text(&full)]);
    expect_status(0, ["diff", text(&empty), text(&empty)]);
}
