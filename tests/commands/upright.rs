//! GLB files are upright whatever axis of the world is up, and their extras lead back to the poses.

use std::path::Path;

use linecarve_mesh::read_geometry;
use linecarve_sequence::{OpenOptions, Sequence};
use nalgebra::{Matrix4, Point3, UnitQuaternion, Vector3};

use crate::program::{expect_status, small_sequence, text};

/// The JSON chunk of a GLB file.
fn document(path: &Path) -> serde_json::Value {
    let bytes = std::fs::read(path).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&bytes[20..20 + length]).unwrap()
}

/// Bounds of the first positions of a file, and the matrix of its extras.
fn bounds_and_matrix(path: &Path) -> ([f64; 3], [f64; 3], Matrix4<f64>) {
    let document = document(path);
    let index = document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
        .as_u64()
        .unwrap();
    let accessor = &document["accessors"][index as usize];
    let bound = |key: &str| serde_json::from_value(accessor[key].clone()).unwrap();
    let extras = &document["scenes"][0]["extras"]["original_from_gltf"];
    let rows: [[f64; 4]; 4] = serde_json::from_value(extras.clone()).unwrap();
    (
        bound("min"),
        bound("max"),
        Matrix4::from_fn(|r, c| rows[r][c]),
    )
}

#[test]
fn worlds_with_any_axis_up_stand_upright() {
    let folder = small_sequence(8, "tum");
    let root = folder.path().join("sequence");
    let given = std::fs::read_to_string(root.join("groundtruth.txt")).unwrap();
    let sequence = Sequence::open(&root, &OpenOptions::default()).unwrap();
    let poses: Vec<_> = sequence
        .frames()
        .iter()
        .map(|frame| frame.world_from_camera)
        .collect();
    let up_given = linecarve_mesh::snapped_up(&linecarve_mesh::render::up_direction(&poses));
    let mut heights = Vec::new();
    for up in [
        Vector3::y(),
        Vector3::z(),
        -Vector3::y(),
        Vector3::new(0.6, 0.0, 0.8),
    ] {
        let turn = UnitQuaternion::rotation_between(&up_given, &up).unwrap_or_else(|| {
            UnitQuaternion::from_scaled_axis(Vector3::x() * std::f64::consts::PI)
        });
        let lines: String = given
            .lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| {
                let words: Vec<&str> = line.split_whitespace().collect();
                let n: Vec<f64> = words[1..]
                    .iter()
                    .map(|word| word.parse().unwrap())
                    .collect();
                let position = turn * Vector3::new(n[0], n[1], n[2]);
                let rotation = turn
                    * UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
                        n[6], n[3], n[4], n[5],
                    ));
                let q = rotation.coords;
                format!(
                    "{} {} {} {} {} {} {} {}\n",
                    words[0], position.x, position.y, position.z, q.x, q.y, q.z, q.w
                )
            })
            .collect();
        std::fs::write(root.join("groundtruth.txt"), lines).unwrap();
        let out = folder.path().join("out");
        expect_status(
            0,
            [
                "reconstruct",
                text(&root),
                "--every",
                "1",
                "--final-only",
                "--no-picture",
                "--no-page",
                "--out",
                text(&out),
            ],
        );
        let (low, high, original_from_gltf) = bounds_and_matrix(&out.join("mesh.glb"));
        heights.push(high[1] - low[1]);
        // The extras turn the up of glTF to that of the world, and the vertices to those of the PLY file.
        let up_found = original_from_gltf.transform_vector(&Vector3::y());
        let tilt = up_found.angle(&up).to_degrees();
        assert!(
            tilt < 1e-4 || (up.iter().all(|v| v.abs() < 0.9) && tilt < 25.0),
            "{up}: {up_found}"
        );
        let ply = read_geometry(&out.join("mesh.ply")).unwrap();
        let glb = read_geometry(&out.join("mesh.glb")).unwrap();
        assert_eq!(ply.positions.len(), glb.positions.len());
        let off = ply
            .positions
            .iter()
            .zip(&glb.positions)
            .map(|(a, b)| (a - b).norm())
            .fold(0.0, f64::max);
        assert!(off < 1e-4, "{up}: {off}");
        let corner = original_from_gltf.transform_point(&Point3::from(low));
        assert!(corner.iter().all(|v| v.is_finite()));
        let report: serde_json::Value =
            serde_json::from_slice(&std::fs::read(out.join("report.json")).unwrap()).unwrap();
        let reported: [f64; 3] = serde_json::from_value(report["sequence"]["up"].clone()).unwrap();
        assert!((Vector3::from(reported) - up_found).norm() < 1e-9);
        std::fs::remove_dir_all(&out).unwrap();
    }
    // The same room has the same height in all worlds with an axis up.
    assert!(
        heights[..3]
            .iter()
            .all(|height| (height / heights[0] - 1.0).abs() < 0.02),
        "{heights:?}"
    );
    // `--up` decides over the cameras.
    let out = folder.path().join("out");
    expect_status(
        0,
        [
            "reconstruct",
            text(&root),
            "--every",
            "1",
            "--final-only",
            "--no-picture",
            "--no-page",
            "--up",
            "1,0,0",
            "--out",
            text(&out),
        ],
    );
    let (_, _, original_from_gltf) = bounds_and_matrix(&out.join("mesh.glb"));
    assert_eq!(
        original_from_gltf.transform_vector(&Vector3::y()),
        Vector3::x()
    );
}

#[test]
fn a_mesh_of_points_stands_as_that_of_a_run() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (city, mesh, run) = (path("city"), path("mesh.glb"), path("run"));
    let synth = [
        "synth",
        "city",
        "--points",
        "3000",
        "-q",
        "--out",
        text(&city),
    ];
    expect_status(0, synth);
    let rotation = |path: &Path| {
        bounds_and_matrix(path)
            .2
            .fixed_view::<3, 3>(0, 0)
            .into_owned()
    };
    let cloud = city.join("fused.ply");
    let make = |more: &[&str]| {
        let command = ["mesh", text(&cloud), "-q", "--out", text(&mesh)];
        expect_status(0, command.iter().chain(more));
        rotation(&mesh)
    };
    for up in [&[][..], &["--up", "0,0,1"], &["--up", "1,2,2"]] {
        let what = ["reconstruct", text(&cloud), "--from", "map-points"];
        let how = [
            "--final-only",
            "--no-page",
            "--no-picture",
            "-q",
            "--out",
            text(&run),
        ];
        expect_status(0, what.iter().chain(&how).chain(up));
        assert_eq!(make(up), rotation(&run.join("mesh.glb")), "{up:?}");
    }
    let up = make(&["--up", "1,2,2"]) * Vector3::y();
    assert!((up - Vector3::new(1.0, 2.0, 2.0) / 3.0).norm() < 1e-12);
}
