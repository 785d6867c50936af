//! The law: whatever led to a state, tetrahedra, labels and surface are those built from it from scratch.

use std::num::NonZeroU64;

use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::*;
use crate::labels::CutOptions;
use events::{Event, apply};

mod events;

/// Where the coordinates of a sequence come from.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Space {
    /// Small integers: points repeat, rays meet vertices and edges and run inside facets.
    Grid,
    /// Points on a grid, everything else anywhere.
    GridPoints,
    /// Far from the origin with millimetre detail.
    Far,
    /// Uniform.
    Cube,
    /// Points in a plane, views on both sides: the dimension changes.
    Plane,
}

const SPACES: [Space; 5] = [
    Space::Grid,
    Space::GridPoints,
    Space::Far,
    Space::Cube,
    Space::Plane,
];

fn integer(rng: &mut ChaCha8Rng, low: i32, high: i32) -> f64 {
    f64::from(rng.random_range(low..=high))
}

fn position(rng: &mut ChaCha8Rng, space: Space) -> Point3<f64> {
    let mut draw = || match space {
        Space::Grid | Space::GridPoints | Space::Plane => integer(rng, 0, 3),
        Space::Far => 1e7 + integer(rng, 0, 3000) / 1000.0,
        Space::Cube => rng.random_range(0.0..3.0),
    };
    let (x, y, z) = (draw(), draw(), draw());
    if matches!(space, Space::Plane) && rng.random_range(0..8) > 0 {
        return Point3::new(x, y, 1.0);
    }
    Point3::new(x, y, z)
}

/// Inside, on the boundary and outside of where the points are.
fn center(rng: &mut ChaCha8Rng, space: Space) -> Point3<f64> {
    match space {
        Space::Grid | Space::Plane => Point3::from(std::array::from_fn(|_| {
            f64::from(rng.random_range(-3..=9)) / 2.0
        })),
        Space::Far => Point3::from(std::array::from_fn(|_| {
            1e7 + integer(rng, -1000, 4000) / 1000.0
        })),
        _ => Point3::from(std::array::from_fn(|_| rng.random_range(-1.0..4.0))),
    }
}

/// Weights of either sign, few of them beyond 32 bits in sum.
fn sample_weight(rng: &mut ChaCha8Rng) -> i32 {
    match rng.random_range(0..8) {
        0 => i32::MAX,
        1 => i32::MIN,
        2 => 0,
        _ => rng.random_range(-1000..1000) * 256,
    }
}

/// A random event, not necessarily valid.
fn event(rng: &mut ChaCha8Rng, space: Space, carver: &Carver) -> Event {
    let view = ViewId(rng.random_range(0..carver.next_view().0.max(1)));
    let point = PointId(rng.random_range(0..carver.next_point().0.max(1)));
    let sample = SampleId(rng.random_range(0..carver.sample_count() as u32 + 2));
    match rng.random_range(0..30) {
        22..26 => Event::AddSample {
            position: match rng.random() {
                true => position(rng, space),
                false => center(rng, space),
            },
            weight: sample_weight(rng),
        },
        26..28 => Event::ChangeSample {
            sample,
            by: sample_weight(rng),
        },
        28..30 => Event::RemoveSample { sample },
        0..5 => Event::AddPoint {
            position: position(rng, space),
        },
        5 => Event::AddView {
            center: center(rng, space),
        },
        6..12 => Event::AddObservation {
            view,
            point,
            weight: rng.random_range(1..1000),
        },
        12..14 => Event::RemovePoint { point },
        14..16 => Event::MovePoint {
            point,
            position: position(rng, space),
        },
        16 if rng.random_range(0..3) == 0 => Event::RemoveView { view },
        16 | 17 => Event::MoveView {
            view,
            center: center(rng, space),
        },
        18 => Event::RemoveObservation { view, point },
        _ => Event::SetSigma {
            point,
            sigma: match rng.random_range(0..4) {
                0 => None,
                1 => Some(0.0),
                2 => Some(0.5),
                _ => Some(rng.random_range(0.0..2.0)),
            },
        },
    }
}

