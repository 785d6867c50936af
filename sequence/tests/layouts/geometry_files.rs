//! A small file of each format of meshes, lines and clouds; also the seeds of the fuzz target.

use std::path::Path;

use linecarve_mesh::{
    Geometry, GlbPart, LineSet, TriangleMesh, write_glb, write_lines_obj, write_mesh_obj,
    write_mesh_ply,
};
use nalgebra::{Point3, Vector3};

pub(crate) fn write_geometry_files(folder: &Path) {
    let mesh = TriangleMesh {
        positions: vec![
            Point3::origin(),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, 1.0, 0.0),
            Point3::new(0.0, 0.0, 1.0),
        ],
        triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]],
        colors: Some(vec![[10, 20, 30]; 4]),
    };
    let lines = LineSet {
        points: vec![Point3::origin(), Point3::new(1.0, 2.0, 3.0)],
        lines: vec![[0, 1]],
        colors: None,
    };
    let at = |name: &str| folder.join(name);
    let parts = [
        GlbPart {
            name: "surface",
            geometry: Geometry::Mesh(&mesh),
            color: [1, 2, 3],
        },
        GlbPart {
            name: "lines",
            geometry: Geometry::Lines(&lines),
            color: [1, 2, 3],
        },
    ];
    write_glb(&at("a.glb"), &parts, &Vector3::zeros()).unwrap();
    write_mesh_obj(&at("a.obj"), &mesh).unwrap();
    write_lines_obj(&at("b.obj"), &lines).unwrap();
    write_mesh_ply(&at("a.ply"), &mesh).unwrap();
    let texts = [
        (
            "ascii.ply",
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty double y\nproperty int z\nproperty \
             uchar red\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 2\n0 1 0 \
             3\n3 0 1 2\n",
        ),
        (
            "big.ply",
            "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float \
             z\nend_header\n\0\0\0\0\0\0\0\0\0\0\0\0",
        ),
        (
            "ascii.stl",
            "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n\
             endsolid a\n",
        ),
        (
            "a.gltf",
            r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0,"scale":[1,2,3]}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[0,0,0]}],"bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"}]}"#,
        ),
        ("rows.xyz", "0 0 0\n1 2 3 10 20 30\n"),
    ];
    for (name, text) in texts {
        std::fs::write(at(name), text).unwrap();
    }
    let mut stl = vec![0; 80];
    stl.extend(1_u32.to_le_bytes());
    for value in [
        0.0_f32, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0,
    ] {
        stl.extend(value.to_le_bytes());
    }
    stl.extend([0, 0]);
    std::fs::write(at("binary.stl"), stl).unwrap();
}
