//! Mesh files as other programs would read them: whole documents, read back with independent code.
// Helpers of tests stand outside of test functions, where the lints would otherwise apply.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::path::{Path, PathBuf};

use linecarve_mesh::{
    Geometry, GlbPart, LineSet, Shape, TriangleMesh, read_geometry, write_glb, write_lines_obj,
    write_lines_ply, write_mesh_obj, write_mesh_ply,
};
use nalgebra::{Point3, Vector3};

/// A tetrahedron of a given size with one corner at `corner`.
fn tetrahedron(corner: Point3<f64>, size: f64, is_colored: bool) -> TriangleMesh {
    let corners = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
    ];
    TriangleMesh {
        positions: corners.map(|c| corner + Vector3::from(c) * size).to_vec(),
        triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]],
        colors: is_colored.then(|| vec![[255, 0, 0], [0, 255, 0], [0, 0, 255], [90, 90, 90]]),
    }
}

fn edges(corner: Point3<f64>, size: f64, is_colored: bool) -> LineSet {
    let mesh = tetrahedron(corner, size, is_colored);
    LineSet {
        points: mesh.positions,
        lines: vec![[0, 1], [0, 2], [0, 3], [1, 2]],
        colors: mesh.colors,
    }
}

/// The kinds of geometry that a run may write.
fn cases() -> Vec<(&'static str, TriangleMesh, LineSet)> {
    let origin = Point3::origin();
    let utm = Point3::new(431_250.25, 5_412_300.5, 412.0);
    let single = Point3::new(1.0, 2.0, 3.0);
    vec![
        (
            "plain",
            tetrahedron(origin, 1.0, false),
            edges(origin, 1.0, false),
        ),
        (
            "colored",
            tetrahedron(origin, 2.5, true),
            edges(origin, 2.5, true),
        ),
        ("far", tetrahedron(utm, 10.0, true), edges(utm, 10.0, false)),
        ("empty", TriangleMesh::default(), LineSet::default()),
        (
            "single-vertex",
            TriangleMesh {
                positions: vec![single],
                ..TriangleMesh::default()
            },
            LineSet {
                points: vec![single],
                ..LineSet::default()
            },
        ),
        (
            "degenerate",
            TriangleMesh {
                positions: vec![single; 3],
                triangles: vec![[0, 1, 2], [0, 0, 0]],
                colors: None,
            },
            LineSet {
                points: vec![single; 2],
                lines: vec![[0, 1], [1, 1]],
                colors: None,
            },
        ),
    ]
}

fn write_all(folder: &Path) -> Vec<PathBuf> {
    let mut written = Vec::new();
    let mut path = |name: String| {
        written.push(folder.join(name));
        written[written.len() - 1].clone()
    };
    for (name, mesh, lines) in cases() {
        let origin = mesh
            .positions
            .first()
            .map_or(Vector3::zeros(), |p| p.coords.map(f64::round));
        let parts = [
            GlbPart {
                name: "surface",
                geometry: Geometry::Mesh(&mesh),
                color: [200, 190, 180],
            },
            GlbPart {
                name: "segments",
                geometry: Geometry::Lines(&lines),
                color: [255, 160, 0],
            },
        ];
        write_glb(&path(format!("{name}.glb")), &parts, &origin).unwrap();
        write_mesh_obj(&path(format!("{name}-mesh.obj")), &mesh).unwrap();
        write_mesh_ply(&path(format!("{name}-mesh.ply")), &mesh).unwrap();
        write_lines_obj(&path(format!("{name}-lines.obj")), &lines).unwrap();
        write_lines_ply(&path(format!("{name}-lines.ply")), &lines).unwrap();
    }
    write_glb(&path("no-part.glb".to_owned()), &[], &Vector3::zeros()).unwrap();
    written
}

/// Set `LINECARVE_KEEP` to a folder to keep the files, for validators outside.
#[test]
fn two_runs_write_the_same_bytes() {
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (a, b) = (write_all(first.path()), write_all(second.path()));
    for (a, b) in a.iter().zip(&b) {
        assert_eq!(
            std::fs::read(a).unwrap(),
            std::fs::read(b).unwrap(),
            "{}",
            a.display()
        );
    }
    if let Some(kept) = std::env::var_os("LINECARVE_KEEP") {
        std::fs::create_dir_all(&kept).unwrap();
        write_all(Path::new(&kept));
    }
}

