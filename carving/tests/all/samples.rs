//! Samples from outside: thin things, ties, growth of the hull, sums, ids, refusals.

use linecarve_carving::{
    Carver, CarverOptions, CutOptions, Hull, Labels, Location, PointId, SampleId, TransactionError,
    Votes,
};
use nalgebra::Point3;

/// The weight of a ray of weight 1.
const RAY: i32 = 256;

fn cut(hull: Hull) -> Carver {
    Carver::new(CarverOptions::new(Labels::Cut(CutOptions::default()), hull))
}

fn p(x: f64, y: f64, z: f64) -> Point3<f64> {
    Point3::new(x, y, z)
}

/// Verifies the carver and that it equals those built from scratch.
fn assert_lawful(carver: &Carver) {
    carver.check().unwrap();
    for reverse in [false, true] {
        assert_eq!(carver.rebuilt(reverse).snapshot(), carver.snapshot());
    }
}

/// Whether the cell at a position in general position is free.
fn is_free_at(carver: &Carver, position: Point3<f64>) -> bool {
    match carver.tetrahedra().locate(&position, None).unwrap() {
        Location::InCell(cell) => carver.is_free(cell),
        Location::Outside(_) => false,
        other => panic!("{position} is at {other:?}"),
    }
}

/// A board of 9 by 9 points before a wall, seen from the front and from both sides: rays to the wall pass closely behind it.
fn board() -> Carver {
    let mut carver = cut(Hull::Drop);
    let mut transaction = carver.transaction();
    let view = |x, y, z| p(x, y, z);
    let front = [view(-0.4, 0.3, 4.0), view(0.5, -0.2, 4.1)];
    let sides = [view(-5.0, 0.1, 0.6), view(5.1, -0.2, 0.7)];
    let front = front.map(|center| transaction.add_view(center).unwrap());
    let sides = sides.map(|center| transaction.add_view(center).unwrap());
    for i in -4..=4 {
        for j in -4..=4 {
            let (x, y) = (f64::from(i) * 0.25, f64::from(j) * 0.25);
            let board = transaction
                .add_point(p(x + 0.01 * y, y - 0.02 * x, 0.001 * x * y))
                .unwrap();
            transaction.set_sigma(board, Some(0.01)).unwrap();
            for view in front {
                transaction.add_observation(view, board, 1).unwrap();
            }
            let wall = p(2.5 * x + 0.03 * y, 2.5 * y - 0.01 * x, -0.5 - 0.01 * x * y);
            let wall = transaction.add_point(wall).unwrap();
            transaction.set_sigma(wall, Some(0.01)).unwrap();
            for view in sides {
                transaction.add_observation(view, wall, 3).unwrap();
            }
        }
    }
    // Around the views, so that these are inside of the hull.
    for (x, y) in [(-7.0, -6.9), (7.1, -7.0), (-6.9, 7.0), (7.0, 7.1)] {
        transaction.add_point(p(x, y, 6.0)).unwrap();
        transaction.add_point(p(x, y, -1.0)).unwrap();
    }
    transaction.commit().unwrap();
    carver
}

/// Surface triangles whose corners are on the board.
fn triangles_of_board(carver: &Carver) -> usize {
    let is_on_board = |v| {
        let position = carver.tetrahedra().position(v);
        position.z.abs() < 0.01
    };
    let triangles = carver.triangles();
    triangles
        .filter(|triangle| triangle.iter().all(|&v| is_on_board(v)))
        .count()
}

#[test]
fn samples_keep_a_board_that_rays_pass_closely_behind() {
    let mut carver = board();
    let without = triangles_of_board(&carver);
    let mut transaction = carver.transaction();
    let mut samples = Vec::new();
    for i in -40..=40 {
        for j in -40..=40 {
            let (x, y) = (f64::from(i) * 0.025, f64::from(j) * 0.025);
            let sample = transaction.add_sample(p(x, y, -0.02), -2 * RAY);
            samples.push(sample.unwrap());
        }
    }
    transaction.commit().unwrap();
    let with = triangles_of_board(&carver);
    // All of it is 128 triangles.
    assert!(without < 20 && with > 100, "{without} {with}");
    assert_lawful(&carver);
    let mut deferred = Carver::deferred(carver.options());
    fill_alike(&carver, &mut deferred);
    deferred.carve();
    deferred.check().unwrap();
    assert_eq!(deferred.snapshot(), carver.snapshot());

    let mut transaction = carver.transaction();
    for sample in samples {
        transaction.remove_sample(sample).unwrap();
    }
    transaction.commit().unwrap();
    assert_eq!(
        (carver.sample_count(), triangles_of_board(&carver)),
        (0, without)
    );
    assert_lawful(&carver);
}

