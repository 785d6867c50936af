use super::*;
use nalgebra::Point3;

/// A grid of unit squares, two triangles each, without those for which `is_hole`.
fn grid(side: u32, is_hole: impl Fn(u32, u32) -> bool) -> TriangleMesh {
    let at = |x: u32, y: u32| y * (side + 1) + x;
    let mut mesh = TriangleMesh::default();
    for (y, x) in (0..=side).flat_map(|y| (0..=side).map(move |x| (y, x))) {
        mesh.positions
            .push(Point3::new(f64::from(x), f64::from(y), 0.0));
    }
    for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
        if !is_hole(x, y) {
            mesh.triangles
                .push([at(x, y), at(x + 1, y), at(x + 1, y + 1)]);
            mesh.triangles
                .push([at(x, y), at(x + 1, y + 1), at(x, y + 1)]);
        }
    }
    mesh
}

/// Sum of the signed areas seen from above.
fn area(mesh: &TriangleMesh) -> f64 {
    let doubled = mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        (b - a).cross(&(c - a)).z
    });
    0.5 * doubled.sum::<f64>()
}

/// The largest number of triangles at an edge, and whether no directed edge occurs twice.
fn check_edges(mesh: &TriangleMesh) {
    let mut seen = FxHashSet::default();
    for [a, b, c] in &mesh.triangles {
        for edge in [[a, b], [b, c], [c, a]] {
            assert!(seen.insert(edge), "{edge:?}");
        }
    }
}

#[test]
fn a_hole_in_a_plane_is_closed_exactly() {
    let mut mesh = grid(6, |x, y| (2..4).contains(&x) && (2..5).contains(&y));
    let before = mesh.positions.len();
    assert_eq!(close_holes(&mut mesh, 10), 1);
    assert!((area(&mesh) - 36.0).abs() < 1e-12);
    assert_eq!(mesh.positions.len(), before);
    check_edges(&mesh);
    // The outer boundary stays, however long a loop may be.
    assert_eq!(close_holes(&mut mesh, usize::MAX), 0);
}

#[test]
fn holes_with_more_edges_stay() {
    let holes = |x, y| (x, y) == (1, 1) || ((3..6).contains(&x) && (3..6).contains(&y));
    let mut mesh = grid(7, holes);
    assert_eq!(close_holes(&mut mesh, 11), 1);
    assert_eq!(close_holes(&mut mesh, 12), 1);
    assert!((area(&mesh) - 49.0).abs() < 1e-12);
    check_edges(&mesh);
}

#[test]
fn holes_that_touch_at_a_vertex_stay() {
    let mut mesh = grid(4, |x, y| (x, y) == (1, 1) || (x, y) == (2, 2));
    assert_eq!(close_holes(&mut mesh, 20), 0);
}

#[test]
fn a_patch_does_not_get_a_back() {
    let mut mesh = TriangleMesh {
        positions: [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
            .map(Point3::from)
            .to_vec(),
        triangles: vec![[0, 1, 2]],
        colors: None,
    };
    assert_eq!(close_holes(&mut mesh, 3), 0);
    mesh.positions.push(Point3::new(1.0, 1.0, 0.1));
    mesh.triangles.push([2, 1, 3]);
    assert_eq!(close_holes(&mut mesh, 4), 0);
    assert_eq!(close_holes(&mut TriangleMesh::default(), 4), 0);
}

#[test]
fn the_missing_face_of_a_box_is_closed() {
    let corner = |index: u32| Point3::from([0, 1, 2].map(|bit| f64::from(index >> bit & 1)));
    let mut mesh = TriangleMesh {
        positions: (0..8).map(corner).collect(),
        // Seen from outside; without the top, z = 1.
        triangles: [
            [0, 2, 3, 1],
            [0, 1, 5, 4],
            [1, 3, 7, 5],
            [3, 2, 6, 7],
            [2, 0, 4, 6],
        ]
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .collect(),
        colors: None,
    };
    assert_eq!(close_holes(&mut mesh, 4), 1);
    assert_eq!(mesh.triangles.len(), 12);
    check_edges(&mesh);
}

#[test]
fn an_edge_with_two_triangles_on_one_side_gets_no_third() {
    let mut mesh = grid(3, |x, y| (x, y) == (1, 1));
    // A fin at an edge of the hole, in the direction of the triangle there.
    let hole = [5, 6, 10, 9];
    let has = |t: &&[u32; 3]| t.iter().filter(|c| hole.contains(c)).count() == 2;
    let [a, b, c] = *mesh.triangles.iter().find(has).unwrap();
    let [from, to] = match [a, b, c].map(|v| hole.contains(&v)) {
        [true, true, false] => [a, b],
        [false, true, true] => [b, c],
        _ => [c, a],
    };
    mesh.triangles.push([from, to, mesh.positions.len() as u32]);
    mesh.positions.push(Point3::new(1.5, 1.5, 1.0));
    assert_eq!(close_holes(&mut mesh, 4), 0);
}

#[test]
fn positions_that_are_not_finite_close_nothing() {
    let mut mesh = grid(3, |x, y| (x, y) == (1, 1));
    for position in mesh.positions.iter_mut().skip(5).take(1) {
        position.x = f64::NAN;
    }
    assert_eq!(close_holes(&mut mesh, 4), 0);
}
