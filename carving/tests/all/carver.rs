//! The carver from outside: known answers, refusals.

use linecarve_carving::{
    Carver, CarverOptions, CommitReport, ExportOptions, Hull, IndexedMesh, Labels, PointError,
    PointId, Transaction, TransactionError, ViewId, Votes,
};
use nalgebra::{Matrix3, Point3};
use std::num::NonZeroU64;

use crate::helpers::carvings::random_carving;

fn closed(threshold: u64) -> Carver {
    Carver::new(CarverOptions::new(
        Labels::Votes(Votes {
            threshold: NonZeroU64::new(threshold).unwrap(),
        }),
        Hull::Keep,
    ))
}

/// Makes changes in one transaction.
fn update(
    carver: &mut Carver,
    changes: impl FnOnce(&mut Transaction<'_>) -> Result<(), TransactionError>,
) -> Result<CommitReport, TransactionError> {
    let mut transaction = carver.transaction();
    changes(&mut transaction)?;
    transaction.commit()
}

fn add_point(carver: &mut Carver, position: Point3<f64>) -> PointId {
    let mut transaction = carver.transaction();
    let point = transaction.add_point(position).unwrap();
    transaction.commit().unwrap();
    point
}

fn observe(carver: &mut Carver, view: ViewId, point: PointId, weight: u32) -> CommitReport {
    update(carver, |t| t.add_observation(view, point, weight)).unwrap()
}

/// A view at the centre and points on the walls of the cube from 0 to `side`, all seen.
fn add_room(carver: &mut Carver, side: i32, center: Point3<f64>) -> (ViewId, Vec<PointId>) {
    let mut transaction = carver.transaction();
    let view = transaction.add_view(center).unwrap();
    let mut points = vec![];
    for i in 0..(side + 1).pow(3) {
        let p = [
            i % (side + 1),
            i / (side + 1) % (side + 1),
            i / (side + 1).pow(2),
        ];
        if p.iter().any(|&c| c == 0 || c == side) {
            let point = transaction
                .add_point(Point3::from(p.map(f64::from)))
                .unwrap();
            transaction.add_observation(view, point, 1).unwrap();
            points.push(point);
        }
    }
    transaction.commit().unwrap();
    (view, points)
}

fn six_volumes(corners: [Point3<f64>; 4]) -> f64 {
    let [a, b, c, d] = corners;
    Matrix3::from_columns(&[b - a, c - a, d - a]).determinant()
}

/// Six times the volume enclosed by a closed mesh whose triangles look inwards.
fn mesh_volume(mesh: &IndexedMesh) -> f64 {
    let at = |t: &[u32; 3]| t.map(|v| mesh.vertices[v as usize]);
    let volume = |t| {
        let [a, b, c] = at(t);
        -six_volumes([Point3::origin(), a, b, c])
    };
    mesh.triangles.iter().map(volume).sum()
}

fn free_volume(carver: &Carver) -> f64 {
    let t = carver.tetrahedra();
    let free = t.cells().filter(|&c| carver.is_free(c));
    free.map(|c| six_volumes(t.cell_vertices(c).map(|v| t.position(v))))
        .sum()
}

#[test]
fn a_closed_surface_encloses_the_free_cells() {
    for seed in 0..20 {
        let carver = random_carving(seed, Hull::Keep);
        carver.check_surface().unwrap();
        let (mesh, free) = (
            mesh_volume(&carver.mesh(&ExportOptions::default())),
            free_volume(&carver),
        );
        assert!(free > 0.0);
        // Sums of some hundred products of order 6^3: rounding stays far below this.
        assert!((mesh - free).abs() < 1e-9 * free, "{seed}: {mesh} {free}");
    }
}

#[test]
fn a_view_in_a_room_frees_the_cells_around_it_and_leaves_the_cells_it_does_not_see() {
    let mut carver = closed(1);
    let (view, points) = add_room(&mut carver, 4, Point3::new(2.1, 1.9, 2.05));
    carver.check().unwrap();
    let t = carver.tetrahedra();
    for cell in t.cells() {
        let rays: Vec<_> = carver.rays_across(cell).collect();
        assert_eq!(carver.weight(cell), rays.len() as u64);
        assert_eq!(carver.is_free(cell), !t.is_ghost(cell) && !rays.is_empty());
    }
    assert!(free_volume(&carver) <= 6.0 * 64.0 + 1e-9);
    // Without the view nothing is free.
    update(&mut carver, |t| t.remove_view(view)).unwrap();
    assert_eq!((carver.ray_count(), carver.triangle_count()), (0, 0));
    assert_eq!(carver.point_count(), points.len());
}

#[test]
fn a_wall_hides_what_is_behind_it() {
    // A wall at x = 1 seen from the origin side, points behind it at x = 2 seen by nobody.
    let mut carver = Carver::new(CarverOptions::with_labels(Labels::Votes(Votes::default())));
    let mut transaction = carver.transaction();
    let centers = [
        [-3.0, 0.1, 0.2],
        [-0.5, 1.1, 1.0],
        [-0.5, -1.0, 1.1],
        [-0.5, 1.0, -1.1],
        [-0.5, -1.1, -1.0],
    ];
    let views = centers.map(|c| transaction.add_view(Point3::from(c)).unwrap());
    for i in 0..25 {
        let (y, z) = (f64::from(i % 5) - 2.0, f64::from(i / 5) - 2.0);
        let near = transaction.add_point(Point3::new(1.0, y, z)).unwrap();
        transaction.add_point(Point3::new(2.0, y, z)).unwrap();
        for view in views {
            transaction.add_observation(view, near, 1).unwrap();
        }
    }
    // Space in front of the wall has to be spanned by points as well.
    let apex = transaction.add_point(Point3::new(-4.0, 0.0, 0.0)).unwrap();
    let report = transaction.commit().unwrap();
    carver.check().unwrap();
    let t = carver.tetrahedra();
    for cell in t.cells().filter(|&c| carver.is_free(c)) {
        for v in t.cell_vertices(cell) {
            assert!(t.position(v).x <= 1.0, "a cell behind the wall is free");
        }
    }
    // 16 squares of two triangles, looking towards the views.
    let wall: Vec<_> = report
        .surface
        .added
        .iter()
        .map(|triangle| triangle.map(|v| t.position(v)))
        .filter(|corners| corners.iter().all(|p| p.x == 1.0))
        .collect();
    assert_eq!(wall.len(), 32);
    for [a, b, c] in wall {
        assert!((b - a).cross(&(c - a)).x < 0.0);
    }
    // Without the apex, the hull ends at the wall: all rays end where they enter.
    update(&mut carver, |t| t.remove_point(apex)).unwrap();
    assert_eq!(carver.triangle_count(), 0);
    carver.check().unwrap();
}

#[test]
fn points_at_one_position_share_a_vertex_and_keep_their_rays() {
    let mut carver = closed(2);
    let (view, points) = add_room(&mut carver, 1, Point3::new(0.4, 0.5, 0.45));
    // Every ray but one crosses the same cells no more than once.
    let before = carver.snapshot();
    let position = carver.point(points[0]).unwrap();
    let twin = add_point(&mut carver, position);
    assert_eq!(carver.vertex_of(twin), carver.vertex_of(points[0]));
    assert_eq!(carver.snapshot(), before);
    observe(&mut carver, view, twin, 1);
    assert_ne!(carver.snapshot(), before);
    carver.check().unwrap();
    // The twin stays when the first goes, and the state is as if it had been the only one.
    update(&mut carver, |t| t.remove_point(points[0])).unwrap();
    assert_eq!(carver.snapshot(), before);
    assert_eq!(carver.point(twin), Some(position));
    // Moved apart, then together again.
    let aside = Point3::new(0.1, 0.2, 0.3);
    update(&mut carver, |t| t.move_point(twin, aside)).unwrap();
    carver.check().unwrap();
    assert_ne!(carver.snapshot(), before);
    update(&mut carver, |t| t.move_point(twin, position)).unwrap();
    assert_eq!(carver.snapshot(), before);
}

#[test]
fn rays_wait_until_there_are_cells() {
    let mut carver = closed(1);
    let mut transaction = carver.transaction();
    let view = transaction.add_view(Point3::new(0.25, 0.25, 0.25)).unwrap();
    transaction.commit().unwrap();
    for p in [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]] {
        let point = add_point(&mut carver, Point3::from(p));
        let report = observe(&mut carver, view, point, 1);
        assert!(report.surface.is_empty());
    }
    assert_eq!((carver.ray_count(), carver.crossing_count()), (4, 0));
    let apex = add_point(&mut carver, Point3::new(0.0, 0.0, 1.0));
    carver.check().unwrap();
    assert!(carver.triangle_count() > 0);
    update(&mut carver, |t| t.remove_point(apex)).unwrap();
    assert_eq!((carver.triangle_count(), carver.crossing_count()), (0, 0));
    assert_eq!(carver.ray_count(), 4);
}

