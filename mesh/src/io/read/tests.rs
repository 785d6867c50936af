use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use proptest::prelude::*;

use super::*;
use crate::{
    Geometry, GlbPart, LineSet, ShapeKind, TriangleMesh, write_glb, write_lines_obj,
    write_lines_ply, write_mesh_obj, write_mesh_ply,
};

/// A house: a box with a roof, not symmetric in any axis, with a colour for each vertex.
fn house(offset: f64) -> TriangleMesh {
    let points = [
        [0.0, 0.0, 0.0],
        [4.0, 0.0, 0.0],
        [4.0, 2.5, 0.0],
        [0.0, 2.5, 0.0],
        [0.0, 0.0, 6.0],
        [4.0, 0.0, 6.0],
        [4.0, 2.5, 6.0],
        [0.0, 2.5, 6.0],
        [2.0, 3.75, 1.0],
    ];
    let mut mesh = TriangleMesh {
        positions: points.map(Point3::from).to_vec(),
        triangles: vec![
            [0, 1, 2],
            [0, 2, 3],
            [4, 6, 5],
            [4, 7, 6],
            [3, 2, 8],
            [6, 7, 8],
        ],
        colors: Some((0..9).map(|i| [i * 28, 255 - i * 20, i * i]).collect()),
    };
    mesh.translate(&Vector3::repeat(offset));
    mesh
}

fn edges() -> LineSet {
    LineSet::from_segments([
        [Point3::new(0.25, 0.5, -1.0), Point3::new(1.0, 2.0, 3.0)],
        [Point3::new(-7.0, 0.0, 0.0), Point3::new(0.0, 8.0, 0.5)],
    ])
}

fn written(name: &str, write: impl FnOnce(&Path) -> Result<(), crate::MeshFileError>) -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    write(&path).unwrap();
    std::fs::read(path).unwrap()
}

fn read_bytes(name: &str, bytes: &[u8]) -> Result<Shape, ReadError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    read_geometry(&path)
}

fn glb(origin: f64) -> Vec<u8> {
    let (mesh, lines) = (house(origin), edges());
    let parts = [
        GlbPart {
            name: "surface",
            geometry: Geometry::Mesh(&mesh),
            color: [9; 3],
        },
        GlbPart {
            name: "segments",
            geometry: Geometry::Lines(&lines),
            color: [9; 3],
        },
    ];
    written("out.glb", |path| {
        write_glb(path, &parts, &Vector3::repeat(origin))
    })
}

#[test]
fn what_the_program_writes_reads_back_in_the_frame_of_the_poses() {
    let (mesh, lines) = (house(1000.0), edges());
    for (name, bytes) in [
        (
            "a.obj",
            written("a.obj", |path| write_mesh_obj(path, &mesh)),
        ),
        (
            "a.ply",
            written("a.ply", |path| write_mesh_ply(path, &mesh)),
        ),
    ] {
        let shape = read_bytes(name, &bytes).unwrap();
        assert_eq!(shape, Shape::from(mesh.clone()), "{name}");
    }
    for (name, bytes) in [
        (
            "a.obj",
            written("a.obj", |path| write_lines_obj(path, &lines)),
        ),
        (
            "a.ply",
            written("a.ply", |path| write_lines_ply(path, &lines)),
        ),
    ] {
        let shape = read_bytes(name, &bytes).unwrap();
        assert_eq!(shape.kind(), ShapeKind::Lines);
        assert_eq!(shape, Shape::from(lines.clone()), "{name}");
    }
    let shape = read_bytes("a.glb", &glb(1000.0)).unwrap();
    assert_eq!(shape.positions[..9], mesh.positions);
    assert_eq!(shape.triangles, mesh.triangles);
    assert_eq!(shape.lines, [[9, 10], [11, 12]]);
    // Two nodes, one without colours: colours are kept for all points or not at all.
    assert_eq!(shape.colors, None);
    let alone = [GlbPart {
        name: "surface",
        geometry: Geometry::Mesh(&mesh),
        color: [9; 3],
    }];
    let bytes = written("out.glb", |path| {
        write_glb(path, &alone, &Vector3::repeat(1000.0))
    });
    assert_eq!(read_bytes("a.glb", &bytes).unwrap().colors, mesh.colors);
}

