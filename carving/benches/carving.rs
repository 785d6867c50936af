//! Cost of rays, of surface extraction and of a keyframe along a long run, in a furnished room.
//!
//! `cargo bench -p linecarve-carving --bench carving`; 50,000 points with `LINECARVE_LONG_BENCHES=1`.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use linecarve_carving::carver::{Carver, CarverOptions, Event, PointId, ViewId};
use linecarve_carving::labels::{CutOptions, Labels};
use linecarve_carving::surface::ExportOptions;
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// What a keyframe brings.
struct Keyframe {
    center: Point3<f64>,
    new_points: Vec<Point3<f64>>,
    /// Older points, by their number of arrival.
    seen_again: Vec<usize>,
}

impl Keyframe {
    fn rays(&self) -> usize {
        self.new_points.len() + self.seen_again.len()
    }
}

/// A camera on a loop in a room of 6 x 4 x 3 m turns five times round and sees the points of the walls in a cone of 90
/// degrees, each point in about 14 of 100 keyframes.
fn room(points: usize, keyframes: usize) -> Vec<Keyframe> {
    const HALF_M: [f64; 3] = [3.0, 2.0, 1.5];
    const OFF_WALL_M: f64 = 1e-4;
    let mut rng = ChaCha8Rng::seed_from_u64(points as u64);
    let poses: Vec<(Point3<f64>, Vector3<f64>)> = (0..keyframes)
        .map(|i| {
            let angle = std::f64::consts::TAU * i as f64 / keyframes as f64;
            let center = Point3::new(
                1.68 * angle.cos(),
                1.12 * angle.sin(),
                0.3 * (3.0 * angle).sin() + 0.36,
            );
            let (look, tilt) = (5.0 * angle, 0.75 * (7.0 * angle).sin());
            let forward =
                Vector3::new(look.cos() * tilt.cos(), look.sin() * tilt.cos(), tilt.sin());
            (center, forward)
        })
        .collect();
    let mut keyframes: Vec<Keyframe> = poses
        .iter()
        .map(|&(center, _)| Keyframe {
            center,
            new_points: vec![],
            seen_again: vec![],
        })
        .collect();
    let mut views_of_point: Vec<(Point3<f64>, Vec<usize>)> = vec![];
    while views_of_point.len() < points {
        let mut p = Point3::from(HALF_M.map(|h| rng.random_range(-h..h)));
        let axis = rng.random_range(0..3);
        let wall = if rng.random() {
            HALF_M[axis]
        } else {
            -HALF_M[axis]
        };
        p[axis] = wall + rng.random_range(-OFF_WALL_M..OFF_WALL_M);
        let views: Vec<usize> = (0..poses.len())
            .filter(|&i| {
                let to = p - poses[i].0;
                to.dot(&poses[i].1) > std::f64::consts::FRAC_1_SQRT_2 * to.norm()
            })
            .collect();
        if !views.is_empty() {
            views_of_point.push((p, views));
        }
    }
    views_of_point.sort_by_key(|(_, views)| views[0]);
    for (number, (point, views)) in views_of_point.into_iter().enumerate() {
        keyframes[views[0]].new_points.push(point);
        for &view in &views[1..] {
            keyframes[view].seen_again.push(number);
        }
    }
    keyframes
}

fn add(carver: &mut Carver, keyframe: &Keyframe, ids: &mut Vec<PointId>) {
    let mut transaction = carver.transaction();
    let view = transaction.add_view(keyframe.center).expect("in range");
    let first = ids.len();
    for &point in &keyframe.new_points {
        ids.push(transaction.add_point(point).expect("in range"));
    }
    let seen = ids[first..].iter().copied();
    for point in seen.chain(keyframe.seen_again.iter().map(|&i| ids[i])) {
        transaction
            .add_observation(view, point, 1)
            .expect("the point is known");
    }
    black_box(transaction.commit().expect("no ray is of zero length"));
}

fn fill(keyframes: &[Keyframe]) -> (Carver, Vec<PointId>) {
    fill_with(keyframes, Labels::default())
}

fn fill_with(keyframes: &[Keyframe], labels: Labels) -> (Carver, Vec<PointId>) {
    let mut carver = Carver::new(CarverOptions {
        labels,
        ..CarverOptions::default()
    });
    let mut ids = vec![];
    for keyframe in keyframes {
        add(&mut carver, keyframe, &mut ids);
    }
    (carver, ids)
}

fn sizes() -> Vec<usize> {
    let long = std::env::var_os("LINECARVE_LONG_BENCHES").is_some_and(|value| value != "0");
    if long {
        vec![5_000, 20_000, 50_000]
    } else {
        vec![5_000]
    }
}