#[test]
fn weights_add_up_to_the_threshold() {
    let mut carver = closed(1000);
    // Eight rays of weight 1.
    let (view, points) = add_room(&mut carver, 1, Point3::new(0.4, 0.5, 0.45));
    observe(&mut carver, view, points[0], 989);
    assert_eq!(carver.observation(view, points[0]), Some(990));
    assert_eq!(carver.triangle_count(), 0);
    let report = observe(&mut carver, view, points[0], 10);
    assert_eq!(report.surface.added.len(), carver.triangle_count());
    assert!(carver.triangle_count() > 0);
    let point = points[0];
    let report = update(&mut carver, |t| t.remove_observation(view, point)).unwrap();
    assert!(!report.surface.removed.is_empty());
    assert_eq!(carver.triangle_count(), 0);
}

#[test]
fn refusals_name_the_cause_and_leave_the_state_as_it_was() {
    let mut carver = closed(1);
    let center = Point3::new(0.4, 0.5, 0.45);
    let (view, points) = add_room(&mut carver, 1, center);
    let (gone, point) = (points[3], points[0]);
    let missing = points[1];
    update(&mut carver, |t| {
        t.remove_point(gone)?;
        t.remove_observation(view, missing)
    })
    .unwrap();
    let before = carver.snapshot();
    let next = (carver.next_point(), carver.next_view());
    let nan = Point3::new(0.0, f64::NAN, 0.0);
    let far = Point3::new(f64::INFINITY, 0.0, 0.0);
    let unknown_view = ViewId(77);
    type Change<'a> = &'a dyn Fn(&mut Transaction<'_>) -> Result<(), TransactionError>;
    let not_a_number = TransactionError::Position(PointError::NotANumber { axis: 'y' });
    let infinite = PointError::TooLarge {
        axis: 'x',
        value: f64::INFINITY,
    };
    let unknown_point = PointId(1000);
    let cases: [(Change<'_>, TransactionError); 12] = [
        (&|t| t.add_point(nan).map(|_| ()), not_a_number),
        (
            &|t| t.add_view(far).map(|_| ()),
            TransactionError::Position(infinite),
        ),
        (&|t| t.move_point(point, nan), not_a_number),
        (&|t| t.move_view(view, nan), not_a_number),
        (
            &|t| t.remove_point(gone),
            TransactionError::UnknownPoint { point: gone },
        ),
        (
            &|t| t.add_observation(view, unknown_point, 1),
            TransactionError::UnknownPoint {
                point: unknown_point,
            },
        ),
        (
            &|t| t.add_observation(unknown_view, point, 1),
            TransactionError::UnknownView { view: unknown_view },
        ),
        (
            &|t| t.remove_observation(view, missing),
            TransactionError::UnknownObservation {
                view,
                point: missing,
            },
        ),
        (
            &|t| t.add_observation(view, point, 0),
            TransactionError::ZeroWeight { view, point },
        ),
        (
            &|t| t.add_observation(view, point, u32::MAX),
            TransactionError::WeightOverflow { view, point },
        ),
        (
            &|t| t.move_point(point, center),
            TransactionError::ZeroLengthRay { view, point },
        ),
        (
            &|t| t.move_view(view, Point3::origin()),
            TransactionError::ZeroLengthRay { view, point },
        ),
    ];
    for (change, expected) in cases {
        // A valid change before it must not take effect either.
        let refused = update(&mut carver, |t| {
            t.add_point(Point3::new(0.3, 0.2, 0.1))?;
            change(t)
        });
        assert_eq!(refused, Err(expected));
        assert!(!expected.to_string().is_empty());
        assert_eq!(carver.snapshot(), before);
        assert_eq!((carver.next_point(), carver.next_view()), next);
    }
    carver.check().unwrap();
}

#[test]
fn a_dropped_transaction_has_no_effect() {
    let mut carver = closed(1);
    add_room(&mut carver, 2, Point3::new(0.9, 1.1, 0.8));
    let before = carver.snapshot();
    let mut transaction = carver.transaction();
    transaction.add_point(Point3::new(0.5, 0.5, 0.5)).unwrap();
    transaction.remove_point(PointId(3)).unwrap();
    assert!(transaction.remove_point(PointId(3)).is_err());
    drop(transaction);
    assert_eq!(carver.snapshot(), before);
}

#[test]
fn within_a_transaction_only_the_final_state_counts() {
    let mut carver = closed(1);
    let (view, points) = add_room(&mut carver, 2, Point3::new(0.9, 1.1, 0.8));
    let before = carver.snapshot();
    let position = carver.point(points[4]).unwrap();
    let point = points[4];
    let mut transaction = carver.transaction();
    // On the way the ray has no length.
    transaction
        .move_point(point, Point3::new(0.9, 1.1, 0.8))
        .unwrap();
    transaction.move_point(point, position).unwrap();
    let passing = transaction.add_point(Point3::new(0.7, 0.6, 0.5)).unwrap();
    transaction.add_observation(view, passing, 9).unwrap();
    transaction.remove_point(passing).unwrap();
    transaction.remove_observation(view, point).unwrap();
    transaction.add_observation(view, point, 1).unwrap();
    let report = transaction.commit().unwrap();
    assert!(report.surface.is_empty());
    assert_eq!(report.destroyed_cells, 0);
    assert_eq!(carver.snapshot(), before);
    assert_eq!(carver.point(passing), None);
}