/// A document with the buffer inside: three points, then indices 0 to 2 as bytes.
fn document(mode: u32, nodes: &str, scene_extras: &str) -> String {
    let mut bytes = Vec::new();
    for value in [0.0_f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 2.0, 0.0] {
        bytes.extend(value.to_le_bytes());
    }
    bytes.extend([0, 1, 2, 0]);
    let data = base64::Engine::encode(&base64::engine::general_purpose::STANDARD, &bytes);
    format!(
        r#"{{"asset": {{"version": "2.0"}}, "scene": 0, "scenes": [{{"nodes": [0]{scene_extras}}}], "nodes": [{nodes}],
        "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "indices": 1, "mode": {mode}}}]}}],
        "buffers": [{{"byteLength": 40, "uri": "data:application/octet-stream;base64,{data}"}}],
        "bufferViews": [{{"buffer": 0, "byteLength": 36}}, {{"buffer": 0, "byteOffset": 36, "byteLength": 3}}],
        "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 2, 0]}},
                      {{"bufferView": 1, "componentType": 5121, "count": 3, "type": "SCALAR"}}]}}"#
    )
}

#[test]
fn modes_and_nodes_of_gltf_are_followed() {
    let plain = r#"{"mesh": 0}"#;
    let read = |mode, nodes| read_bytes("a.gltf", document(mode, nodes, "").as_bytes()).unwrap();
    assert_eq!(read(0, plain).kind(), ShapeKind::Cloud);
    assert_eq!(read(2, plain).lines, [[0, 1], [1, 2], [2, 0]]);
    assert_eq!(read(3, plain).lines, [[0, 1], [1, 2]]);
    for mode in [4, 5, 6] {
        assert_eq!(read(mode, plain).triangles, [[0, 1, 2]], "mode {mode}");
    }
    // A child moved within a parent that doubles, seen in a mirror: what was in front stays in front.
    let nested =
        r#"{"children": [1], "scale": [-2, 2, 2]}, {"mesh": 0, "translation": [10, 0, 0]}"#;
    let shape = read(4, nested);
    assert_eq!(shape.positions[1], Point3::new(-22.0, 0.0, 0.0));
    assert_eq!(shape.triangles, [[0, 2, 1]]);
}

/// Exact: both compute in single precision, in the same order.
#[test]
fn node_transforms_agree_with_the_gltf_crate() {
    let nodes = [
        r#"{"mesh": 0, "translation": [1.5, -2, 3], "rotation": [0.1, -0.2, 0.3, 0.9], "scale": [2, 3.1, -0.5]}"#,
        r#"{"mesh": 0, "rotation": [0.70710677, 0, 0, 0.70710677]}"#,
        r#"{"mesh": 0, "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 2, 0, 0.1, 0.2, 0.3, 1]}"#,
    ];
    for node in nodes {
        let text = document(4, node, "");
        let theirs = ::gltf::Gltf::from_slice(text.as_bytes()).unwrap();
        let matrix = theirs.nodes().next().unwrap().transform().matrix();
        let matrix = nalgebra::Matrix4::<f32>::from(matrix).cast::<f64>();
        let points = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        let expected = points.map(|point| matrix.transform_point(&Point3::from(point)));
        let shape = read_bytes("a.gltf", text.as_bytes()).unwrap();
        assert_eq!(shape.positions, expected, "{node}");
    }
}