/// Adds all of one carver to another, whose ids become the same.
fn fill_alike(from: &Carver, to: &mut Carver) {
    let mut transaction = to.transaction();
    for view in from.views() {
        transaction.add_view(from.view(view).unwrap()).unwrap();
    }
    for point in from.points() {
        let id = transaction.add_point(from.point(point).unwrap()).unwrap();
        transaction.set_sigma(id, from.sigma(point)).unwrap();
    }
    for (view, point, weight) in from.observations() {
        transaction.add_observation(view, point, weight).unwrap();
    }
    for sample in from.samples() {
        let (position, weight) = from.sample(sample).unwrap();
        transaction.add_sample(position, weight).unwrap();
    }
    transaction.commit().unwrap();
}

/// Points on a grid, all of whose cells have ties, and samples at their corners, edges, facets and inside; the points come
/// after the samples, one by one, and go again.
#[test]
fn samples_on_the_boundary_of_cells_have_one_cell() {
    let mut carver = cut(Hull::Keep);
    let mut transaction = carver.transaction();
    for i in -1..=9 {
        for j in -1..=9 {
            for k in -1..=9 {
                let position = Point3::from([i, j, k].map(f64::from)) / 4.0;
                let weight = (i - 2 * j + 3 * k) * 50 * RAY + 7;
                transaction.add_sample(position, weight).unwrap();
            }
        }
    }
    transaction.commit().unwrap();
    assert_lawful(&carver);
    let mut points: Vec<PointId> = Vec::new();
    for number in 0..27 {
        // All of a plane first: there are no cells until the tenth.
        let position = [number / 9, number / 3 % 3, number % 3].map(f64::from);
        let mut transaction = carver.transaction();
        points.push(transaction.add_point(position.into()).unwrap());
        transaction.commit().unwrap();
        if number % 4 == 1 {
            assert_lawful(&carver);
        }
    }
    assert!(carver.triangle_count() > 0);
    assert_lawful(&carver);
    for (number, point) in points.into_iter().enumerate() {
        let mut transaction = carver.transaction();
        match number % 3 {
            0 => transaction.move_point(point, p(0.5, 0.25, 1.75)).unwrap(),
            _ => transaction.remove_point(point).unwrap(),
        }
        transaction.commit().unwrap();
        if number % 4 == 1 {
            assert_lawful(&carver);
        }
    }
    assert_eq!(carver.tetrahedra().dimension(), 0);
    assert_lawful(&carver);
}

fn add_tetrahedron(carver: &mut Carver) {
    let mut transaction = carver.transaction();
    for corner in [p(0., 0., 0.), p(1., 0., 0.), p(0., 1., 0.), p(0., 0., 1.)] {
        transaction.add_point(corner).unwrap();
    }
    transaction.commit().unwrap();
}

#[test]
fn a_sample_outside_the_hull_counts_when_the_hull_grows_over_it() {
    let mut carver = cut(Hull::Keep);
    add_tetrahedron(&mut carver);
    let mut transaction = carver.transaction();
    transaction.add_sample(p(2.0, 2.1, 1.9), 100 * RAY).unwrap();
    transaction.commit().unwrap();
    assert_eq!(carver.triangle_count(), 0);
    assert_lawful(&carver);
    let mut transaction = carver.transaction();
    let far = transaction.add_point(p(5.0, 5.0, 5.0)).unwrap();
    transaction.commit().unwrap();
    assert!(is_free_at(&carver, p(2.0, 2.1, 1.9)));
    // A surface between the two cells would cost more than none.
    assert_eq!(carver.triangle_count(), 6);
    assert_lawful(&carver);
    // A move that keeps the cells leaves it outside, another takes it in again.
    for (x, is_inside) in [(1.5, false), (6.0, true)] {
        let mut transaction = carver.transaction();
        transaction.move_point(far, p(x, x, x)).unwrap();
        transaction.commit().unwrap();
        assert_eq!(is_free_at(&carver, p(2.0, 2.1, 1.9)), is_inside);
        assert_lawful(&carver);
    }
    let mut transaction = carver.transaction();
    transaction.remove_point(far).unwrap();
    transaction.commit().unwrap();
    assert_eq!(carver.triangle_count(), 0);
    assert_lawful(&carver);
}

