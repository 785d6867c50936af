//! Cost of a keyframe on a map of 50,000 points, by kind of labels, early and late in a run.
//!
//! `cargo bench -p linecarve-carving --bench cut`. A camera walks down a corridor and never looks back, so that the map grows
//! while the neighbourhood of a keyframe stays the same: what it costs should too. With `RAYON_NUM_THREADS=1` the time is that of
//! one thread. On Linux it is processor time, so that other work on the machine does not count.

#![allow(clippy::disallowed_methods)] // A made-up scene may differ between platforms.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use linecarve_carving::{Carver, CarverOptions, CutOptions, Labels, PointId, Votes};
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

#[allow(dead_code)] // Rooms of the other benches and tests.
#[path = "../tests/all/helpers/rooms.rs"]
mod rooms;

/// With [`NEW_POINTS`] of each, 50,000 points.
const KEYFRAMES: usize = 500;
const NEW_POINTS: usize = 100;
/// Each point is seen by so many keyframes: the rays of one are 20 times its new points.
const SEEN_BY: usize = 20;
const STEP_M: f64 = 0.15;
const RADIUS_M: f64 = 1.2;
/// Standard deviation of a point along its first ray, as a share of the distance.
const NOISE: f64 = 0.004;
/// Share of the points at 0.3 to 1.7 times their distance.
const WRONG: f64 = 0.01;

/// What a keyframe brings.
struct Keyframe {
    center: Point3<f64>,
    /// Positions and standard deviations.
    new_points: Vec<(Point3<f64>, f64)>,
}

fn corridor() -> Vec<Keyframe> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..KEYFRAMES)
        .map(|i| {
            let x = i as f64 * STEP_M;
            let center = Point3::new(x, 0.1 * (0.3 * x).sin(), 0.05);
            let new_points = (0..NEW_POINTS)
                .map(|_| {
                    let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
                    let ahead = rng.random_range(3.2..5.0);
                    let wall =
                        Point3::new(x + ahead, RADIUS_M * angle.cos(), RADIUS_M * angle.sin());
                    let to = wall - center;
                    let share = if rng.random_bool(WRONG) {
                        rng.random_range(0.3..1.7)
                    } else {
                        1.0 + NOISE * rooms::noise(&mut rng)
                    };
                    (center + share * to, NOISE * to.norm())
                })
                .collect();
            Keyframe { center, new_points }
        })
        .collect()
}

fn add(carver: &mut Carver, keyframe: &Keyframe, ids: &mut Vec<PointId>) {
    let mut transaction = carver.transaction();
    let view = transaction.add_view(keyframe.center).expect("in range");
    for &(point, sigma) in &keyframe.new_points {
        let id = transaction.add_point(point).expect("in range");
        transaction.set_sigma(id, Some(sigma)).expect("positive");
        ids.push(id);
    }
    for &point in &ids[ids.len().saturating_sub(SEEN_BY * NEW_POINTS)..] {
        transaction
            .add_observation(view, point, 1)
            .expect("the point is known");
    }
    black_box(transaction.commit().expect("no ray is of zero length"));
}

/// Time that this process has been on a processor; `None` where the system does not report it.
fn processor_time() -> Option<Duration> {
    /// Of the kernel's interface, whatever the clock of the machine.
    const TICKS_A_SECOND: f64 = 100.0;
    let text = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The second field, a name in brackets, may hold spaces.
    let mut fields = text.rsplit_once(')')?.1.split_whitespace().skip(11);
    let mut ticks = || fields.next()?.parse::<f64>().ok();
    Some(Duration::from_secs_f64(
        (ticks()? + ticks()?) / TICKS_A_SECOND,
    ))
}

/// The keyframes of the second tenth and of the last; throughput counts keyframes.
fn keyframes(criterion: &mut Criterion) {
    let keyframes = corridor();
    let mut group = criterion.benchmark_group("keyframe");
    group.sample_size(10).warm_up_time(Duration::from_millis(1));
    let kinds = [
        ("votes", Labels::Votes(Votes::default())),
        ("cut", Labels::Cut(CutOptions::default())),
    ];
    let length = KEYFRAMES / 10;
    group.throughput(Throughput::Elements(length as u64));
    for (kind, labels) in kinds {
        for (name, first) in [("second tenth", length), ("last tenth", KEYFRAMES - length)] {
            let mut before = Carver::new(CarverOptions::with_labels(labels));
            let mut ids = vec![];
            for keyframe in &keyframes[..first] {
                add(&mut before, keyframe, &mut ids);
            }
            group.bench_function(BenchmarkId::new(kind, name), |bencher| {
                bencher.iter_custom(|iterations| {
                    let mut total = Duration::ZERO;
                    for _ in 0..iterations {
                        let (mut carver, mut ids) = (before.clone(), ids.clone());
                        let (start, wall) = (processor_time(), Instant::now());
                        for keyframe in &keyframes[first..][..length] {
                            add(&mut carver, keyframe, &mut ids);
                        }
                        let spent = processor_time().zip(start);
                        total += spent.map_or(wall.elapsed(), |(end, start)| end - start);
                    }
                    total
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, keyframes);
criterion_main!(benches);
