use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

type Mesh = TriangleMesh;

/// A box of 4 by 3 by 5, each side two triangles, facing outwards.
fn plain_box() -> Mesh {
    let mut mesh = Mesh::default();
    for corner in 0..8_u32 {
        let on = |bit: u32, size: f64| if corner >> bit & 1 == 1 { size } else { 0.0 };
        let position = Point3::new(on(0, 4.0), on(1, 3.0), on(2, 5.0));
        mesh.positions.push(position);
    }
    for [a, b, c, d] in [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ] {
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}

/// Subdivides edges and triangles at random positions, the same on both sides of an edge.
fn subdivide(mesh: &mut Mesh, cuts: usize, seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    for _ in 0..cuts {
        let index = random.random_range(0..mesh.triangles.len());
        let [a, b, c] = mesh.triangles[index];
        let new = mesh.positions.len() as u32;
        let at = |vertex: u32| mesh.positions[vertex as usize].coords;
        if random.random::<f64>() < 0.3 {
            let position = at(a) * 0.3 + at(b) * 0.4 + at(c) * 0.3;
            mesh.positions.push(position.into());
            mesh.triangles[index] = [a, b, new];
            mesh.triangles.extend([[b, c, new], [c, a, new]]);
            continue;
        }
        // The longest side, so that triangles do not become thin.
        let length = |(p, q): &(u32, u32)| (at(*p) - at(*q)).norm();
        let sides = [(a, b), (b, c), (c, a)];
        let (p, q) = sides
            .into_iter()
            .max_by(|s, t| length(s).total_cmp(&length(t)))
            .unwrap();
        let share = 0.4 + 0.2 * random.random::<f64>();
        mesh.positions.push(at(p).lerp(&at(q), share).into());
        for index in 0..mesh.triangles.len() {
            let corners = mesh.triangles[index];
            if corners.contains(&p) && corners.contains(&q) {
                mesh.triangles[index] = corners.map(|v| if v == q { new } else { v });
                let other = corners.map(|v| if v == p { new } else { v });
                mesh.triangles.push(other);
            }
        }
    }
}

/// Gives every triangle vertices of its own.
fn split_all(mesh: &Mesh) -> Mesh {
    let corners = mesh.triangles.as_flattened();
    Mesh {
        positions: corners
            .iter()
            .map(|c| mesh.positions[*c as usize])
            .collect(),
        triangles: (0..mesh.triangles.len() as u32)
            .map(|t| [3 * t, 3 * t + 1, 3 * t + 2])
            .collect(),
        colors: None,
    }
}

fn found(mesh: &Mesh, lines: &[[Point3<f64>; 2]]) -> FeatureEdges {
    FeatureEdges::find(mesh, lines, &FeatureOptions::with_tolerance(1e-4)).unwrap()
}

fn ends(mesh: &Mesh, edges: &[FeatureEdge]) -> Vec<[[f64; 3]; 2]> {
    let position = |v: u32| mesh.positions[v as usize].coords.into();
    edges.iter().map(|edge| edge.ends.map(position)).collect()
}

/// The axis and the corner of the box's edge that has both points, when there is one.
fn edge_of_box([p, q]: &[[f64; 3]; 2]) -> Option<(usize, [bool; 3])> {
    let sizes = [4.0, 3.0, 5.0];
    let is_at_side = |axis: usize| {
        let near = |value: f64| (p[axis] - value).abs() < 1e-12 && (q[axis] - value).abs() < 1e-12;
        near(0.0) || near(sizes[axis])
    };
    let free: Vec<usize> = (0..3).filter(|axis| !is_at_side(*axis)).collect();
    let [axis] = free[..] else {
        return None;
    };
    let mut corner = [0, 1, 2].map(|k| p[k] > 0.5 * sizes[k]);
    corner[axis] = false;
    Some((axis, corner))
}

#[test]
fn a_box_has_its_twelve_edges_however_it_is_divided_and_split() {
    for seed in 0..20 {
        let mut mesh = plain_box();
        subdivide(&mut mesh, 20 * seed as usize, seed);
        let whole = ends(&mesh, found(&mesh, &[]).edges());
        let split = split_all(&mesh);
        let apart = found(&split, &[]);
        assert_eq!(ends(&split, apart.edges()), whole);

        let mut lengths: BTreeMap<(usize, [bool; 3]), f64> = BTreeMap::new();
        for (edge, ends) in apart.edges().iter().zip(&whole) {
            assert_eq!(edge.kind, EdgeKind::Crease);
            let name = edge_of_box(ends).unwrap_or_else(|| panic!("{ends:?} is inside a side"));
            let [p, q] = ends.map(Vector3::from);
            *lengths.entry(name).or_default() += (q - p).norm();
        }
        assert_eq!(lengths.len(), 12);
        for ((axis, _), length) in lengths {
            assert!((length - [4.0, 3.0, 5.0][axis]).abs() < 1e-9, "{length}");
        }
        assert!(whole.is_sorted_by(|a, b| a < b) && whole.iter().all(|[p, q]| p < q));
    }
}

#[test]
fn every_copy_of_a_vertex_tells_the_kind_of_its_edge() {
    let mesh = plain_box();
    let split = split_all(&mesh);
    let found = found(&split, &[]);
    for triangle in &split.triangles {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            let positions = [a, b].map(|v| split.positions[v as usize]);
            let is_side = edge_of_box(&positions.map(|p| p.coords.into())).is_some();
            let expected = is_side.then_some(EdgeKind::Crease);
            assert_eq!(found.kind(a, b), expected);
            assert_eq!(found.kind(b, a), expected);
        }
    }
}