#[test]
fn a_glb_gives_back_what_went_in() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    for (name, mesh, lines) in cases() {
        let bytes = std::fs::read(folder.path().join(format!("{name}.glb"))).unwrap();
        assert_eq!(bytes.len() % 4, 0);
        let document = gltf::Gltf::from_slice(&bytes).unwrap();
        let blob = document.blob.clone().unwrap_or_default();
        let scene = document.default_scene().unwrap();
        let extras: serde_json::Value =
            serde_json::from_str(scene.extras().as_ref().unwrap().get()).unwrap();
        let rows: [[f64; 4]; 4] =
            serde_json::from_value(extras["original_from_gltf"].clone()).unwrap();
        let matrix = nalgebra::Matrix4::from_fn(|r, c| rows[r][c]);
        let nodes: Vec<_> = scene.nodes().collect();
        assert_eq!(
            nodes.iter().map(|n| n.name().unwrap()).collect::<Vec<_>>(),
            ["surface", "segments"]
        );
        let expected = [
            (
                &mesh.positions,
                mesh.triangles.as_flattened(),
                gltf::mesh::Mode::Triangles,
            ),
            (
                &lines.points,
                lines.lines.as_flattened(),
                gltf::mesh::Mode::Lines,
            ),
        ];
        for (node, (points, indices, mode)) in nodes.iter().zip(expected) {
            let Some(stored) = node.mesh() else {
                assert!(indices.is_empty(), "{name}");
                continue;
            };
            let primitive = stored.primitives().next().unwrap();
            assert_eq!(primitive.mode(), mode);
            let reader = primitive.reader(|_| Some(&blob));
            let read: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            assert_eq!(read, indices, "{name}");
            for (position, point) in reader.read_positions().unwrap().zip(points) {
                let original = matrix.transform_point(&Point3::from(position).cast::<f64>());
                // Half a unit in the last place of single precision at the size of the object.
                assert!(
                    (original - point).norm() < 2e-6,
                    "{name}: {original} {point}"
                );
            }
        }
    }
}

/// Everything that the writer stores, as the reader of another project finds it.
#[test]
fn tobj_reads_every_kind_of_obj() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    for (name, mesh, lines) in cases() {
        for (kind, points, elements, width, colors) in [
            (
                "mesh",
                &mesh.positions,
                mesh.triangles.as_flattened(),
                3,
                &mesh.colors,
            ),
            (
                "lines",
                &lines.points,
                lines.lines.as_flattened(),
                2,
                &lines.colors,
            ),
        ] {
            let path = folder.path().join(format!("{name}-{kind}.obj"));
            let (models, _) = tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap();
            let at = |element: usize| format!("{name}, {kind}, element {element}");
            if elements.is_empty() {
                // A file without elements has no model.
                let read: usize = models.iter().map(|model| model.mesh.indices.len()).sum();
                assert_eq!(read, 0, "{name}, {kind}");
                continue;
            }
            assert_eq!(models.len(), 1, "{name}, {kind}");
            let read = &models[0].mesh;
            assert_eq!(read.indices.len(), elements.len(), "{name}, {kind}");
            // tobj leaves out the arities where all faces are triangles.
            assert!(read.face_arities.iter().all(|arity| *arity == width));
            assert_eq!(read.face_arities.is_empty(), width == 3, "{name}, {kind}");
            assert_eq!(!read.vertex_color.is_empty(), colors.is_some());
            for (corner, (&found, &expected)) in read.indices.iter().zip(elements).enumerate() {
                let position = Point3::from_slice(&read.positions[3 * found as usize..][..3]);
                let distance = (position - points[expected as usize]).norm();
                assert!(distance < 1e-5, "{}: {distance}", at(corner));
                if let Some(colors) = colors {
                    let stored = &read.vertex_color[3 * found as usize..][..3];
                    let stored: Vec<u8> =
                        stored.iter().map(|c| (c * 255.0).round() as u8).collect();
                    assert_eq!(stored, colors[expected as usize], "{}", at(corner));
                }
            }
        }
    }
}