/// A view and some points that it sees, and some older ones.
fn keyframe(rng: &mut ChaCha8Rng, space: Space, carver: &Carver) -> Vec<Event> {
    let view = carver.next_view();
    let mut events = vec![Event::AddView {
        center: center(rng, space),
    }];
    let first = carver.next_point().0;
    let count = rng.random_range(0..8);
    for _ in 0..count {
        events.push(Event::AddPoint {
            position: position(rng, space),
        });
    }
    for point in (0..first + count).map(PointId) {
        let known = point.0 >= first || carver.point(point).is_some();
        if known && rng.random_range(0..3) > 0 {
            events.push(Event::AddObservation {
                view,
                point,
                weight: rng.random_range(1..1000),
            });
        }
    }
    for _ in 0..rng.random_range(0..8) {
        events.push(Event::AddSample {
            position: center(rng, space),
            weight: sample_weight(rng),
        });
    }
    events
}

/// The triangles that a reader of deltas holds.
#[derive(Default)]
struct Follower {
    triangles: std::collections::BTreeMap<Triangle, [[u64; 3]; 3]>,
}

impl Follower {
    fn follow(&mut self, carver: &Carver, delta: &crate::surface::SurfaceDelta) {
        let at = |v: VertexId| carver.tetrahedra().coordinates(v).map(f64::to_bits);
        for triangle in &delta.removed {
            assert!(self.triangles.remove(triangle).is_some());
        }
        for (triangle, positions) in &mut self.triangles {
            for (vertex, position) in triangle.iter().zip(positions) {
                if delta.moved.contains(vertex) {
                    *position = at(*vertex);
                }
            }
        }
        for triangle in &delta.added {
            let before = self.triangles.insert(*triangle, triangle.map(at));
            assert_eq!(before, None);
        }
        let expected: std::collections::BTreeMap<_, _> =
            carver.triangles().map(|t| (t, t.map(at))).collect();
        assert_eq!(self.triangles, expected);
    }
}

/// A violation with the geometry of its witness.
fn describe(carver: &Carver, violation: CarverViolation) -> String {
    if let CarverViolation::Weight { cell, .. } = violation {
        let rays = carver.rays.table();
        let listed: Vec<_> = (carver.rays.crossings().of(cell))
            .map(|r| {
                let (view, point) = (rays.view(r), rays.point(r));
                let at = (carver.views.center(view), carver.point(PointId(point)));
                let crosses = carver
                    .rays
                    .crosses(&carver.tetrahedra, &carver.views, r, cell);
                (
                    r,
                    view,
                    point,
                    rays.weight(r),
                    at,
                    crosses,
                    rays.is_degenerate(r),
                )
            })
            .collect();
        return format!(
            "{violation}: {:?} {listed:#?}",
            carver.tetrahedra.cell_vertices(cell)
        );
    }
    let CarverViolation::Crossing {
        cell, view, point, ..
    } = violation
    else {
        return violation.to_string();
    };
    let t = carver.tetrahedra();
    let corners: Vec<_> = (t.cell_vertices(cell).into_iter())
        .filter(|v| !v.is_ghost())
        .map(|v| t.coordinates(v))
        .collect();
    let rays = carver.rays.table();
    let ray = rays.find(view.0, point.0).map(|r| rays.is_degenerate(r));
    let (center, target) = (carver.view(view), carver.point(point));
    let at = carver.views.viewpoint(view.0);
    format!("{violation}: {corners:?}, {center:?} ({at:?}) -> {target:?}, degenerate {ray:?}")
}

/// Names the sequence that a panic comes from.
struct Named(u64);

impl Drop for Named {
    fn drop(&mut self) {
        if std::thread::panicking() {
            eprintln!("in the sequence of seed {}", self.0);
        }
    }
}

