//! Cost of insertion and removal: points in a cube and on the surfaces of a furnished room.
//!
//! `cargo bench -p linecarve-carving --bench tetrahedralization`; a million points with `LINECARVE_LONG_BENCHES=1`.

use std::hint::black_box;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use linecarve_carving::{Changes, Tetrahedralization, VertexId};
use nalgebra::{Point3, Vector3};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

fn cube(count: usize) -> Vec<Point3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(count as u64);
    (0..count)
        .map(|_| Point3::new(rng.random(), rng.random(), rng.random()))
        .collect()
}

/// Points on the walls of a room and of three boxes in it, 1 mm of noise on each axis.
fn room(count: usize) -> Vec<Point3<f64>> {
    const BOXES_M: [([f64; 3], [f64; 3]); 4] = [
        ([0.0, 0.0, 0.0], [6.0, 4.0, 2.5]),
        ([1.0, 1.0, 0.0], [2.2, 1.8, 0.75]),
        ([4.0, 2.5, 0.0], [5.8, 3.8, 0.5]),
        ([0.2, 3.2, 0.0], [1.2, 3.7, 1.8]),
    ];
    const NOISE_M: f64 = 1e-3;
    let mut rng = ChaCha8Rng::seed_from_u64(count as u64 + 1);
    (0..count)
        .map(|i| {
            // Three quarters of the points go to the walls, which have most of the area.
            let (low, high) = BOXES_M[if i % 4 < 3 { 0 } else { 1 + i / 4 % 3 }];
            let mut p = Point3::from(std::array::from_fn(|axis| {
                rng.random_range(low[axis]..high[axis])
            }));
            let axis = rng.random_range(0..3);
            p[axis] = if rng.random() { low[axis] } else { high[axis] };
            // A sum of four uniform deviates is normal enough.
            let noise = Vector3::from_fn(|_, _| {
                (0..4).map(|_| rng.random_range(-0.866..0.866)).sum::<f64>()
            });
            p + noise * NOISE_M
        })
        .collect()
}

fn sizes() -> Vec<usize> {
    let long = std::env::var_os("LINECARVE_LONG_BENCHES").is_some_and(|value| value != "0");
    if long {
        vec![10_000, 100_000, 1_000_000]
    } else {
        vec![10_000, 100_000]
    }
}

type Scene = fn(usize) -> Vec<Point3<f64>>;

const SCENES: [(&str, Scene); 2] = [("cube", cube), ("room", room)];

fn insertion(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("insertion");
    group.sample_size(10);
    for (name, scene) in SCENES {
        for count in sizes() {
            let points = scene(count);
            group.throughput(Throughput::Elements(count as u64));
            group.bench_with_input(
                BenchmarkId::new(format!("bulk/{name}"), count),
                &points,
                |bencher, points| {
                    bencher.iter(|| {
                        Tetrahedralization::from_points(black_box(points))
                            .map(|(t, _)| t.finite_cell_count())
                    });
                },
            );
            // The last eleventh goes in one by one, as a growing map would have it.
            let (before, after) = points.split_at(count * 10 / 11);
            let (base, _) = Tetrahedralization::from_points(before).expect("points are in range");
            group.throughput(Throughput::Elements(after.len() as u64));
            group.bench_with_input(
                BenchmarkId::new(format!("reported/{name}"), count),
                &after,
                |bencher, after| {
                    let (mut outcomes, mut changes) = (vec![], Changes::new());
                    bencher.iter_batched_ref(
                        || base.clone(),
                        |t| {
                            let mut destroyed = 0;
                            t.insert_batch_with(
                                after,
                                &mut outcomes,
                                &mut changes,
                                |_, _, changes| {
                                    destroyed += changes.destroyed.len();
                                },
                            )
                            .map(|()| destroyed)
                        },
                        criterion::BatchSize::PerIteration,
                    );
                },
            );
        }
    }
    group.finish();
}

fn removal(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("removal");
    group.sample_size(10);
    for (name, scene) in SCENES {
        for count in sizes() {
            let (base, _) =
                Tetrahedralization::from_points(&scene(count)).expect("points are in range");
            let mut chosen: Vec<VertexId> = base.vertices().step_by(10).collect();
            chosen.shuffle(&mut ChaCha8Rng::seed_from_u64(1));
            group.throughput(Throughput::Elements(chosen.len() as u64));
            group.bench_function(BenchmarkId::new(name, count), |bencher| {
                let mut changes = Changes::new();
                bencher.iter_custom(|iterations| {
                    let mut spent = Duration::ZERO;
                    for _ in 0..iterations {
                        let mut t = base.clone();
                        let start = Instant::now();
                        for &vertex in &chosen {
                            t.remove(vertex, &mut changes)
                                .expect("each vertex is removed once");
                        }
                        spent += start.elapsed();
                    }
                    spent
                });
            });
        }
    }
    group.finish();
}

criterion_group!(benches, insertion, removal);
criterion_main!(benches);
