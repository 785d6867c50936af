//! Independence of the unit of the poses: the sample in other units gives the same surface in those units.

use std::fmt::Write as _;
use std::path::Path;

use crate::program::expect_status;
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::{TriangleMesh, read_geometry};
use nalgebra::Point3;

/// Raw units of depth per metre in the sample.
const DEPTH_SCALE: f64 = 5000.0;

/// The sample with poses and depth in a unit of which `scale` make a metre.
fn in_units(scale: f64, folder: &Path) {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    for name in ["rgb", "depth"] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
        for entry in std::fs::read_dir(sample.join(name)).unwrap() {
            let entry = entry.unwrap();
            std::fs::copy(entry.path(), folder.join(name).join(entry.file_name())).unwrap();
        }
        let list = format!("{name}.txt");
        std::fs::copy(sample.join(&list), folder.join(&list)).unwrap();
    }
    let mut poses = String::new();
    for line in std::fs::read_to_string(sample.join("groundtruth.txt"))
        .unwrap()
        .lines()
    {
        let fields: Vec<&str> = line.split_whitespace().collect();
        for (place, field) in fields.iter().enumerate() {
            match field.parse::<f64>() {
                Ok(value) if (1..4).contains(&place) => write!(poses, "{} ", value * scale),
                _ => write!(poses, "{field} "),
            }
            .unwrap();
        }
        poses.push('\n');
    }
    std::fs::write(folder.join("groundtruth.txt"), poses).unwrap();
    let sidecar = std::fs::read_to_string(sample.join("linecarve.toml")).unwrap();
    let (before, after) = ("scale = 5000.0", DEPTH_SCALE / scale);
    assert!(sidecar.contains(before));
    std::fs::write(
        folder.join("linecarve.toml"),
        sidecar.replace(before, &format!("scale = {after:?}")),
    )
    .unwrap();
}

fn reconstructed(scale: f64) -> TriangleMesh {
    let folder = tempfile::tempdir().unwrap();
    let (sequence, out) = (folder.path().join("sequence"), folder.path().join("out"));
    in_units(scale, &sequence);
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let mut arguments = ["reconstruct", "--max-keyframes", "5", "--format", "obj"]
        .map(String::from)
        .to_vec();
    arguments.extend(["--final-only", "--no-picture", "--no-page", "--quiet"].map(String::from));
    arguments.extend([text(&sequence), "--out".to_owned(), text(&out)]);
    expect_status(0, arguments);
    read_geometry(&out.join("mesh.obj")).unwrap().into_mesh()
}

/// The largest coordinate.
fn extent(mesh: &TriangleMesh) -> f64 {
    let sizes = mesh.positions.iter().map(|p| p.coords.amax());
    sizes.fold(0.0, f64::max)
}

fn area(mesh: &TriangleMesh) -> f64 {
    let corners = |t: &[u32; 3]| t.map(|corner| mesh.positions[corner as usize]);
    let triangles = mesh.triangles.iter().map(corners);
    triangles
        .map(|[a, b, c]| (b - a).cross(&(c - a)).norm() / 2.0)
        .sum()
}

/// A power of two changes no digit: what is computed in `f64` and `f32` is scaled without rounding, so that only a
/// constant in units of the map could make a difference. Nothing but the decimals of the file is left to differ.
#[test]
fn a_scale_by_a_power_of_two_changes_nothing_else() {
    let expected = reconstructed(1.0);
    assert!(expected.triangles.len() > 1000);
    for scale in [1024.0, 1.0 / 1024.0] {
        let mesh = reconstructed(scale);
        assert!(mesh.triangles == expected.triangles, "scale {scale}");
        let most = 1e-6 * extent(&expected);
        for (a, b) in expected.positions.iter().zip(&mesh.positions) {
            assert!((a.coords - b.coords / scale).amax() < most, "scale {scale}");
        }
    }
}

/// With 1000 every number is rounded elsewhere, depth maps at the 24 bits of `f32`. Rounding decides which edges are collapsed, so that the
/// surfaces agree, but not their vertices.
#[test]
fn a_scale_by_a_thousand_changes_next_to_nothing() {
    let expected = reconstructed(1.0);
    let scene = RayScene::new(&expected);
    let most = 5e-3 * extent(&expected);
    for scale in [1000.0, 0.001] {
        let mut mesh = reconstructed(scale);
        for position in &mut mesh.positions {
            position.coords /= scale;
        }
        let is_near = |position: &&Point3<f64>| scene.closest(position, most).is_some();
        let near = mesh.positions.iter().filter(is_near).count();
        assert!(
            100 * near >= 95 * mesh.positions.len(),
            "scale {scale}: {near} of {}",
            mesh.positions.len()
        );
        let vertices = mesh.positions.len() as f64 / expected.positions.len() as f64;
        let ratio = area(&mesh) / area(&expected);
        assert!((vertices - 1.0).abs() < 0.05, "scale {scale}: {vertices}");
        assert!((ratio - 1.0).abs() < 0.01, "scale {scale}: {ratio}");
    }
}
