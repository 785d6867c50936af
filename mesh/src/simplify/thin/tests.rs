use super::*;

/// A grid of `n` by `n` squares of side 1 with the given height.
fn grid(n: u32, height: impl Fn(f64, f64) -> f64) -> TriangleMesh {
    let corners = (0..=n).flat_map(|y| (0..=n).map(move |x| (f64::from(x), f64::from(y))));
    let positions = corners
        .map(|(x, y)| Point3::new(x, y, height(x, y)))
        .collect();
    let triangles = (0..n)
        .flat_map(|y| (0..n).map(move |x| y * (n + 1) + x))
        .flat_map(|a| [[a, a + 1, a + n + 2], [a, a + n + 2, a + n + 1]])
        .collect();
    TriangleMesh {
        positions,
        triangles,
        colors: None,
    }
}

fn options(tolerance: f64) -> ThinOptions {
    ThinOptions {
        tolerance,
        boundary_tolerance: tolerance,
        longest_edge: 1e9,
    }
}

fn area(mesh: &TriangleMesh) -> f64 {
    let corners = mesh
        .triangles
        .iter()
        .map(|t| t.map(|c| mesh.positions[c as usize]));
    corners
        .map(|corners| 0.5 * doubled_area(&corners).norm())
        .sum()
}

#[test]
fn a_flat_square_keeps_its_corners_and_little_else() {
    let mut mesh = grid(20, |_, _| 1.0);
    thin(&mut mesh, &options(0.01));
    mesh.validate().unwrap();
    assert!(mesh.triangles.len() < 40, "{}", mesh.triangles.len());
    assert!((area(&mesh) - 400.0).abs() < 1.0);
    for corner in [[0.0, 0.0], [20.0, 0.0], [0.0, 20.0], [20.0, 20.0]] {
        let expected = Point3::new(corner[0], corner[1], 1.0);
        assert!(
            mesh.positions.iter().any(|p| (p - expected).norm() < 0.1),
            "{corner:?}"
        );
    }
}

#[test]
fn a_crease_stays_sharp() {
    let mut mesh = grid(20, |x, _| (x - 10.0).abs());
    let before = area(&mesh);
    thin(&mut mesh, &options(0.01));
    assert!(mesh.triangles.len() < 120, "{}", mesh.triangles.len());
    for position in &mesh.positions {
        assert!(
            (position.z - (position.x - 10.0).abs()).abs() < 0.02,
            "{position}"
        );
    }
    assert!((area(&mesh) - before).abs() < 0.01 * before);
}

#[test]
fn a_round_surface_stays_within_the_tolerance() {
    let height = |x: f64, y: f64| (900.0 - (x - 10.0).powi(2) - (y - 10.0).powi(2)).sqrt();
    let mut counts = Vec::new();
    for tolerance in [0.05, 0.2] {
        let mut mesh = grid(20, height);
        thin(&mut mesh, &options(tolerance));
        for p in &mesh.positions {
            assert!((p.z - height(p.x, p.y)).abs() < 2.0 * tolerance, "{p}");
        }
        counts.push(mesh.triangles.len());
    }
    assert!(counts[1] < counts[0] && counts[0] < 800, "{counts:?}");
}

#[test]
fn edges_stay_short_and_far_coordinates_change_nothing() {
    let mut near = grid(20, |_, _| 0.0);
    let mut far = near.clone();
    for position in &mut far.positions {
        *position += Vector3::new(4e6, -3e6, 1e6);
    }
    let options = ThinOptions {
        longest_edge: 5.0,
        ..options(0.01)
    };
    thin(&mut near, &options);
    thin(&mut far, &options);
    assert_eq!(near.triangles, far.triangles);
    for [a, b] in near
        .triangles
        .iter()
        .flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]])
    {
        let length = (near.positions[a as usize] - near.positions[b as usize]).norm();
        assert!(length < 5.001, "{length}");
    }
}

#[test]
fn edges_with_three_triangles_and_empty_meshes_are_left_alone() {
    let mut mesh = grid(6, |_, _| 0.0);
    let top = mesh.positions.len() as u32;
    mesh.positions.push(Point3::new(3.0, 3.0, 3.0));
    // On the edge between (3, 3) and (4, 3).
    mesh.triangles.push([24, 25, top]);
    thin(&mut mesh, &options(0.01));
    for kept in [[3.0, 3.0, 0.0], [4.0, 3.0, 0.0], [3.0, 3.0, 3.0]] {
        assert!(
            mesh.positions
                .iter()
                .any(|p| (p - Point3::from(kept)).norm() < 1e-9)
        );
    }
    let mut empty = TriangleMesh::default();
    thin(&mut empty, &options(0.01));
    assert!(empty.triangles.is_empty() && empty.positions.is_empty());
}
