use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::RayScene;
use super::intersect::PreparedRay;
use crate::TriangleMesh;

/// A closed, outward oriented sphere-like mesh with random radii: rows times columns quads, split.
fn bumpy_sphere(rows: u32, columns: u32, seed: u64) -> TriangleMesh {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut mesh = TriangleMesh::default();
    mesh.positions.push(Point3::new(0.0, 0.0, 1.0));
    for row in 1..rows {
        let polar = std::f64::consts::PI * f64::from(row) / f64::from(rows);
        for column in 0..columns {
            let azimuth = std::f64::consts::TAU * f64::from(column) / f64::from(columns);
            let radius = 0.7 + 0.6 * random.random::<f64>();
            mesh.positions.push(Point3::new(
                radius * polar.sin() * azimuth.cos(),
                radius * polar.sin() * azimuth.sin(),
                radius * polar.cos(),
            ));
        }
    }
    let last = mesh.positions.len() as u32;
    mesh.positions.push(Point3::new(0.0, 0.0, -1.0));
    let at = |row: u32, column: u32| 1 + (row - 1) * columns + column % columns;
    for column in 0..columns {
        mesh.triangles.push([0, at(1, column), at(1, column + 1)]);
        for row in 1..rows - 1 {
            let (a, b) = (at(row, column), at(row, column + 1));
            let (c, d) = (at(row + 1, column), at(row + 1, column + 1));
            mesh.triangles.push([a, c, b]);
            mesh.triangles.push([b, c, d]);
        }
        mesh.triangles
            .push([at(rows - 1, column), last, at(rows - 1, column + 1)]);
    }
    mesh
}

fn random_vector(random: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| random.random::<f64>() * 2.0 - 1.0)
}

#[test]
fn no_ray_from_inside_a_closed_mesh_slips_through_its_edges_and_corners() {
    let mesh = bumpy_sphere(12, 17, 1);
    let scene = RayScene::new(&mesh);
    let mut random = ChaCha8Rng::seed_from_u64(2);
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        let t = random.random::<f64>();
        let targets = [
            a,
            nalgebra::center(&a, &b),
            a + (c - a) * t,
            b + (c - b) * t,
        ];
        for target in targets {
            let origin = Point3::from(random_vector(&mut random) * 0.2);
            let hit = scene.cast(&origin, &(target - origin), f64::INFINITY);
            let hit = hit.expect("the mesh is closed around the origin of the ray");
            assert!(hit.distance <= 1.0 + 1e-12, "{hit:?}");
            assert!(scene.is_occluded(&origin, &(target - origin), hit.distance));
        }
    }
}

#[test]
fn the_nearest_hit_is_that_of_all_triangles_tested_in_turn() {
    let mesh = bumpy_sphere(9, 11, 3);
    let scene = RayScene::new(&mesh);
    let mut random = ChaCha8Rng::seed_from_u64(4);
    for _ in 0..2000 {
        let origin = Point3::from(random_vector(&mut random) * 3.0);
        let direction = random_vector(&mut random);
        let ray = PreparedRay::new(&origin, &direction).unwrap();
        let expected = (0..mesh.triangles.len() as u32)
            .filter_map(|triangle| ray.hits_triangle(scene.corners(triangle), f64::INFINITY))
            .map(|hit| hit.distance)
            .min_by(f64::total_cmp);
        let found = scene.cast(&origin, &direction, f64::INFINITY);
        assert_eq!(found.map(|hit| hit.distance), expected);
        if let Some(hit) = found {
            let just_short = hit.distance.next_down();
            assert!(scene.cast(&origin, &direction, hit.distance).is_some());
            assert!(scene.cast(&origin, &direction, just_short).is_none());
            assert!(!scene.is_occluded(&origin, &direction, just_short));
        }
    }
}

#[test]
fn a_hidden_side_lets_the_ray_go_on() {
    let mesh = bumpy_sphere(8, 8, 5);
    let scene = RayScene::new(&mesh);
    let origin = Point3::new(0.1, 0.2, 4.0);
    let direction = -Vector3::z();
    let first = scene.cast(&origin, &direction, f64::INFINITY).unwrap();
    let behind = scene
        .cast_where(&origin, &direction, f64::INFINITY, |_, front| !front)
        .unwrap();
    assert!(first.is_front_face && !behind.is_front_face);
    assert!(behind.distance > first.distance);
    assert!(scene.normal(first.triangle).z > 0.0);
}