/// Runs a random sequence of transactions and verifies the law on the way and at the end.
fn run(seed: u64, steps: usize) {
    let _named = Named(seed);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let space = SPACES[(seed % SPACES.len() as u64) as usize];
    let labels = if rng.random() {
        Labels::Votes(Votes {
            threshold: NonZeroU64::new(rng.random_range(1..1500)).unwrap_or(NonZeroU64::MIN),
        })
    } else {
        // On a grid, points behind points lie in cells, on facets, edges and vertices.
        Labels::Cut(CutOptions {
            relative_sigma: rng.random_range(0.0..0.3),
            behind_sigmas: rng.random_range(0.0..3.0),
            matter_weight: rng.random_range(0.0..4.0),
            quality_weight: rng.random_range(0.0..300.0),
        })
    };
    let options = CarverOptions {
        labels,
        hull: if rng.random() { Hull::Keep } else { Hull::Drop },
    };
    let mut carver = Carver::new(options);
    let mut follower = Follower::default();
    for step in 0..steps {
        let before = (step % 7 == 3).then(|| carver.snapshot());
        let result = match rng.random_range(0..8) {
            0 | 1 => {
                let events = keyframe(&mut rng, space, &carver);
                apply(&mut carver, &events)
            }
            // Several events together; those that do not apply are left out.
            2..4 => {
                let events: Vec<Event> = (0..rng.random_range(2..12))
                    .map(|_| event(&mut rng, space, &carver))
                    .collect();
                let mut transaction = carver.transaction();
                for event in events {
                    let _ = event.push(&mut transaction);
                }
                transaction.commit()
            }
            _ => {
                let event = event(&mut rng, space, &carver);
                apply(&mut carver, &[event])
            }
        };
        match result {
            Ok(report) => follower.follow(&carver, &report.surface),
            Err(error) => {
                if let Some(before) = before {
                    assert_eq!(
                        carver.snapshot(),
                        before,
                        "seed {seed} step {step}: {error}"
                    );
                }
            }
        }
        if step % 4 == 0
            && let Err(violation) = carver.check()
        {
            panic!(
                "seed {seed} step {step} in {space:?}: {}",
                describe(&carver, violation)
            );
        }
    }
    if let Err(violation) = carver.check() {
        panic!("seed {seed} in {space:?}: {}", describe(&carver, violation));
    }
    let snapshot = carver.snapshot();
    for reverse in [false, true] {
        assert_eq!(
            carver.rebuilt(reverse).snapshot(),
            snapshot,
            "seed {seed} in {space:?}"
        );
    }
    assert_carves_alike(&mut rng, &carver, space);
    take_apart(&mut rng, carver, follower);
}

/// The state of a carver that carved once is that of `carver` bit for bit, evidence included; before and after further
/// changes.
fn assert_carves_alike(rng: &mut ChaCha8Rng, carver: &Carver, space: Space) {
    let mut deferred = Carver::deferred(carver.options());
    let reverse = rng.random();
    carver.rebuild(&mut deferred, reverse);
    assert_eq!(deferred.snapshot(), Snapshot::default());
    assert_eq!(deferred.tetrahedra().vertex_count(), 0);
    let report = deferred.carve();
    assert_eq!(report.surface.added.len(), carver.triangle_count());
    assert_same_cells(carver, &deferred);
    let mut incremental = carver.rebuilt(reverse);
    for _ in 0..3 {
        for _ in 0..10 {
            let event = event(rng, space, &incremental);
            let outcomes = [&mut incremental, &mut deferred].map(|it| apply(it, &[event]).is_ok());
            assert_eq!(outcomes[0], outcomes[1], "{event:?}");
        }
        deferred.carve();
        assert_same_cells(&incremental, &deferred);
    }
    let kept = deferred.snapshot();
    let mut closed = deferred.clone();
    deferred.carve_and_forget();
    let left = deferred.snapshot();
    assert_eq!((left.mesh, deferred.ray_count()), (kept.mesh, 0));
    let labels =
        |cells: &[CarvedCell]| -> Vec<bool> { cells.iter().map(|it| it.is_free).collect() };
    assert_eq!(labels(&left.cells), labels(&kept.cells));
    closed.carve_closed();
    assert_eq!(labels(&closed.snapshot().cells), labels(&kept.cells));
    assert_closed(&closed.snapshot().mesh);
}