#[test]
fn every_index_of_gltf_is_checked() {
    let good = document(4, r#"{"mesh": 0}"#, "");
    for (from, to, word) in [
        ("\"POSITION\": 0", "\"POSITION\": 2", "accessor 2"),
        ("\"indices\": 1", "\"indices\": 9", "accessor 9"),
        ("\"mode\": 4", "\"mode\": 4, \"material\": 0", "material 0"),
        ("\"mode\": 4", "\"mode\": 7", "its mode"),
        (
            "\"buffer\": 0, \"byteOffset\"",
            "\"buffer\": 1, \"byteOffset\"",
            "buffer 1",
        ),
        ("\"bufferView\": 1", "\"bufferView\": 2", "buffer view 2"),
        ("\"bufferView\": 1, ", "", "no data"),
        ("{\"mesh\": 0}", "{\"mesh\": 1}", "mesh 1"),
        (
            "{\"mesh\": 0}",
            "{\"mesh\": 0, \"children\": [5]}",
            "node 5",
        ),
        ("\"nodes\": [0]", "\"nodes\": [3]", "node 3"),
        ("\"scene\": 0", "\"scene\": 4", "scene 4"),
        ("\"min\": [0, 0, 0], ", "", "min and max"),
        ("\"POSITION\"", "\"NORMAL\"", "no positions"),
        ("\"type\": \"VEC3\"", "\"type\": \"VEC5\"", "its type"),
        ("\"asset\"", "\"assets\"", "asset"),
        (
            "\"scene\": 0",
            "\"scene\": 0, \"extensionsRequired\": [\"KHR_draco_mesh_compression\"]",
            "uncompressed",
        ),
        (
            "\"scene\": 0",
            "\"scene\": 0, \"extensionsRequired\": [\"EXT_unknown\"]",
            "EXT_unknown",
        ),
    ] {
        assert!(good.contains(from), "{from}");
        let damaged = good.replacen(from, to, 1);
        let message = read_bytes("a.gltf", damaged.as_bytes()).unwrap_err();
        let message = message.to_string();
        assert!(message.contains(word), "{to}: {message}");
    }
    let unlit = "\"scene\": 0, \"extensionsRequired\": [\"KHR_materials_unlit\"]";
    let unlit = good.replacen("\"scene\": 0", unlit, 1);
    assert!(read_bytes("a.gltf", unlit.as_bytes()).is_ok());
}

/// Found by fuzzing.
#[test]
fn a_binary_file_shorter_than_its_header_is_told() {
    let found = b"glTF\xff\0\0\0\0\0\0\0K\x1b";
    for length in 0..found.len() {
        assert!(read_bytes("a.glb", &found[..length]).is_err());
    }
    let message = read_bytes("a.glb", found).unwrap_err().to_string();
    assert!(
        message.contains("a.glb") && message.contains("at least 20"),
        "{message}"
    );
}

#[test]
fn damaged_gltf_is_told() {
    let good = document(4, r#"{"mesh": 0}"#, "");
    for (text, word) in [
        (
            document(4, r#"{"mesh": 0, "children": [0]}"#, ""),
            "node 0 has two parents",
        ),
        (
            document(
                4,
                r#"{"mesh": 0}"#,
                r#", "extras": {"original_from_gltf": [1]}"#,
            ),
            "original_from_gltf",
        ),
        (good.replace("\"count\": 3", "\"count\": 4000000000"), "fit"),
        (
            good.replace("\"byteOffset\": 36", "\"byteOffset\": 39"),
            "not there",
        ),
        (
            good.replace("\"byteLength\": 40", "\"byteLength\": 400"),
            "40",
        ),
        (good.replace("base64,", "base64,!"), "data URI"),
        (
            good.replace("data:application/octet-stream;base64,", "missing.bin?"),
            "missing.bin",
        ),
        (good[..good.len() - 5].to_owned(), "a.gltf"),
        (good.replace("5121", "5122"), ""),
    ] {
        let message = read_bytes("a.gltf", text.as_bytes())
            .unwrap_err()
            .to_string();
        assert!(
            message.contains(word) && message.contains("a.gltf"),
            "{word}: {message}"
        );
    }
}

/// Nodes that double at each level would take 2^40 steps.
#[test]
fn nodes_are_reached_once_and_may_be_nested_deeply() {
    let chain = |count: usize, children: fn(usize) -> String| {
        let nodes = (1..=count).map(|it| format!("{{\"children\": [{}]}}, ", children(it)));
        document(4, &(nodes.collect::<String>() + r#"{"mesh": 0}"#), "")
    };
    let doubled = chain(40, |it| format!("{it}, {it}"));
    let message = read_bytes("a.gltf", doubled.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(message.contains("node 40 has two parents"), "{message}");
    let deep = chain(1000, |it| it.to_string());
    assert_eq!(
        read_bytes("a.gltf", deep.as_bytes())
            .unwrap()
            .triangles
            .len(),
        1
    );
    // A cycle behind the first node.
    let cycle = document(
        4,
        r#"{"children": [1]}, {"mesh": 0, "children": [2]}, {"children": [1]}"#,
        "",
    );
    let message = read_bytes("a.gltf", cycle.as_bytes())
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("node 1 has two parents or contains itself"),
        "{message}"
    );
}

#[test]
fn copies_of_a_mesh_are_bounded() {
    let instances = |count: usize| {
        let points = vec![0_u8; 12 * 5_000];
        let data = base64::Engine::encode(&base64::engine::general_purpose::STANDARD, &points);
        let nodes = vec![r#"{"mesh": 0}"#; count].join(",");
        let roots: Vec<String> = (0..count).map(|it| it.to_string()).collect();
        let roots = roots.join(",");
        format!(
            r#"{{"asset": {{"version": "2.0"}}, "scenes": [{{"nodes": [{roots}]}}], "nodes": [{nodes}],
            "meshes": [{{"primitives": [{{"attributes": {{"POSITION": 0}}, "mode": 0}}]}}],
            "buffers": [{{"byteLength": 60000, "uri": "data:application/octet-stream;base64,{data}"}}],
            "bufferViews": [{{"buffer": 0, "byteLength": 60000}}],
            "accessors": [{{"bufferView": 0, "componentType": 5126, "count": 5000, "type": "VEC3", "min": [0, 0, 0], "max": [0, 0, 0]}}]}}"#
        )
    };
    let shape = read_bytes("a.gltf", instances(50).as_bytes()).unwrap();
    assert_eq!(shape.positions.len(), 250_000);
    let message = read_bytes("a.gltf", instances(20_000).as_bytes())
        .unwrap_err()
        .to_string();
    assert!(message.contains("fewer copies"), "{message}");
}

#[test]
fn unknown_missing_and_not_finite_are_refused_by_name() {
    let message = |name: &str, bytes: &[u8]| read_bytes(name, bytes).unwrap_err().to_string();
    assert!(message("a.blend", b"BLENDER").contains("PLY, OBJ, STL"));
    assert!(message("noextension", b"").contains("not known"));
    assert!(message("a.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").contains("vertex 0"));
    assert!(message("a.obj", b"v 0 0 0\nf 1 2 9\n").contains("refers to vertex 1"));
    assert!(message("a.txt", b"1 2 inf\n").contains("not finite"));
    assert!(message("a.ply", b"").contains("empty"));
    let error = read_geometry(&PathBuf::from("nowhere.ply")).unwrap_err();
    assert!(error.to_string().contains("nowhere.ply"));
    // The content decides where it can.
    let ply = written("a.ply", |path| write_mesh_ply(path, &house(0.0)));
    assert_eq!(read_bytes("a.mesh", &ply).unwrap().triangles.len(), 6);
}

#[test]
fn libraries_read_the_same_from_obj() {
    let bytes = written("a.obj", |path| write_mesh_obj(path, &house(0.0)));
    let (models, _) = tobj::load_obj_buf(&mut &bytes[..], &tobj::LoadOptions::default(), |_| {
        Err(tobj::LoadError::OpenFileFailed)
    })
    .unwrap();
    let shape = read_bytes("a.obj", &bytes).unwrap();
    let flat: Vec<f64> = shape
        .positions
        .iter()
        .flat_map(|p| [p.x, p.y, p.z])
        .collect();
    let theirs: Vec<f64> = models[0]
        .mesh
        .indices
        .iter()
        .flat_map(|i| models[0].mesh.positions[3 * *i as usize..][..3].to_vec())
        .collect();
    let ours: Vec<f64> = shape
        .triangles
        .as_flattened()
        .iter()
        .flat_map(|i| flat[3 * *i as usize..][..3].to_vec())
        .collect();
    assert_eq!(ours, theirs);
}

/// Why OBJ is parsed here; when this fails, `tobj` may take over.
#[test]
fn libraries_lose_polylines_and_clouds() {
    let theirs = |text: &str| {
        let no_materials = |_: &Path| Err(tobj::LoadError::OpenFileFailed);
        let options = tobj::LoadOptions::default();
        tobj::load_obj_buf(&mut text.as_bytes(), &options, no_materials)
    };
    let points = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let (models, _) = theirs(points).unwrap();
    assert!(models.iter().all(|model| model.mesh.positions.is_empty()));
    assert_eq!(
        read_bytes("a.obj", points.as_bytes())
            .unwrap()
            .positions
            .len(),
        4
    );

    let polyline = format!("{points}l 1 2 3\n");
    let (models, _) = theirs(&polyline).unwrap();
    assert_eq!(models[0].mesh.indices.len(), 3);
    assert!(models[0].mesh.face_arities.is_empty(), "a triangle");
    let shape = read_bytes("a.obj", polyline.as_bytes()).unwrap();
    assert_eq!((shape.lines.len(), shape.triangles.len()), (2, 0));

    let reversed = format!("{points}f 3 2 1\n");
    let (models, _) = theirs(&reversed).unwrap();
    assert_eq!(models[0].mesh.positions[..3], [1.0, 1.0, 0.0]);
    let shape = read_bytes("a.obj", reversed.as_bytes()).unwrap();
    assert_eq!(shape.triangles, [[2, 1, 0]]);
}

/// One good file of each kind.
fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let mesh = house(0.0);
    let mut stl = vec![b' '; 80];
    stl.extend(2_u32.to_le_bytes());
    stl.extend([7; 100]);
    vec![
        ("a.glb", glb(0.0)),
        ("a.gltf", document(4, r#"{"mesh": 0}"#, "").into_bytes()),
        (
            "a.ply",
            written("a.ply", |path| write_mesh_ply(path, &mesh)),
        ),
        (
            "b.ply",
            b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
              element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
                .to_vec(),
        ),
        (
            "a.obj",
            written("a.obj", |path| write_mesh_obj(path, &mesh)),
        ),
        ("a.stl", stl),
        (
            "b.stl",
            b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"
                .to_vec(),
        ),
        ("a.xyz", b"0 0 0\n1 2 3\n4 5 6\n".to_vec()),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// Whatever happens to a file, reading ends with a valid shape or a message.
    #[test]
    fn damage_never_panics(
        which in 0_usize..8,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..6),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let (name, mut bytes) = samples().swap_remove(which);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(shape) = read_bytes(name, &bytes) {
            prop_assert_eq!(shape.validate(), Ok(()));
        }
    }
}

#[test]
fn utf16_is_refused_by_its_name() {
    let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    let units = || std::iter::once(0xFEFF).chain(text.encode_utf16());
    let little: Vec<u8> = units().flat_map(u16::to_le_bytes).collect();
    let big: Vec<u8> = units().flat_map(u16::to_be_bytes).collect();
    for (name, bytes) in [("a.obj", &little), ("b.obj", &big), ("c.xyz", &little)] {
        let message = read_bytes(name, bytes).unwrap_err().to_string();
        assert!(
            message.ends_with("its encoding is UTF-16; save it as UTF-8"),
            "{message}"
        );
    }
}