#[test]
fn the_closest_point_is_that_of_all_triangles_sampled_densely() {
    let mesh = bumpy_sphere(7, 9, 6);
    let scene = RayScene::new(&mesh);
    let mut random = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..200 {
        let point = Point3::from(random_vector(&mut random) * 2.0);
        let closest = scene.closest(&point, f64::INFINITY).unwrap();
        let [a, b, c] = scene.corners(closest.triangle);
        let [u, v, w] = closest.barycentric;
        let again = Point3::from(a.coords * u + b.coords * v + c.coords * w);
        assert!((again - closest.point).norm() < 1e-12);
        assert!(((point - closest.point).norm() - closest.distance).abs() < 1e-12);
        // A grid of samples cannot come nearer, and comes close to the nearest point.
        let mut sampled = f64::INFINITY;
        let steps = 24;
        for triangle in 0..mesh.triangles.len() as u32 {
            let [a, b, c] = scene.corners(triangle);
            for i in 0..=steps {
                for j in 0..=steps - i {
                    let (s, t) = (
                        f64::from(i) / f64::from(steps),
                        f64::from(j) / f64::from(steps),
                    );
                    sampled = sampled.min((a + (b - a) * s + (c - a) * t - point).norm());
                }
            }
        }
        assert!(closest.distance <= sampled + 1e-12);
        assert!(closest.distance >= sampled - 0.03);
        assert!(scene.closest(&point, closest.distance * 0.999).is_none());
        // The same from any other triangle, and with any hint.
        let hint = random.random_range(0..mesh.triangles.len() as u32);
        let from = scene.closest_from(&point, hint).unwrap();
        assert_eq!(from.distance, closest.distance);
        let hint = std::cell::Cell::new(Some(hint));
        assert!(!scene.is_within(&point, closest.distance * 0.999, &hint));
        assert!(scene.is_within(&point, closest.distance * 1.001, &hint));
    }
}

#[test]
fn bad_triangles_are_counted_and_left_out() {
    let mut mesh = bumpy_sphere(4, 5, 8);
    let good = mesh.triangles.len();
    mesh.positions.push(Point3::new(f64::NAN, 0.0, 0.0));
    let nan = mesh.positions.len() as u32 - 1;
    mesh.triangles.insert(0, [1, 1, 2]);
    mesh.triangles.push([0, 1, nan]);
    mesh.triangles.push([0, 1, u32::MAX]);
    let scene = RayScene::new(&mesh);
    assert_eq!(scene.ignored_triangles(), 3);
    assert_eq!(scene.triangle_count(), good);
    assert!(
        scene
            .cast(&Point3::origin(), &Vector3::x(), f64::INFINITY)
            .is_some()
    );
    assert!(
        scene
            .cast(&Point3::origin(), &Vector3::zeros(), f64::INFINITY)
            .is_none()
    );
    assert!(
        scene
            .cast(&Point3::new(f64::NAN, 0.0, 0.0), &Vector3::x(), 1.0)
            .is_none()
    );
    let (low, high) = scene.bounds().unwrap();
    assert!(low.z < -0.9 && high.z > 0.9);
}

#[test]
fn an_empty_mesh_answers_nothing() {
    let scene = RayScene::new(&TriangleMesh::default());
    assert!(
        scene
            .cast(&Point3::origin(), &Vector3::x(), f64::INFINITY)
            .is_none()
    );
    assert!(!scene.is_occluded(&Point3::origin(), &Vector3::x(), f64::INFINITY));
    assert!(scene.closest(&Point3::origin(), f64::INFINITY).is_none());
    assert!(scene.bounds().is_none());
}

#[test]
fn rays_within_the_planes_of_axis_aligned_walls_meet_what_stands_across() {
    // Flat boxes in the tree, a direction with two zeros, an origin in the plane of one of the walls.
    let mesh = TriangleMesh {
        positions: vec![
            Point3::new(0.0, 0.0, 0.0),
            Point3::new(4.0, 0.0, 0.0),
            Point3::new(4.0, 4.0, 0.0),
            Point3::new(0.0, 4.0, 0.0),
            Point3::new(4.0, 0.0, 4.0),
            Point3::new(4.0, 4.0, 4.0),
        ],
        triangles: vec![[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]],
        colors: None,
    };
    let scene = RayScene::new(&mesh);
    let hit = scene
        .cast(&Point3::new(1.0, 1.0, 0.0), &Vector3::x(), f64::INFINITY)
        .unwrap();
    assert!(hit.triangle >= 2);
    assert_eq!(hit.distance, 3.0);
}

/// The tree's own numbers would have to begin with 0 where it has one or two leaves.
#[test]
fn a_few_triangles_behind_ones_without_area_are_found() {
    for count in 1..4 {
        let mesh = TriangleMesh {
            positions: vec![
                Point3::origin(),
                Point3::new(1.0, 0.0, 0.0),
                Point3::new(0.0, 1.0, 0.0),
            ],
            triangles: [vec![[0, 1, 1]; 5], vec![[0, 1, 2]; count]].concat(),
            ..TriangleMesh::default()
        };
        let scene = RayScene::new(&mesh);
        let above = Point3::new(0.2, 0.2, 1.0);
        let nearest = scene.closest(&above, 2.0).expect("it is one away");
        assert_eq!((nearest.distance, scene.ignored_triangles()), (1.0, 5));
        assert!(nearest.triangle >= 5);
        let hit = scene
            .cast(&above, &-Vector3::z(), 2.0)
            .expect("it is below");
        assert!(hit.triangle >= 5 && scene.is_occluded(&above, &-Vector3::z(), 2.0));
    }
}