/// A square of n by n squares in a plane.
fn sheet(n: u32) -> Mesh {
    let mut mesh = Mesh::default();
    for j in 0..=n {
        for i in 0..=n {
            mesh.positions
                .push(Point3::new(f64::from(i), f64::from(j), 2.0));
        }
    }
    for j in 0..n {
        for i in 0..n {
            let at = |i: u32, j: u32| j * (n + 1) + i;
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
    }
    mesh
}

#[test]
fn a_line_drawn_on_a_flat_sheet_is_found_along_its_row() {
    let mesh = sheet(6);
    let at = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let of = |line, kind, options: &FeatureOptions| {
        let found = FeatureEdges::find(&mesh, &[line], options).unwrap();
        let edges: Vec<_> = found
            .edges()
            .iter()
            .filter(|e| e.kind == kind)
            .copied()
            .collect();
        ends(&mesh, &edges)
    };
    let options = FeatureOptions::with_tolerance(1e-3);
    let along = |line| of(line, EdgeKind::AlongLine, &options);
    let row: Vec<_> = (1..5)
        .map(f64::from)
        .map(|x| [[x, 3.0, 2.0], [x + 1.0, 3.0, 2.0]])
        .collect();
    // Within three times the tolerance, also where the ends do not reach the last vertices.
    let drawn = [at(0.9985, 3.001, 2.001), at(4.999, 3.0, 2.0)];
    assert_eq!(along(drawn), row);
    assert_eq!(along([drawn[1], drawn[0]]), row);
    // A diagonal of squares is an edge as well, a line between rows or above them is none.
    assert_eq!(along([at(0.0, 0.0, 2.0), at(6.0, 6.0, 2.0)]).len(), 6);
    assert!(along([at(0.0, 2.5, 2.0), at(6.0, 2.5, 2.0)]).is_empty());
    assert!(along([at(0.0, 3.0, 2.01), at(6.0, 3.0, 2.01)]).is_empty());
    // The boundary of the grid; along the line the kind is `AlongLine` only.
    let border = [at(0.0, 0.0, 2.0), at(6.0, 0.0, 2.0)];
    assert_eq!(along(border).len(), 6);
    assert_eq!(of(border, EdgeKind::Boundary, &options).len(), 18);
    assert!(of(border, EdgeKind::Crease, &options).is_empty());
    // With a minimum angle along lines, a flat edge is no feature.
    let turned = FeatureOptions {
        line_crease_angle_rad: 0.1,
        ..options
    };
    assert!(of(drawn, EdgeKind::AlongLine, &turned).is_empty());
}

#[test]
fn broken_meshes_and_lines_count_as_if_they_were_not_there() {
    let mut mesh = sheet(2);
    let first = mesh.positions.len() as u32;
    let strange = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
    mesh.positions
        .extend(strange.map(|value| Point3::new(value, 0.0, 0.0)));
    // A copy of the middle, to which one triangle collapses.
    mesh.positions.push(mesh.positions[4]);
    let whole = ends(&mesh, found(&mesh, &[]).edges());
    assert_eq!(whole.len(), 8);
    mesh.triangles.extend([
        [0, 1, first],
        [first, first + 1, first + 2],
        [0, 4, first + 2],
        [4, 4, 5],
        [4, first + 3, 0],
        [7, 7, 7],
        [0, 1, 999],
    ]);
    let nan = [Point3::new(f64::NAN, 0.0, 0.0); 2];
    let infinite = [Point3::origin(), Point3::new(f64::INFINITY, 0.0, 0.0)];
    let point = [Point3::new(1.0, 1.0, 2.0); 2];
    let edges = found(&mesh, &[nan, infinite, point]);
    assert_eq!(ends(&mesh, edges.edges()), whole);
    // A triangle without area does not hide what meets along it, and has no dihedral angle.
    mesh.triangles.push([3, 4, 5]);
    let _ = found(&mesh, &[]);
    assert!(found(&Mesh::default(), &[]).edges().is_empty());
    let bad = FeatureOptions {
        crease_angle_rad: f64::NAN,
        ..FeatureOptions::with_tolerance(1e-3)
    };
    assert!(FeatureEdges::find(&mesh, &[], &bad).is_err());
}