/// Each edge has two triangles, in opposite directions, and each vertex one fan.
fn assert_closed(mesh: &IndexedMesh) {
    let mut edges = std::collections::BTreeMap::new();
    for triangle in &mesh.triangles {
        for k in 0..3 {
            *edges
                .entry((triangle[k], triangle[(k + 1) % 3]))
                .or_insert(0) += 1;
        }
    }
    for ((from, to), count) in &edges {
        assert_eq!(
            (*count, edges.get(&(*to, *from))),
            (1, Some(&1)),
            "{from} {to}"
        );
    }
}

/// A slab before a wall: seen from outside, the wall is a body; seen from inside, it is the boundary of the free space.
#[test]
fn a_closed_surface_is_that_of_the_side_where_views_are() {
    for (height, is_body) in [(6.0, true), (1.5, false)] {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut carver = Carver::deferred(CarverOptions {
            labels: Labels::Cut(CutOptions::default()),
            hull: Hull::Drop,
        });
        let mut transaction = carver.transaction();
        let views: Vec<ViewId> = (0..6)
            .map(|k| Point3::new(0.5 + 0.4 * f64::from(k), 1.4, height))
            .map(|center| transaction.add_view(center).unwrap())
            .collect();
        for index in 0..600 {
            // A floor, or the six sides of a box, with points below the floor that nothing sees.
            let mut at: [f64; 3] = std::array::from_fn(|_| rng.random_range(0.0..3.0));
            let is_seen = index % 6 != 5;
            match (is_body, is_seen) {
                (true, true) => at[2] *= 0.01,
                (true, false) => at[2] = -1.0 - 0.01 * at[2],
                (false, _) => at[index % 3] = [0.0, 3.0][index / 3 % 2],
            }
            let point = transaction.add_point(at.into()).unwrap();
            if is_seen || !is_body {
                for view in &views {
                    transaction.add_observation(*view, point, 1).unwrap();
                }
            }
        }
        transaction.commit().unwrap();
        carver.carve_closed();
        assert_eq!(carver.options().hull == Hull::Free, is_body);
        let mesh = carver.mesh(&ExportOptions {
            manifold: true,
            ..ExportOptions::default()
        });
        assert_closed(&mesh);
        // Six times the volume to the side of the normals: that of the free space, which is outside a body.
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|triangle| {
                let [a, b, c] = triangle.map(|corner| mesh.vertices[corner as usize].coords);
                a.cross(&b).dot(&c)
            })
            .sum();
        assert!(mesh.triangles.len() > 50, "{}", mesh.triangles.len());
        assert_eq!(volume > 0.0, is_body, "{volume}");
    }
}

/// Compares labels, surface, weights and evidence of all cells, and what crosses them.
fn assert_same_cells(incremental: &Carver, deferred: &Carver) {
    assert_eq!(deferred.snapshot(), incremental.snapshot());
    if let Err(violation) = deferred.check() {
        panic!("{violation}");
    }
    let across = |carver: &Carver| -> u64 {
        let cells = carver.tetrahedra.cells();
        cells
            .map(|cell| carver.rays_across(cell).count() as u64)
            .sum()
    };
    assert_eq!(across(deferred), across(incremental));
}