#[test]
fn weights_of_samples_add_up_and_cancel() {
    let mut carver = cut(Hull::Keep);
    let inside = [p(0.1, 0.2, 0.3), p(0.25, 0.25, 0.25)];
    // Before there are cells they wait.
    let mut transaction = carver.transaction();
    let free = transaction.add_sample(inside[0], i32::MAX).unwrap();
    transaction.commit().unwrap();
    add_tetrahedron(&mut carver);
    let is_free = |carver: &Carver| is_free_at(carver, inside[0]);
    assert!(is_free(&carver));
    // Sums beyond 32 bits.
    let mut transaction = carver.transaction();
    let more = transaction.add_sample(inside[1], i32::MAX).unwrap();
    let most = transaction.add_sample(inside[1], i32::MAX).unwrap();
    transaction.commit().unwrap();
    assert_lawful(&carver);
    let mut transaction = carver.transaction();
    for _ in 0..2 {
        transaction.change_sample(more, i32::MIN).unwrap();
        transaction.change_sample(most, i32::MIN).unwrap();
    }
    transaction.commit().unwrap();
    assert_eq!(carver.sample(more), Some((inside[1], i32::MIN)));
    assert!(!is_free(&carver));
    assert_lawful(&carver);
    let mut transaction = carver.transaction();
    transaction.remove_sample(more).unwrap();
    transaction.remove_sample(most).unwrap();
    transaction.commit().unwrap();
    assert!(is_free(&carver));
    let mut transaction = carver.transaction();
    transaction.add_sample(inside[1], -i32::MAX).unwrap();
    transaction.commit().unwrap();
    assert!(!is_free(&carver));
    assert_lawful(&carver);
    let mut transaction = carver.transaction();
    transaction.remove_sample(free).unwrap();
    transaction.commit().unwrap();
    assert_eq!((carver.sample_count(), is_free(&carver)), (1, false));
    assert_lawful(&carver);
}

#[test]
fn votes_keep_samples_and_ignore_them() {
    let mut carver = Carver::new(CarverOptions::with_labels(Labels::Votes(Votes::default())));
    add_tetrahedron(&mut carver);
    let mut transaction = carver.transaction();
    let sample = transaction.add_sample(p(0.1, 0.2, 0.3), 100 * RAY).unwrap();
    transaction.commit().unwrap();
    assert_eq!(carver.triangle_count(), 0);
    assert_eq!(carver.sample(sample), Some((p(0.1, 0.2, 0.3), 100 * RAY)));
    assert_lawful(&carver);
}

#[test]
fn ids_of_samples_serve_at_once_and_unknown_ones_are_refused() {
    let mut carver = cut(Hull::Keep);
    let unknown = |sample| Err(TransactionError::UnknownSample { sample });
    let mut transaction = carver.transaction();
    assert_eq!(
        transaction.change_sample(SampleId(0), 1),
        unknown(SampleId(0))
    );
    let [a, b, c] = [1.0, 2.0, 3.0].map(|x| transaction.add_sample(p(x, 0.0, 0.0), 5).unwrap());
    transaction.change_sample(b, 6).unwrap();
    transaction.remove_sample(c).unwrap();
    assert_eq!(transaction.remove_sample(c), unknown(c));
    assert!(matches!(
        transaction.add_sample(p(f64::NAN, 0.0, 0.0), 1),
        Err(TransactionError::Position(_))
    ));
    transaction.commit().unwrap();
    assert_eq!(carver.samples().collect::<Vec<_>>(), [a, b]);
    assert_eq!(carver.sample(b), Some((p(2.0, 0.0, 0.0), 11)));
    assert_eq!(carver.sample(c), None);

    let mut transaction = carver.transaction();
    transaction.remove_sample(a).unwrap();
    assert_eq!(transaction.change_sample(a, 1), unknown(a));
    // The id that was free before, then a new one.
    let again = transaction.add_sample(p(4.0, 0.0, 0.0), 7).unwrap();
    let new = transaction.add_sample(p(5.0, 0.0, 0.0), 8).unwrap();
    assert_eq!((again, new), (c, SampleId(3)));
    transaction.change_sample(again, -9).unwrap();
    transaction.commit().unwrap();
    assert_eq!(carver.samples().collect::<Vec<_>>(), [b, c, new]);
    assert_eq!(carver.sample(again), Some((p(4.0, 0.0, 0.0), -2)));
    assert_lawful(&carver);
    // Without a commit nothing changes.
    let mut transaction = carver.transaction();
    transaction.remove_sample(b).unwrap();
    transaction.add_sample(p(0.0, 0.0, 0.0), 1).unwrap();
    drop(transaction);
    assert_eq!(carver.samples().collect::<Vec<_>>(), [b, c, new]);
}
