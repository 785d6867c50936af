use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::Shape;
use crate::diff::{Check, DiffOptions, Tolerance, Topology, compare};
use crate::simplify::default_boundary_tolerance;

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
    let result = simplify(mesh, &[], &SimplifyOptions::with_tolerance(tolerance)).unwrap();
    result.mesh.validate().unwrap();
    result.mesh
}

/// Asserts that the surfaces are within the tolerance of each other and have the same topology.
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

#[test]
fn a_wide_noisy_wall_becomes_few_triangles() {
    let mesh = noisy(gridded_box(30), 0.0003, 2);
    let result = simplify(&mesh, &[], &SimplifyOptions::with_tolerance(0.002)).unwrap();
    assert!(result.mesh.triangles.len() * 50 < mesh.triangles.len());
    assert!(result.largest_distance <= 0.002 && result.checked_points > 25_000);
    demand_same(&mesh, &result.mesh, 0.002);
}

#[test]
fn holes_boundaries_and_islands_stay() {
    // A wall with two windows, and a ledge that is attached to one of its boundaries.
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
    let loops = Topology::new(&Shape::from(reduced)).boundary_loops;
    assert_eq!(loops, 3);
}

/// Two windows that touch in a corner, whose vertex is split as manifold repair does it.
#[test]
fn vertices_at_one_position_do_not_keep_a_wall_as_it_is() {
    let n = 12;
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let mut mesh = TriangleMesh::default();
    for index in 0..(n + 1) * (n + 1) {
        let (i, j) = (index % (n + 1), index / (n + 1));
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
        assert_eq!(Topology::new(&Shape::from(reduced)).boundary_edges, 0);
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
    assert!(simplify(&gridded_box(1), &[], &SimplifyOptions::with_tolerance(0.0)).is_err());
    assert!(
        simplify(
            &gridded_box(1),
            &[],
            &SimplifyOptions::with_tolerance(f64::NAN)
        )
        .is_err()
    );
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

/// Length of the edges among `edges` that run along a line, within a distance.
fn length_along(
    result: &SimplifiedMesh,
    edges: &[FeatureEdge],
    line: [Point3<f64>; 2],
    within: f64,
) -> f64 {
    let direction = (line[1] - line[0]).normalize();
    let off = |p: &Point3<f64>| (p - line[0]).cross(&direction).norm();
    let ends = edges
        .iter()
        .map(|edge| edge.ends.map(|end| result.mesh.positions[end as usize]));
    ends.filter(|ends| ends.iter().all(|end| off(end) <= within))
        .map(|[p, q]| (q - p).norm())
        .sum()
}

/// A noisy box keeps its twelve edges as edges, from end to end, whether lines are known or not.
#[test]
fn the_edges_of_a_box_remain_edges() {
    let (amplitude, tolerance) = (0.004, 0.02);
    let mesh = noisy(gridded_box(12), amplitude, 5);
    let options = SimplifyOptions::with_tolerance(tolerance);
    let result = simplify(&mesh, &[], &options).unwrap();
    assert!(result.mesh.triangles.len() * 10 < mesh.triangles.len());
    let at = |x: u32, y: u32, z: u32| {
        Point3::new(f64::from(x) * 4.0, f64::from(y) * 3.0, f64::from(z) * 5.0)
    };
    for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        for line in [
            [at(0, i, j), at(1, i, j)],
            [at(i, 0, j), at(i, 1, j)],
            [at(i, j, 0), at(i, j, 1)],
        ] {
            let length = length_along(&result, &result.features, line, 2.0 * tolerance);
            let whole = (line[1] - line[0]).norm();
            assert!((length - whole).abs() < 0.05 * whole, "{length} of {whole}");
        }
    }
    demand_same(&mesh, &result.mesh, tolerance);
}

/// A roof with a dihedral angle of 20 degrees: no crease by itself, one where a line is known.
#[test]
fn a_known_line_keeps_a_shallow_edge() {
    let n = 16;
    let mut mesh = TriangleMesh::default();
    let slope = 10.0_f64.to_radians().tan();
    for j in 0..=n {
        for i in 0..=n {
            let (x, y) = (f64::from(i) / f64::from(n), f64::from(j) / f64::from(n));
            mesh.positions
                .push(Point3::new(x, y, -(x - 0.5).abs() * slope));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let at = |i: u32, j: u32| j * (n + 1) + i;
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    let mesh = noisy(mesh, 0.0005, 3);
    let ridge = [Point3::new(0.5, 0.0, 0.0), Point3::new(0.5, 1.0, 0.0)];
    let options = SimplifyOptions::with_tolerance(0.004);
    let length = |lines: &[[Point3<f64>; 2]]| {
        let result = simplify(&mesh, lines, &options).unwrap();
        demand_same(&mesh, &result.mesh, options.tolerance);
        assert!(result.mesh.triangles.len() * 10 < mesh.triangles.len());
        length_along(&result, &result.features, ridge, 0.008)
    };
    assert!(length(&[ridge]) > 0.98);
    assert!(length(&[]) < 0.1);
    // Lines elsewhere change nothing, nor do lines that are not finite.
    let aside = ridge.map(|p| p + Vector3::new(0.2, 0.0, 0.0));
    assert!(length(&[aside, [Point3::new(f64::NAN, 0.0, 0.0); 2]]) < 0.1);
}

/// Walls of squares in a plane: those of a grid of n by n that are wanted, each of some size.
fn squares(n: u32, size: f64, is_wanted: impl Fn(u32, u32) -> bool) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    for index in 0..(n + 1) * (n + 1) {
        let (i, j) = (index % (n + 1), index / (n + 1));
        mesh.positions
            .push(Point3::new(f64::from(i) * size, f64::from(j) * size, 0.0));
    }
    for (i, j) in (0..n * n).map(|square| (square % n, square / n)) {
        if is_wanted(i, j) {
            let at = |i: u32, j: u32| j * (n + 1) + i;
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

fn with_boundary_tolerance(
    mesh: &TriangleMesh,
    tolerance: f64,
    boundary_tolerance: f64,
) -> SimplifiedMesh {
    let options = SimplifyOptions {
        boundary_tolerance,
        ..SimplifyOptions::with_tolerance(tolerance)
    };
    let result = simplify(mesh, &[], &options).unwrap();
    result.mesh.validate().unwrap();
    assert!(result.largest_distance <= tolerance && result.mean_distance < tolerance);
    assert!(result.largest_boundary_distance <= boundary_tolerance);
    let [before, after] = [mesh, &result.mesh].map(|m| Topology::new(&Shape::from(m.clone())));
    assert_eq!(
        (after.components, after.boundary_loops, after.genus),
        (before.components, before.boundary_loops, before.genus)
    );
    result
}

/// Number of triangles that cover a point of the plane in their interior.
fn layers(mesh: &TriangleMesh, x: f64, y: f64) -> usize {
    let is_over = |triangle: &&[u32; 3]| {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        let side =
            |p: Point3<f64>, q: Point3<f64>| (q.x - p.x) * (y - p.y) - (q.y - p.y) * (x - p.x);
        let sides = [side(a, b), side(b, c), side(c, a)];
        sides.iter().all(|s| *s > 0.0) || sides.iter().all(|s| *s < 0.0)
    };
    mesh.triangles.iter().filter(is_over).count()
}

/// A rough wall with spurs and notches around it, and a jagged hole.
#[test]
fn jagged_boundaries_straighten_and_the_surface_keeps_its_plane() {
    let (n, size) = (30, 0.05);
    let jagged = squares(n, size, |i, j| {
        let is_hole = (12 + j % 2..18 - i % 2).contains(&i) && (11..19).contains(&j);
        let is_notch = i == 0 && j % 3 == 0 || j == 0 && i % 2 == 0 || i + 1 == n && j % 2 == 0;
        !(is_hole || is_notch)
    });
    let mesh = noisy(jagged, 0.0004, 7);
    let area = |mesh: &TriangleMesh| -> f64 {
        let corners = |t: &[u32; 3]| t.map(|c| mesh.positions[c as usize]);
        let areas = mesh.triangles.iter();
        areas.map(|t| 0.5 * doubled_area(&corners(t)).z).sum()
    };
    let tight = with_boundary_tolerance(&mesh, 0.002, 0.0);
    let loose = with_boundary_tolerance(&mesh, 0.002, 0.07);
    let counts = [&tight, &loose].map(|result| result.mesh.triangles.len());
    assert!(counts[1] * 4 < counts[0], "{counts:?}");
    assert!(tight.largest_boundary_distance == 0.0 && loose.largest_boundary_distance > 0.01);
    assert!(loose.mesh.positions.iter().all(|p| p.z.abs() <= 0.0024));
    let share = area(&loose.mesh) / area(&mesh);
    assert!((share - 1.0).abs() < 0.07, "{share}");
}

/// Two walls beside each other in one plane, with less between them than boundaries may move.
#[test]
fn walls_on_both_sides_of_a_slit_stay_apart() {
    let n = 24;
    for gap in [1, 2] {
        let mesh = squares(n, 0.05, |i, j| {
            let edge = 11 + (j * 7 / 3) % 3;
            i < edge || i >= edge + gap
        });
        let reduced = with_boundary_tolerance(&mesh, 0.002, 0.12).mesh;
        assert!(reduced.triangles.len() * 6 < mesh.triangles.len());
        for index in 0..240 * 240 {
            let (x, y) = (f64::from(index % 240), f64::from(index / 240));
            let (x, y) = (0.0050137 * x, 0.0050079 * y);
            assert!(layers(&reduced, x, y) <= 1, "{x} {y}");
        }
    }
}

/// A jagged floor ends before a wall, by less than boundaries may move.
#[test]
fn a_floor_does_not_come_out_behind_the_wall() {
    let n = 20;
    let mut mesh = squares(n, 0.05, |i, j| i + 1 + j % 2 < n);
    let first = mesh.positions.len() as u32;
    let wall = squares(n, 0.05, |_, _| true);
    let upright = wall
        .positions
        .iter()
        .map(|p| Point3::new(0.97, p.x, p.y - 0.5));
    mesh.positions.extend(upright);
    let triangles = wall.triangles.iter().map(|t| t.map(|c| c + first));
    mesh.triangles.extend(triangles);
    let reduced = with_boundary_tolerance(&mesh, 0.002, 0.08).mesh;
    assert!(reduced.positions.iter().all(|p| p.x <= 0.9721));
    assert!(reduced.triangles.len() * 20 < mesh.triangles.len());
}

#[test]
fn boundaries_along_known_lines_keep_the_tolerance() {
    let mesh = squares(12, 1.0, |i, j| {
        !((2..5).contains(&j) && (4..8).contains(&i))
    });
    let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
    let around = |[a, b, c, d]: [Point3<f64>; 4]| [[a, b], [b, c], [c, d], [d, a]];
    let lines = [
        around([at(0.0, 0.0), at(12.0, 0.0), at(12.0, 12.0), at(0.0, 12.0)]),
        around([at(4.0, 2.0), at(8.0, 2.0), at(8.0, 5.0), at(4.0, 5.0)]),
    ]
    .concat();
    let options = SimplifyOptions {
        boundary_tolerance: 1.5,
        ..SimplifyOptions::with_tolerance(1e-6)
    };
    let known = simplify(&mesh, &lines, &options).unwrap().mesh;
    assert_eq!((known.positions.len(), known.triangles.len()), (8, 8));
    demand_same(&mesh, &known, 1e-9);
    let negative = SimplifyOptions {
        boundary_tolerance: -1.0,
        ..options
    };
    assert_eq!(
        simplify(&mesh, &[], &negative),
        Err(SimplifyOptionsError::BoundaryTolerance(-1.0))
    );
}

#[test]
fn the_default_boundary_tolerance_follows_the_edge_lengths() {
    let mesh = squares(6, 0.05, |i, j| i + j > 0);
    assert!((default_boundary_tolerance(&mesh, 0.002) - 0.025).abs() < 1e-12);
    assert!((default_boundary_tolerance(&mesh, 0.0001) - 0.002).abs() < 1e-12);
    assert!((default_boundary_tolerance(&gridded_box(2), 0.002) - 0.002).abs() < 1e-12);
}
