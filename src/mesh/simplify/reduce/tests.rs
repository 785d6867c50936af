use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::diff::{Check, DiffOptions, Tolerance, Topology, compare};
use crate::mesh::Shape;

/// A box whose walls are grids of n by n squares, closed, facing outwards; vertices shared.
fn gridded_box(n: u32) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let mut known = std::collections::HashMap::new();
    let mut vertex = |p: [u32; 3], mesh: &mut TriangleMesh| {
        *known.entry(p).or_insert_with(|| {
            mesh.positions.push(Point3::new(
                f64::from(p[0]) * 4.0 / f64::from(n),
                f64::from(p[1]) * 3.0 / f64::from(n),
                f64::from(p[2]) * 5.0 / f64::from(n),
            ));
            mesh.positions.len() as u32 - 1
        })
    };
    for axis in 0..3 {
        for side in [0, n] {
            for i in 0..n {
                for j in 0..n {
                    let corner = |i: u32, j: u32| {
                        let mut p = [0; 3];
                        p[axis] = side;
                        p[(axis + 1) % 3] = i;
                        p[(axis + 2) % 3] = j;
                        p
                    };
                    let [a, b, c, d] = [
                        corner(i, j),
                        corner(i + 1, j),
                        corner(i + 1, j + 1),
                        corner(i, j + 1),
                    ]
                    .map(|p| vertex(p, &mut mesh));
                    if side == 0 {
                        mesh.triangles.extend([[a, c, b], [a, d, c]]);
                    } else {
                        mesh.triangles.extend([[a, b, c], [a, c, d]]);
                    }
                }
            }
        }
    }
    mesh
}

fn noisy(mut mesh: TriangleMesh, amplitude: f64, seed: u64) -> TriangleMesh {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for position in &mut mesh.positions {
        *position += Vector3::from_fn(|_, _| (random.random::<f64>() * 2.0 - 1.0) * amplitude);
    }
    mesh
}

fn simplified(mesh: &TriangleMesh, tolerance: f64) -> TriangleMesh {
    let result = simplify(mesh, &SimplifyOptions::with_tolerance(tolerance)).unwrap();
    result.mesh.validate().unwrap();
    result.mesh
}

/// Demands that the surfaces lie within the tolerance of each other, and hang together alike.
fn demand_same(mesh: &TriangleMesh, reduced: &TriangleMesh, tolerance: f64) {
    let options = DiffOptions {
        tolerance: Tolerance::Length(tolerance),
        samples: 5000,
        checks: vec![Check::Distance],
        ..DiffOptions::default()
    };
    let (before, after) = (Shape::from(mesh.clone()), Shape::from(reduced.clone()));
    let found = compare(&before, &after, &options).unwrap();
    assert!(found.is_same, "{:?}", found.checks);
    let [a, b] = found.topology;
    assert_eq!(
        (
            a.components,
            a.boundary_loops,
            a.genus,
            a.inconsistent_edges
        ),
        (
            b.components,
            b.boundary_loops,
            b.genus,
            b.inconsistent_edges
        )
    );
}

#[test]
fn a_gridded_box_becomes_twelve_triangles() {
    let mesh = gridded_box(8);
    let reduced = simplified(&mesh, 1e-6);
    assert_eq!((reduced.positions.len(), reduced.triangles.len()), (8, 12));
    demand_same(&mesh, &reduced, 1e-9);
}

#[test]
fn noise_within_the_tolerance_is_flattened_and_beyond_it_stays() {
    let mesh = noisy(gridded_box(12), 0.002, 1);
    let reduced = simplified(&mesh, 0.01);
    assert!(
        reduced.triangles.len() * 5 < mesh.triangles.len(),
        "{}",
        reduced.triangles.len()
    );
    demand_same(&mesh, &reduced, 0.01);
    let kept = simplified(&mesh, 1e-5);
    assert!(kept.triangles.len() * 10 > mesh.triangles.len() * 9);
    demand_same(&mesh, &kept, 1e-5);
}

/// Walls of 60 by 60 squares: within the tolerance of its own plane a noisy triangle finds its next neighbours only.
#[test]
fn a_wide_noisy_wall_is_one_region() {
    let mesh = noisy(gridded_box(60), 0.0003, 2);
    let result = simplify(&mesh, &SimplifyOptions::with_tolerance(0.002)).unwrap();
    assert!(result.regions <= 12, "{} regions", result.regions);
    assert!(result.mesh.triangles.len() * 50 < mesh.triangles.len());
    demand_same(&mesh, &result.mesh, 0.002);
}