/// All keyframes of a run; throughput counts rays.
fn rays(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("rays");
    group.sample_size(10);
    for points in sizes() {
        let keyframes = room(points, 100);
        let count: usize = keyframes.iter().map(Keyframe::rays).sum();
        group.throughput(Throughput::Elements(count as u64));
        group.bench_function(BenchmarkId::from_parameter(points), |bencher| {
            bencher.iter(|| fill(&keyframes).0.triangle_count());
        });
    }
    group.finish();
}

/// Export of the whole surface; throughput counts triangles.
fn surface(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("surface");
    let plain = ExportOptions::default();
    let repaired = ExportOptions {
        manifold: true,
        minimum_component: 20,
        ..plain
    };
    for points in sizes() {
        let (carver, _) = fill(&room(points, 100));
        group.throughput(Throughput::Elements(carver.triangle_count() as u64));
        for (name, options) in [("plain", plain), ("manifold", repaired)] {
            group.bench_function(BenchmarkId::new(name, points), |bencher| {
                bencher.iter(|| carver.mesh(&options));
            });
        }
    }
    group.finish();
}

/// Moving one view with its rays, and 1 % of the points together, and back again.
fn moves(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("moves");
    group.sample_size(10);
    for points in sizes() {
        let (mut carver, ids) = fill(&room(points, 100));
        let view = ViewId(50);
        let center = carver.view(view).expect("100 views");
        let mut aside = false;
        group.bench_function(BenchmarkId::new("view", points), |bencher| {
            bencher.iter(|| {
                aside = !aside;
                let center = center + Vector3::x() * if aside { 0.02 } else { 0.0 };
                carver.apply(&[Event::MoveView { view, center }])
            });
        });
        let chosen: Vec<(PointId, Point3<f64>)> = (ids.iter().step_by(100))
            .map(|&id| (id, carver.point(id).expect("never removed")))
            .collect();
        group.throughput(Throughput::Elements(chosen.len() as u64));
        group.bench_function(BenchmarkId::new("points", points), |bencher| {
            bencher.iter(|| {
                aside = !aside;
                let step = Vector3::new(0.01, 0.008, 0.006) * if aside { 1.0 } else { 0.0 };
                let events: Vec<Event> = (chosen.iter())
                    .map(|&(point, position)| Event::MovePoint {
                        point,
                        position: position + step,
                    })
                    .collect();
                carver.apply(&events)
            });
        });
    }
    group.finish();
}

/// The same number of rays early and late in a run: keyframes of a camera that walks down a corridor and never looks
/// back, so that the map grows while the neighbourhood of a keyframe stays the same.
fn long_run(criterion: &mut Criterion) {
    const KEYFRAMES: usize = 400;
    const POINTS: usize = 40;
    const STEP_M: f64 = 0.25;
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let keyframes: Vec<Keyframe> = (0..KEYFRAMES)
        .map(|i| {
            let x = i as f64 * STEP_M;
            let new_points = (0..POINTS)
                .map(|_| {
                    let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                    let ahead = rng.random_range(1.0..3.0);
                    Point3::new(x + ahead, 1.2 * angle.cos(), 1.2 * angle.sin())
                })
                .collect();
            let oldest = i.saturating_sub(4) * POINTS;
            Keyframe {
                center: Point3::new(x, 0.1 * (0.3 * x).sin(), 0.05),
                new_points,
                seen_again: (oldest..i * POINTS).collect(),
            }
        })
        .collect();
    let mut group = criterion.benchmark_group("keyframe");
    group.sample_size(10);
    let kinds = [
        ("votes", Labels::default()),
        ("cut", Labels::Cut(CutOptions::default())),
    ];
    let tenths = [("second tenth", 1), ("last tenth", 9)];
    for ((kind, labels), (name, tenth)) in kinds
        .into_iter()
        .flat_map(|kind| tenths.map(|tenth| (kind, tenth)))
    {
        let length = KEYFRAMES / 10;
        let (carver, ids) = fill_with(&keyframes[..tenth * length], labels);
        let timed = &keyframes[tenth * length..][..length];
        group.throughput(Throughput::Elements(length as u64));
        group.bench_function(BenchmarkId::new(kind, name), |bencher| {
            bencher.iter_custom(|iterations| {
                let mut total = Duration::ZERO;
                for _ in 0..iterations {
                    let (mut carver, mut ids) = (carver.clone(), ids.clone());
                    let start = Instant::now();
                    for keyframe in timed {
                        add(&mut carver, keyframe, &mut ids);
                    }
                    total += start.elapsed();
                }
                total
            });
        });
    }
    group.finish();
}

criterion_group!(benches, rays, surface, moves, long_run);
criterion_main!(benches);