/// Removes points one by one, some together with views and samples: the state stays that built from scratch, and in the
/// end nothing is left.
fn take_apart(rng: &mut ChaCha8Rng, mut carver: Carver, mut follower: Follower) {
    let points: Vec<PointId> = carver.points().collect();
    for point in points {
        let mut events = vec![Event::RemovePoint { point }];
        if rng.random_range(0..6) == 0 {
            let view = carver.views().last();
            events.extend(view.map(|view| Event::RemoveView { view }));
        }
        // Some samples are left without any cell.
        if rng.random() {
            let sample = carver.samples().last();
            events.extend(sample.map(|sample| Event::RemoveSample { sample }));
        }
        let report = apply(&mut carver, &events).unwrap();
        follower.follow(&carver, &report.surface);
        if carver.point_count().is_multiple_of(8) {
            carver.check().unwrap();
            assert_eq!(carver.rebuilt(true).snapshot(), carver.snapshot());
        }
    }
    assert_eq!((carver.ray_count(), carver.crossing_count()), (0, 0));
    assert_eq!(carver.triangle_count(), 0);
    let samples: Vec<SampleId> = carver.samples().collect();
    for sample in samples {
        apply(&mut carver, &[Event::RemoveSample { sample }]).unwrap();
    }
    assert_eq!(carver.sample_count(), 0);
    carver.check().unwrap();
}

/// The long mode is asked for by `LINECARVE_LONG_TESTS=1`.
fn sequences(normal: u64, long: u64) -> u64 {
    match std::env::var("LINECARVE_LONG_TESTS") {
        Ok(value) if value == "1" => long,
        _ => normal,
    }
}

#[test]
fn any_sequence_of_events_leads_to_the_state_built_from_scratch() {
    (0..sequences(250, 10_000))
        .into_par_iter()
        .for_each(|seed| run(seed, 40));
}

/// Rays of large transactions are walked in parallel; degenerate ones among them one by one.
#[test]
fn rays_walked_by_several_threads_are_recorded_alike() {
    let build = |space, threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let mut rng = ChaCha8Rng::seed_from_u64(5);
            let mut carver =
                Carver::new(CarverOptions::with_labels(Labels::Votes(Votes::default())));
            for _ in 0..3 {
                let mut transaction = carver.transaction();
                let center = center(&mut rng, space);
                let view = transaction.add_view(center).unwrap();
                for _ in 0..700 {
                    let position = position(&mut rng, space);
                    let point = transaction.add_point(position).unwrap();
                    if position != center {
                        transaction.add_observation(view, point, 1).unwrap();
                    }
                }
                transaction.commit().unwrap();
            }
            carver
        })
    };
    for space in SPACES {
        let [one, three] = [1, 3].map(|threads| build(space, threads));
        assert_eq!(one.snapshot(), three.snapshot(), "{space:?}");
        three.check().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build();
        let mut deferred = Carver::deferred(one.options());
        one.rebuild(&mut deferred, false);
        pool.unwrap().install(|| deferred.carve());
        assert_eq!(deferred.snapshot(), one.snapshot(), "{space:?}");
    }
}

/// Two points in five move: few enough rays to take them out one by one, while most cells are destroyed.
#[test]
fn moves_that_destroy_most_cells_lead_to_the_state_built_from_scratch() {
    for space in [Space::Cube, Space::Far] {
        let mut rng = ChaCha8Rng::seed_from_u64(11);
        let mut carver = Carver::new(CarverOptions::with_labels(Labels::Votes(Votes::default())));
        let mut transaction = carver.transaction();
        let views: Vec<ViewId> = (0..6)
            .map(|_| transaction.add_view(center(&mut rng, space)).unwrap())
            .collect();
        let mut points = vec![];
        for _ in 0..900 {
            let point = transaction.add_point(position(&mut rng, space)).unwrap();
            for &view in &views {
                transaction.add_observation(view, point, 1).unwrap();
            }
            points.push(point);
        }
        transaction.commit().unwrap();
        assert!(carver.rays.crossings().total() / 2 > 1 << 14);
        let moves: Vec<Event> = (points
            .iter()
            .step_by(5)
            .chain(points.iter().skip(1).step_by(5)))
        .map(|&point| Event::MovePoint {
            point,
            position: position(&mut rng, space),
        })
        .collect();
        apply(&mut carver, &moves).unwrap();
        // The check tests every observation against every cell.
        if space == Space::Cube {
            carver.check().unwrap();
        }
        assert_eq!(carver.snapshot(), carver.rebuilt(true).snapshot());
    }
}
