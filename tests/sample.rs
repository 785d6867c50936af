//! The sample that the project ships, against the analytic surface that it was rendered from.

mod program;

use std::path::Path;

use linecarve::mesh::{LineSet, read_geometry};
use linecarve::raycast::RayScene;
use linecarve::synth::{Scene, SceneKind};
use nalgebra::{Point3, Vector3};
use program::expect_status;

/// Along segments a sample is taken this often, in metres.
const STEP_M: f64 = 0.01;
/// What counts as on the surface, in metres.
const NEAR_M: f64 = 0.005;

/// Distances of points to the surface of the room.
fn distances<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Vec<f64> {
    let room = RayScene::new(&Scene::of(SceneKind::Room).mesh());
    points
        .into_iter()
        .map(|point| {
            room.closest(point, f64::INFINITY)
                .expect("the room has triangles")
                .distance
        })
        .collect()
}

/// Points every [`STEP_M`] along the lines.
fn samples(lines: &LineSet) -> Vec<Point3<f64>> {
    let mut samples = Vec::new();
    for [a, b] in &lines.lines {
        let (a, b) = (lines.points[*a as usize], lines.points[*b as usize]);
        let parts = ((b - a).norm() / STEP_M).ceil().max(1.0) as usize;
        samples.extend((0..=parts).map(|part| a + (b - a) * (part as f64 / parts as f64)));
    }
    samples
}

fn run_on_sample(command: &str, out: &Path) {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let mut arguments = vec![
        command,
        sample.to_str().expect("the path of the project is UTF-8"),
        "--format",
        "obj",
        "--quiet",
        "--out",
        out.to_str().expect("temporary paths are UTF-8"),
    ];
    if command == "reconstruct" {
        arguments.extend(["--final-only", "--no-picture"]);
    }
    expect_status(0, arguments);
}

#[test]
fn segments_and_clusters_lie_on_the_surface() {
    let out = tempfile::tempdir().unwrap();
    run_on_sample("lines", out.path());
    for (name, least_count) in [("segments.obj", 5000), ("clusters.obj", 500)] {
        let lines = read_geometry(&out.path().join(name)).unwrap().into_lines();
        assert!(
            lines.lines.len() >= least_count,
            "{name}: {}",
            lines.lines.len()
        );
        let distances = distances(&samples(&lines));
        let near = distances
            .iter()
            .filter(|distance| **distance < NEAR_M)
            .count();
        let share = near as f64 / distances.len() as f64;
        assert!(share >= 0.95, "{name}: {share:.4} within 5 mm");
    }
}

#[test]
fn the_surface_follows_the_room() {
    let out = tempfile::tempdir().unwrap();
    run_on_sample("reconstruct", out.path());
    let mesh = read_geometry(&out.path().join("mesh.obj"))
        .unwrap()
        .into_mesh();
    assert!(mesh.triangles.len() > 10_000, "{}", mesh.triangles.len());

    // Vertices are measured points: exact depth leaves only pixels and fits to err.
    let at_vertices = distances(&mesh.positions);
    let mean = at_vertices.iter().sum::<f64>() / at_vertices.len() as f64;
    assert!(mean < 0.004, "vertices lie {mean:.5} m off on average");

    // So do the triangles between them: none spans a shadow, or free space that no ray crossed.
    let corners = |triangle: &[u32; 3]| triangle.map(|corner| mesh.positions[corner as usize]);
    let centers: Vec<Point3<f64>> = mesh
        .triangles
        .iter()
        .map(|triangle| {
            Point3::from(
                corners(triangle)
                    .map(|p| p.coords)
                    .iter()
                    .sum::<Vector3<f64>>()
                    / 3.0,
            )
        })
        .collect();
    let (mut error, mut area) = (0.0, 0.0);
    for (distance, triangle) in distances(&centers).iter().zip(&mesh.triangles) {
        let [a, b, c] = corners(triangle);
        let share = (b - a).cross(&(c - a)).norm();
        error += share * distance;
        area += share;
    }
    let mean = error / area;
    assert!(mean < 0.006, "triangles lie {mean:.5} m off on average");

    // The program turns triangles towards free space, where the cameras were.
    let edges_used_twice = {
        let mut uses = std::collections::HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                *uses.entry((*from, *to)).or_insert(0_usize) += 1;
            }
        }
        uses.values().filter(|count| **count > 1).count()
    };
    assert_eq!(
        edges_used_twice, 0,
        "directed edges that two triangles share"
    );
}