#[test]
fn holes_rims_and_islands_stay() {
    // A wall with two windows, and a ledge that hangs on one of its rims.
    let n = 12;
    let mut mesh = TriangleMesh::default();
    for j in 0..=n {
        for i in 0..=n {
            mesh.positions
                .push(Point3::new(f64::from(i), f64::from(j), 0.0));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let is_window = (2..5).contains(&j) && ((2..4).contains(&i) || (6..10).contains(&i));
            if is_window {
                continue;
            }
            let at = |i: u32, j: u32| j * (n + 1) + i;
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let reduced = simplified(&mesh, 1e-6);
    // Twelve corners; a polygon with v corners and h holes has v + 2 h - 2 triangles.
    assert_eq!((reduced.positions.len(), reduced.triangles.len()), (12, 14));
    demand_same(&mesh, &reduced, 1e-9);
    let loops = Topology::of(&Shape::from(reduced)).boundary_loops;
    assert_eq!(loops, 3);
}

/// Two windows that touch in a corner, whose vertex is split as manifold repair does it.
#[test]
fn vertices_at_one_place_do_not_keep_a_wall_as_it_is() {
    let n = 12;
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let mut mesh = TriangleMesh::default();
    for place in 0..(n + 1) * (n + 1) {
        let (i, j) = (place % (n + 1), place / (n + 1));
        mesh.positions
            .push(Point3::new(f64::from(i), f64::from(j), 0.0));
    }
    let copy = mesh.positions.len() as u32;
    mesh.positions.push(Point3::new(4.0, 4.0, 0.0));
    for (i, j) in (0..n * n).map(|square| (square % n, square / n)) {
        let is_window = |low: u32| (low..low + 2).contains(&i) && (low..low + 2).contains(&j);
        if is_window(2) || is_window(4) {
            continue;
        }
        let mut corners = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
        if (i, j) == (4, 3) {
            corners = corners.map(|corner| if corner == at(4, 4) { copy } else { corner });
        }
        let [a, b, c, d] = corners;
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    let reduced = simplified(&mesh, 1e-6);
    assert_eq!((reduced.positions.len(), reduced.triangles.len()), (12, 12));
    demand_same(&mesh, &reduced, 1e-9);
}

#[test]
fn curved_surfaces_stay_closed_and_near() {
    let mut mesh = noisy(gridded_box(10), 0.0, 1);
    for position in &mut mesh.positions {
        let from_middle = *position - Point3::new(2.0, 1.5, 2.5);
        *position = Point3::from(from_middle.normalize());
    }
    for (tolerance, share) in [(0.001, 1.0), (0.02, 0.95), (0.1, 0.6)] {
        let reduced = simplified(&mesh, tolerance);
        let kept = reduced.triangles.len() as f64 / mesh.triangles.len() as f64;
        assert!(kept <= share + 1e-3, "{tolerance}: {kept}");
        demand_same(&mesh, &reduced, 1.5 * tolerance);
        assert_eq!(Topology::of(&Shape::from(reduced)).boundary_edges, 0);
    }
}

#[test]
fn hostile_meshes_come_through() {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    for round in 0..60 {
        // Few vertices on a small grid: coplanar, doubled, folded, crossing and degenerate triangles.
        let count = 4 + round % 9;
        let positions: Vec<_> = (0..count)
            .map(|_| {
                Point3::from(Vector3::from_fn(|_, _| {
                    f64::from(random.random_range(0..3_u32))
                }))
            })
            .collect();
        let triangles: Vec<[u32; 3]> = (0..20)
            .map(|_| std::array::from_fn(|_| random.random_range(0..count)))
            .collect();
        let mesh = TriangleMesh {
            colors: Some(vec![[7; 3]; positions.len()]),
            positions,
            triangles,
        };
        let reduced = simplified(&mesh, 0.01);
        assert!(reduced.triangles.len() <= mesh.triangles.len());
        assert_eq!(
            reduced.colors.as_ref().map(Vec::len),
            Some(reduced.positions.len())
        );
    }
    assert!(simplified(&TriangleMesh::default(), 0.1).is_empty());
    assert!(simplify(&gridded_box(1), &SimplifyOptions::with_tolerance(0.0)).is_err());
    assert!(simplify(&gridded_box(1), &SimplifyOptions::with_tolerance(f64::NAN)).is_err());
}

#[test]
fn threads_make_no_difference() {
    let mesh = noisy(gridded_box(10), 0.003, 2);
    let on = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| simplified(&mesh, 0.01))
    };
    assert_eq!(on(1), on(3));
}
