//! The sample of the project against the analytic surface from which it was rendered.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::program::{expect_status, reconstruct_mesh};
use linecarve_mesh::evaluate::{EvaluationOptions, evaluate};
use linecarve_mesh::feature_edges::CREASE_COLOR;
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::{LineSet, Shape, TriangleMesh, read_geometry};
use linecarve_synth::{Scene, SceneKind};
use nalgebra::{Isometry3, Point3, Vector3};

/// Along segments a sample is taken this often, in metres.
const STEP_M: f64 = 0.01;
/// What counts as on the surface, in metres.
const NEAR_M: f64 = 0.005;
/// Half of the samples along segments are nearer to the surface, in metres.
const MEDIAN_M: f64 = 0.00005;
/// Least area of the ceiling in the mesh, in square metres, of 12.7 that keyframes observe.
const CEILING_M2: f64 = 11.0;

/// Distances of points to the surface of the room.
fn distances<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Vec<f64> {
    let room = RayScene::new(&Scene::new(SceneKind::Room).mesh());
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

fn run_on_sample(command: &str, more: &[&str], out: &Path) {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let mut arguments = vec![
        command,
        sample.to_str().expect("the path of the project is UTF-8"),
        "--format",
        "ply",
        "--quiet",
        "--out",
        out.to_str().expect("temporary paths are UTF-8"),
    ];
    arguments.extend(more);
    expect_status(0, arguments);
}

#[test]
fn segments_and_clusters_lie_on_the_surface() {
    let out = tempfile::tempdir().unwrap();
    run_on_sample("lines", &[], out.path());
    for (name, least_count) in [("segments.ply", 5000), ("clusters.ply", 500)] {
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
        // Depth is exact, and is that of the edge: what is left is noise of the edge along slanted surfaces.
        let mut sorted = distances;
        sorted.sort_unstable_by(f64::total_cmp);
        let median = sorted[sorted.len() / 2];
        assert!(median <= MEDIAN_M, "{name}: median {median:.6} m");
    }
}

#[test]
fn the_surface_follows_the_room() {
    let out = tempfile::tempdir().unwrap();
    run_on_sample("reconstruct", &["--final-only", "--no-picture"], out.path());
    let mesh = read_geometry(&out.path().join("mesh.ply"))
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

    demand_scores(&mesh);

    // The ceiling is measured without error, so that it lies on the convex hull of all points.
    let ceiling: f64 = mesh
        .triangles
        .iter()
        .map(corners)
        .filter(|triangle| triangle.iter().all(|p| (p.z - 2.5).abs() < 0.01))
        .map(|[a, b, c]| 0.5 * (b - a).cross(&(c - a)).norm())
        .sum();
    assert!(
        ceiling > CEILING_M2,
        "{ceiling:.2} square metres of ceiling"
    );

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

    let edges = read_geometry(&out.path().join("feature-edges.ply"))
        .unwrap()
        .into_lines();
    demand_edges_of(&mesh, &edges);
    // The screen and the books hide most of what is close to the back of the desk.
    demand_tables(&edges, 0.84, [0.9, 0.75, 0.25, 0.8]);
    let colors = edges.colors.clone().expect("kinds are told by colours");
    let mut creases = edges;
    creases
        .lines
        .retain(|line| colors[line[0] as usize] == CREASE_COLOR);
    demand_creases(&creases);
}

/// F against what the keyframes of the sample observed is 0.970 at 2 cm and 0.990 at 5 cm; what is missing may grow by a tenth.
fn demand_scores(mesh: &TriangleMesh) {
    let truth = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room/ground-truth-observed.ply");
    let [near, far] = scores(mesh, &truth);
    assert!(near > 0.967 && far > 0.989, "{near:.4} {far:.4}");
    assert!(mesh.positions.len() < 20_900, "{}", mesh.positions.len());
}

/// F of a mesh at 2 and 5 cm.
fn scores(mesh: &TriangleMesh, truth: &Path) -> [f64; 2] {
    let truth = read_geometry(truth).unwrap();
    let mut options = EvaluationOptions::default();
    options.samples = 50_000;
    let score = evaluate(&Shape::from(mesh.clone()), &truth, &options).unwrap();
    [0, 1].map(|at| score.at[at].f.expect("the truth is a mesh"))
}

#[test]
fn the_last_keyframe_has_the_final_surface() {
    let [each, once] = [(); 2].map(|()| tempfile::tempdir().unwrap());
    run_on_sample(
        "reconstruct",
        &["--every", "6", "--format", "glb", "--no-picture"],
        each.path(),
    );
    run_on_sample(
        "reconstruct",
        &[
            "--every",
            "6",
            "--format",
            "glb",
            "--no-picture",
            "--final-only",
        ],
        once.path(),
    );
    let bytes = |path: &Path| std::fs::read(path).unwrap();
    let mesh = bytes(&each.path().join("mesh.glb"));
    assert!(mesh == bytes(&once.path().join("mesh.glb")));
    let mut keyframes: Vec<_> = std::fs::read_dir(each.path().join("keyframes"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    keyframes.sort();
    assert!(keyframes.len() >= 5);
    let [mesh, last] = [each.path().join("mesh.glb"), keyframes.pop().unwrap()]
        .map(|path| read_geometry(&path).unwrap().into_mesh());
    assert!(mesh.positions == last.positions && mesh.triangles == last.triangles);
    assert!(mesh.colors == last.colors);
}

#[test]
fn a_noisy_room_is_carved_within_bounds() {
    let folder = tempfile::tempdir().unwrap();
    let room = folder.path().join("room");
    let text = |path: &Path| path.to_str().expect("temporary paths are UTF-8").to_owned();
    expect_status(
        0,
        [
            "synth",
            "room",
            "--frames",
            "20",
            "--size",
            "320x240",
            "--noise",
            "kinect",
            "--quiet",
            "--out",
            &text(&room),
        ],
    );
    let out = folder.path().join("out");
    reconstruct_mesh(0, &room, &[], &out);
    let mesh = read_geometry(&out.join("mesh.ply")).unwrap().into_mesh();
    // 0.911 at 2 cm and 0.974 at 5 cm; what is missing may grow by a tenth.
    let [near, far] = scores(&mesh, &room.join("ground-truth-observed.ply"));
    assert!(near > 0.902 && far > 0.971, "{near:.4} {far:.4}");
    assert!(mesh.positions.len() < 10_600, "{}", mesh.positions.len());
}

/// Every line joins two vertices that a triangle joins, and none is there twice.
fn demand_edges_of(mesh: &TriangleMesh, lines: &LineSet) {
    let edge = |p: &Point3<f64>, q: &Point3<f64>| {
        let [p, q] = [p, q].map(|point| <[f64; 3]>::from(point.coords).map(f64::to_bits));
        (p.min(q), p.max(q))
    };
    let mut of_mesh = BTreeSet::new();
    for triangle in &mesh.triangles {
        let corners = triangle.map(|corner| &mesh.positions[corner as usize]);
        of_mesh.extend((0..3).map(|k| edge(corners[k], corners[(k + 1) % 3])));
    }
    let mut seen = BTreeSet::new();
    for [a, b] in &lines.lines {
        let edge = edge(&lines.points[*a as usize], &lines.points[*b as usize]);
        assert!(of_mesh.contains(&edge), "{edge:?} is no edge of the mesh");
        assert!(seen.insert(edge), "{edge:?} is there twice");
    }
    assert!(seen.len() > 2000, "{}", seen.len());
}

/// The four sides of a table's top: front, east, back, west. `size` has half of its width and depth, and its height.
fn table_top(place: Isometry3<f64>, size: [f64; 3]) -> [[Point3<f64>; 2]; 4] {
    let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| place * Point3::new(x * size[0], y * size[1], size[2]));
    [0, 1, 2, 3].map(|k| [corners[k], corners[(k + 1) % 4]])
}

/// The share of a side along which lines of its direction lie.
fn share_found([from, to]: [Point3<f64>; 2], lines: &[[Point3<f64>; 2]]) -> f64 {
    // 15 degrees.
    const ALONG_COSINE: f64 = 0.966;
    let direction = (to - from).normalize();
    let along: Vec<_> = lines
        .iter()
        .filter(|[p, q]| (q - p).dot(&direction).abs() >= ALONG_COSINE * (q - p).norm())
        .collect();
    let samples = samples(&LineSet::from_segments([[from, to]]));
    let is_near = |point: &&Point3<f64>| along.iter().any(|line| apart(point, line) < NEAR_M);
    samples.iter().filter(is_near).count() as f64 / samples.len() as f64
}

/// Distance of a point from a segment.
fn apart(point: &Point3<f64>, [p, q]: &[Point3<f64>; 2]) -> f64 {
    let t = (point - p).dot(&(q - p)) / (q - p).norm_squared();
    (p + (q - p) * t.clamp(0.0, 1.0) - point).norm()
}

/// The outlines of table tops are among the feature edges of the mesh: these shares of them at least, of the desk those of its front, east, back, and
/// west.
fn demand_tables(edges: &LineSet, least_of_coffee_table: f64, least_of_desk: [f64; 4]) {
    let edges: Vec<_> = edges
        .lines
        .iter()
        .map(|line| line.map(|end| edges.points[end as usize]))
        .collect();
    let found = |place, size| table_top(place, size).map(|side| share_found(side, &edges));
    // Few keyframes see the east and west sides of the coffee table.
    let turned = Isometry3::new(Vector3::new(2.35, 1.88, 0.0), Vector3::z() * 0.06);
    let coffee = found(turned, [0.475, 0.275, 0.42]);
    let is_enough = |share: &f64| *share > least_of_coffee_table;
    assert!(coffee.iter().all(is_enough), "{coffee:.3?}");
    let desk = found(Isometry3::translation(3.35, 3.4, 0.0), [0.75, 0.35, 0.74]);
    let is_enough = desk.iter().zip(least_of_desk).all(|(a, b)| *a > b);
    assert!(is_enough, "{desk:.3?}");
}

/// Creases lie where the truth has some, within the noise of the mesh: where the rectangles of the scene end.
fn demand_creases(creases: &LineSet) {
    const NOISE_M: f64 = 0.01;
    let room = Scene::new(SceneKind::Room).mesh();
    let mut uses = BTreeMap::new();
    for [a, b, c] in &room.triangles {
        for (p, q) in [(a, b), (b, c), (c, a)] {
            *uses.entry((p.min(q), p.max(q))).or_insert(0_usize) += 1;
        }
    }
    let borders: Vec<_> = uses
        .into_iter()
        .filter(|(_, count)| *count == 1)
        .map(|((p, q), _)| [p, q].map(|end| room.positions[*end as usize]))
        .collect();
    let samples: Vec<_> = samples(creases).into_iter().step_by(7).collect();
    let is_near = |point: &&Point3<f64>| borders.iter().any(|line| apart(point, line) < NOISE_M);
    let share = samples.iter().filter(is_near).count() as f64 / samples.len() as f64;
    assert!(share > 0.35, "{share:.3}");
}
