use super::super::options::Tolerance;
use super::*;

/// A box of 4 x 3 x 5, six walls of two triangles, corners shared, facing outwards.
fn room() -> Shape {
    let positions = (0..8)
        .map(|i| {
            Point3::new(
                f64::from(i & 1) * 4.0,
                f64::from(i >> 1 & 1) * 3.0,
                f64::from(i >> 2 & 1) * 5.0,
            )
        })
        .collect();
    let walls = [
        [0, 2, 3, 1],
        [4, 5, 7, 6],
        [0, 1, 5, 4],
        [2, 6, 7, 3],
        [0, 4, 6, 2],
        [1, 3, 7, 5],
    ];
    Shape {
        positions,
        triangles: walls
            .iter()
            .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
            .collect(),
        ..Shape::default()
    }
}

fn within(length: f64) -> DiffOptions {
    DiffOptions {
        tolerance: Tolerance::Length(length),
        samples: 5000,
        ..DiffOptions::default()
    }
}

fn failed(difference: &Difference) -> Vec<Check> {
    let failed = difference.checks.iter().filter(|outcome| !outcome.passed);
    failed.map(|outcome| outcome.check).collect()
}

#[test]
fn a_wall_moved_by_3_cm_is_30_mm_off() {
    let mut moved = room();
    for position in &mut moved.positions {
        if position.z == 5.0 {
            position.z = 5.03;
        }
    }
    let found = compare(&room(), &moved, &within(0.01)).unwrap();
    for distance in [
        found.worst.unwrap().distance,
        found.from_expected.unwrap().max,
        found.from_actual.unwrap().max,
    ] {
        assert!((distance - 0.03).abs() < 1e-12, "{distance}");
    }
    // The wall is 12 of 94 square units.
    let mean = found.from_expected.unwrap().mean;
    assert!((mean - 0.03 * 12.0 / 94.0).abs() < 2e-4, "{mean}");
    assert_eq!(
        failed(&found),
        [Check::Distance, Check::Bounds, Check::Vertices]
    );
    assert!(compare(&room(), &moved, &within(0.0301)).unwrap().is_same);
    // As a share of the diagonal, which is the root of 50.
    let share = |percent: f64| DiffOptions {
        tolerance: Tolerance::ShareOfDiagonal(percent / 100.0),
        ..within(0.0)
    };
    assert!(compare(&room(), &moved, &share(0.43)).unwrap().is_same);
    assert!(!compare(&room(), &moved, &share(0.42)).unwrap().is_same);
}

#[test]
fn a_missing_face_is_found_and_named() {
    let mut open = room();
    let gone = open.triangles.remove(3);
    let found = compare(&room(), &open, &within(0.01)).unwrap();
    assert_eq!(failed(&found), [Check::Distance, Check::Topology]);
    let worst = found.worst.unwrap();
    assert_eq!((worst.on, worst.triangle), (ComparedMesh::Expected, 3));
    assert!(gone.contains(&worst.vertex));
    // The largest circle in half of a wall of 4 by 3 has a radius of 1.
    assert!((0.9..=1.0).contains(&worst.distance), "{worst:?}");
    assert!(found.from_actual.unwrap().max < 1e-12);
    assert_eq!(found.topology[1].boundary_edges, 3);
    let extra = compare(&open, &room(), &within(0.01)).unwrap();
    assert_eq!(extra.worst.unwrap().on, ComparedMesh::Actual);
}

#[test]
fn flipped_faces_are_found_and_thin_walls_are_not_taken_for_them() {
    let mut turned = room();
    for triangle in &mut turned.triangles {
        triangle.swap(0, 1);
    }
    let found = compare(&room(), &turned, &within(0.01)).unwrap();
    assert_eq!(failed(&found), [Check::Orientation]);
    assert_eq!(found.flipped_triangles, 24);
    let mut one = room();
    one.triangles[4].swap(1, 2);
    let found = compare(&room(), &one, &within(0.01)).unwrap();
    assert_eq!(failed(&found), [Check::Orientation, Check::Topology]);
    assert_eq!(found.worst_flipped.unwrap().triangle, 4);

    // A sheet with two sides in one place.
    let mut sheet = room();
    let backs: Vec<_> = sheet
        .triangles
        .iter()
        .map(|[a, b, c]| [*b, *a, *c])
        .collect();
    sheet.triangles.extend(backs);
    assert!(compare(&sheet, &sheet, &within(0.0)).unwrap().is_same);
}

#[test]
fn the_order_of_vertices_and_triangles_makes_no_difference() {
    let room = room();
    let count = room.positions.len() as u32;
    let mut other = Shape {
        positions: room.positions.iter().rev().copied().collect(),
        triangles: room
            .triangles
            .iter()
            .rev()
            .map(|[a, b, c]| [count - 1 - b, count - 1 - c, count - 1 - a])
            .collect(),
        ..Shape::default()
    };
    // A vertex that nothing uses makes none either.
    other.positions.push(Point3::new(100.0, 0.0, 0.0));
    let found = compare(&room, &other, &within(0.0)).unwrap();
    assert!(found.is_same, "{:?}", found.checks);
    assert!(found.worst.unwrap().distance < 1e-12);
    assert_eq!(found.worst_vertex.unwrap().distance, 0.0);
    let with_counts = DiffOptions {
        checks: vec![Check::Counts],
        ..within(0.0)
    };
    assert_eq!(
        failed(&compare(&room, &other, &with_counts).unwrap()),
        [Check::Counts]
    );
}