#[test]
fn every_format_gives_back_the_same_shape() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    for (name, mesh, lines) in cases() {
        for kind in ["mesh", "lines"] {
            let expected = match kind {
                "mesh" => Shape::from(mesh.clone()),
                _ => Shape::from(lines.clone()),
            };
            for format in ["obj", "ply"] {
                let path = folder.path().join(format!("{name}-{kind}.{format}"));
                let read = read_geometry(&path).unwrap();
                let about = path.display();
                assert_eq!(read.triangles, expected.triangles, "{about}");
                assert_eq!(read.lines, expected.lines, "{about}");
                assert_eq!(read.positions.len(), expected.positions.len(), "{about}");
                for (found, point) in read.positions.iter().zip(&expected.positions) {
                    assert!((found - point).norm() < 1e-5, "{about}");
                }
                if !expected.positions.is_empty() {
                    assert_eq!(read.colors, expected.colors, "{about}");
                }
            }
        }
        let read = read_geometry(&folder.path().join(format!("{name}.glb"))).unwrap();
        assert_eq!(read.triangles, mesh.triangles, "{name}.glb");
        assert_eq!(read.lines.len(), lines.lines.len(), "{name}.glb");
    }
    let empty = read_geometry(&folder.path().join("no-part.glb")).unwrap();
    assert_eq!(empty, Shape::default());
}

/// The JSON document of a mesh with colours and lines without, byte for byte. `far-glb.json` was written by the
/// `gltf-json` crate.
#[test]
fn the_document_of_a_glb_keeps_its_bytes() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    let bytes = std::fs::read(folder.path().join("far.glb")).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let document = std::str::from_utf8(&bytes[20..20 + length]).unwrap();
    let expected = include_str!("far-glb.json");
    assert_eq!(document.trim_end(), expected.trim_end());
}

/// A minimal reader of binary little-endian PLY: positions, then the elements' indices.
fn read_ply(bytes: &[u8], list: bool) -> (Vec<Point3<f64>>, Vec<u32>) {
    let marker = b"end_header\n";
    let end = bytes
        .windows(marker.len())
        .position(|w| w == marker)
        .unwrap()
        + marker.len();
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"));
    let count = |element: &str| -> usize {
        let line = header
            .lines()
            .find_map(|line| line.strip_prefix(&format!("element {element} ")));
        line.unwrap().parse().unwrap()
    };
    let is_double = header.contains("property double x");
    let is_colored = header.contains("property uchar red");
    let mut rest = &bytes[end..];
    let mut take = |size: usize| {
        let (now, later) = rest.split_at(size);
        rest = later;
        now
    };
    let mut points = Vec::new();
    for _ in 0..count("vertex") {
        let mut read = || {
            if is_double {
                f64::from_le_bytes(take(8).try_into().unwrap())
            } else {
                f64::from(f32::from_le_bytes(take(4).try_into().unwrap()))
            }
        };
        points.push(Point3::new(read(), read(), read()));
        take(if is_colored { 3 } else { 0 });
    }
    let mut indices = Vec::new();
    for _ in 0..count(if list { "face" } else { "edge" }) {
        if list {
            assert_eq!(take(1), [3]);
        }
        for _ in 0..if list { 3 } else { 2 } {
            indices.push(u32::from_le_bytes(take(4).try_into().unwrap()));
        }
    }
    assert!(rest.is_empty());
    (points, indices)
}

#[test]
fn a_ply_gives_back_what_went_in() {
    let folder = tempfile::tempdir().unwrap();
    write_all(folder.path());
    for (name, mesh, lines) in cases() {
        for (kind, points, elements) in [
            ("mesh", &mesh.positions, mesh.triangles.as_flattened()),
            ("lines", &lines.points, lines.lines.as_flattened()),
        ] {
            let bytes = std::fs::read(folder.path().join(format!("{name}-{kind}.ply"))).unwrap();
            let (read, indices) = read_ply(&bytes, kind == "mesh");
            assert_eq!(indices, elements, "{name}");
            assert_eq!(read.len(), points.len());
            for (read, point) in read.iter().zip(points) {
                assert!((read - point).norm() < 2e-6, "{name}: {read} {point}");
            }
        }
    }
}

#[test]
fn a_folder_that_is_not_there_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("missing").join("mesh.ply");
    let message = write_mesh_ply(&path, &TriangleMesh::default())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("mesh.ply") && message.contains("folder exists"),
        "{message}"
    );
}
