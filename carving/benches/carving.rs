//! Cost of rays, keyframe by keyframe and all at once, of surface extraction and of moves, in a room.
//!
//! `cargo bench -p linecarve-carving --bench carving`; 50,000 points with `LINECARVE_LONG_BENCHES=1`.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use linecarve_carving::{
    Carver, CarverOptions, CutOptions, ExportOptions, Labels, PointId, ViewId, Votes,
};
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[allow(dead_code)] // The noise of the other bench and the tests.
#[path = "../tests/all/helpers/rooms.rs"]
mod rooms;

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

/// A room seen by a camera on a loop, its points a little off the walls.
fn room(points: usize, keyframes: usize) -> Vec<Keyframe> {
    const OFF_WALL_M: f64 = 1e-4;
    let mut rng = ChaCha8Rng::seed_from_u64(points as u64);
    let poses = rooms::poses(keyframes);
    let mut keyframes: Vec<Keyframe> = poses
        .iter()
        .map(|pose| Keyframe {
            center: pose.center,
            new_points: vec![],
            seen_again: vec![],
        })
        .collect();
    let mut views_of_point: Vec<(Point3<f64>, Vec<usize>)> = vec![];
    while views_of_point.len() < points {
        let off = Vector3::from_fn(|_, _| rng.random_range(-OFF_WALL_M..OFF_WALL_M));
        let p = rooms::wall_point(&mut rng) + off;
        let views = rooms::views_of(&poses, &p);
        if !views.is_empty() {
            views_of_point.push((p, views));
        }
    }
    views_of_point.sort_by_key(|(_, views)| views[0]);
    for (number, (point, views)) in views_of_point.iter().enumerate() {
        keyframes[views[0]].new_points.push(*point);
        for &view in &views[1..] {
            keyframes[view].seen_again.push(number);
        }
    }
    keyframes
}

/// Points with their rays.
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
    let mut carver = Carver::new(CarverOptions::with_labels(Labels::Votes(Votes::default())));
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

/// All keyframes of a run in a deferred carver, which carves once; throughput counts rays.
fn rays_at_once(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("rays at once");
    group.sample_size(10);
    for points in sizes() {
        let keyframes = room(points, 100);
        let count: usize = keyframes.iter().map(Keyframe::rays).sum();
        group.throughput(Throughput::Elements(count as u64));
        for (labels, name) in [
            (Labels::Votes(Votes::default()), "votes"),
            (Labels::Cut(CutOptions::default()), "cut"),
        ] {
            let options = CarverOptions::with_labels(labels);
            group.bench_function(BenchmarkId::new(name, points), |bencher| {
                bencher.iter(|| {
                    let mut carver = Carver::deferred(options);
                    let mut ids = vec![];
                    for keyframe in &keyframes {
                        add(&mut carver, keyframe, &mut ids);
                    }
                    black_box(carver.carve());
                    carver.triangle_count()
                });
            });
        }
    }
    group.finish();
}

/// Export of the whole surface; throughput counts triangles.
fn surface(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("surface");
    let plain = ExportOptions::default();
    let mut repaired = plain;
    repaired.manifold = true;
    repaired.minimum_component = 20;
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
                let mut transaction = carver.transaction();
                transaction.move_view(view, center)?;
                transaction.commit()
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
                let mut transaction = carver.transaction();
                for &(point, position) in &chosen {
                    transaction.move_point(point, position + step)?;
                }
                transaction.commit()
            });
        });
    }
    group.finish();
}

criterion_group!(benches, rays, rays_at_once, surface, moves);
criterion_main!(benches);