#[test]
fn a_scaled_mesh_is_off_by_its_growth() {
    let mut grown = room();
    for position in &mut grown.positions {
        *position *= 1.001;
    }
    let found = compare(&room(), &grown, &within(0.004)).unwrap();
    // The farthest corner moves by a thousandth of the diagonal; its nearest point is itself.
    let expected = 0.001 * 50.0_f64.sqrt();
    assert!((found.worst.unwrap().distance - expected).abs() < 1e-12);
    assert_eq!(
        failed(&found),
        [Check::Distance, Check::Bounds, Check::Vertices]
    );
    assert!(compare(&room(), &grown, &within(0.0071)).unwrap().is_same);
}

#[test]
fn a_mesh_is_itself_without_tolerance() {
    // A triangle without area away from the rest.
    let mut mesh = room();
    let count = mesh.positions.len() as u32;
    mesh.positions
        .extend([[5.0; 3], [6.0; 3]].map(Point3::from));
    mesh.triangles.push([count, count + 1, count + 1]);
    // Slivers on which the nearest point is not quite exact.
    for sliver in 0..100 {
        let (first, x) = (mesh.positions.len() as u32, 0.1 + 0.01 * f64::from(sliver));
        let corners = [
            [x, 7.0, 1.0 / x],
            [x + 1.0 / 3.0, 9.1, x],
            [x + 0.1, 7.63 + 1e-9, 0.7 / x + 0.3 * x],
        ];
        mesh.positions.extend(corners.map(Point3::from));
        mesh.triangles.push([first, first + 1, first + 2]);
    }
    let found = compare(&mesh, &mesh, &within(0.0)).unwrap();
    assert!(found.is_same, "{:?}", found.checks);
    assert_eq!(found.worst.unwrap().distance, 0.0);
    // Without its triangle without area the surface is the same; the box is not.
    let mut without = mesh.clone();
    without.triangles.remove(12);
    let found = compare(&mesh, &without, &within(0.01)).unwrap();
    assert_eq!(found.worst.unwrap().distance, 0.0);
    assert!(!failed(&found).contains(&Check::Distance));
}

#[test]
fn empty_meshes_are_like_one_another_alone() {
    let nothing = Shape::default();
    assert!(compare(&nothing, &nothing, &within(0.0)).unwrap().is_same);
    for (expected, actual, word) in [
        (room(), nothing.clone(), "actual mesh is empty"),
        (nothing, room(), "empty mesh was expected"),
    ] {
        let found = compare(&expected, &actual, &within(100.0)).unwrap();
        assert!(!found.is_same);
        assert_eq!(found.worst, None);
        let distance = &found.checks[0];
        assert!(
            !distance.passed && distance.message.contains(word),
            "{distance:?}"
        );
    }
}

#[test]
fn a_vertex_that_slides_within_its_wall_is_found() {
    // The middle of a wall moves within it: the surface stays.
    let fan = |x: f64| Shape {
        positions: [
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [2.0, 2.0, 0.0],
            [0.0, 2.0, 0.0],
            [x, 1.0, 0.0],
        ]
        .map(Point3::from)
        .to_vec(),
        triangles: (0..4).map(|i| [i, (i + 1) % 4, 4]).collect(),
        ..Shape::default()
    };
    let found = compare(&fan(1.0), &fan(1.01), &within(0.005)).unwrap();
    assert!(found.worst.unwrap().distance < 1e-12);
    assert_eq!(failed(&found), [Check::Vertices]);
    let worst = found.worst_vertex.unwrap();
    assert_eq!(worst.vertex, 4);
    assert!((worst.distance - 0.01).abs() < 1e-12);
}

#[test]
fn what_is_no_mesh_cannot_be_compared() {
    let cloud = Shape {
        triangles: Vec::new(),
        ..room()
    };
    assert!(matches!(
        compare(&room(), &cloud, &within(0.1)),
        Err(DiffError::NoMesh {
            which: "actual",
            ..
        })
    ));
    let mut broken = room();
    broken.positions[3].y = f64::NAN;
    assert!(matches!(
        compare(&broken, &room(), &within(0.1)),
        Err(DiffError::Geometry {
            which: "expected",
            ..
        })
    ));
    assert!(compare(&room(), &room(), &within(f64::NAN)).is_err());
    assert!(compare(&room(), &room(), &within(-1.0)).is_err());
}

#[test]
fn every_check_has_a_case_in_the_test_report() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("report.xml");
    let mut open = room();
    open.triangles.remove(3);
    let found = compare(&room(), &open, &within(0.01)).unwrap();
    crate::diff::write_junit(&path, "room <golden>", &found).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(
        text.contains("tests=\"5\"") && text.contains("failures=\"2\""),
        "{text}"
    );
    assert!(text.contains("room &lt;golden&gt;"), "{text}");
    assert_eq!(text.matches("<testcase ").count(), 5);
    assert_eq!(text.matches("</testcase>").count(), 5);
    crate::diff::write_junit_failure(&path, "room", "no such file").unwrap();
    assert!(
        std::fs::read_to_string(&path)
            .unwrap()
            .contains("errors=\"1\"")
    );
}
