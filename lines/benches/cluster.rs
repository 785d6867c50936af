//! Time to cluster segments, and how it grows with their number.
//!
//! Two scenes, both of noisy measurements of random edges, every edge measured about ten times:
//! - `walk`: a map that grows as the camera goes on, its density constant. The cost of a segment is that of finding its
//!   neighbours among ever more clusters.
//! - `room`: one room of a given number of edges that is looked at again and again. The number of clusters is constant.
//!
//! Before the benchmark proper the exponent of growth is measured and printed: the slope of log(time) over log(number) between
//! 12 500 and 100 000 segments, where 1 is linear, and n log n shows as about 1.09. The paper's clustering compares each
//! segment with every cluster, which in `walk` has the exponent 2; that is the baseline, and is run too, up to 25 000 segments.

use std::hint::black_box;
use std::time::Instant;

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use linecarve_lines::cluster::{ClusterOptions, SegmentClusterer};
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

type Ends = [Point3<f64>; 2];

/// Measurements of each edge.
const VIEWS: usize = 10;
/// Edges in a cube of 4 units a side, at a median depth of 2.
const EDGES_A_ROOM: usize = 2000;

/// Random vector with each part in -1 to 1.
fn random(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0))
}

/// A random edge in the room number `room` of a row of rooms.
fn edge(rng: &mut ChaCha8Rng, room: usize) -> Ends {
    let center = random(rng) * 2.0 + Vector3::x() * (4.0 * room as f64);
    // Man-made: half of all edges follow an axis.
    let direction = if rng.random_bool(0.5) {
        Vector3::ith(rng.random_range(0..3), 1.0)
    } else {
        random(rng).normalize()
    };
    let half = rng.random_range(0.05..0.5);
    [center - direction * half, center + direction * half].map(Point3::from)
}

/// A part of an edge, as one keyframe measures it.
fn measure(rng: &mut ChaCha8Rng, edge: &Ends) -> Ends {
    let from: f64 = rng.random_range(0.0..0.4);
    let to: f64 = rng.random_range(0.6..1.0);
    let along = edge[1] - edge[0];
    [from, to].map(|share| edge[0] + along * share + random(rng) * 0.003)
}

fn walk(count: usize) -> Vec<Ends> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut segments = Vec::with_capacity(count);
    for room in 0.. {
        let edges: Vec<Ends> = (0..EDGES_A_ROOM).map(|_| edge(&mut rng, room)).collect();
        for _ in 0..VIEWS {
            for edge in &edges {
                if segments.len() == count {
                    return segments;
                }
                segments.push(measure(&mut rng, edge));
            }
        }
    }
    segments
}

fn room(count: usize) -> Vec<Ends> {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let edges: Vec<Ends> = (0..EDGES_A_ROOM).map(|_| edge(&mut rng, 0)).collect();
    let again = edges.iter().cycle();
    again
        .take(count)
        .map(|edge| measure(&mut rng, edge))
        .collect()
}

fn cluster(segments: &[Ends]) -> usize {
    let mut clusterer =
        SegmentClusterer::new(ClusterOptions::default(), 2.0).expect("the options are valid");
    let mut events = Vec::new();
    for &ends in segments {
        events.clear();
        clusterer.insert(ends, &mut events);
    }
    clusterer.cluster_count()
}

/// Every cluster is looked at for every segment, the first that fits is taken: the paper's way, without its SVD a segment.
fn cluster_by_scan(segments: &[Ends]) -> usize {
    let options = ClusterOptions::default();
    let (least_cosine, limit) = (
        options.maximum_angle_rad.cos(),
        options.distance_share * 2.0,
    );
    let mut clusters: Vec<(Ends, Vector3<f64>, f64)> = Vec::new();
    for ends in segments {
        let along = ends[1] - ends[0];
        let (length, direction) = (along.norm(), along.normalize());
        let fits = |(own, towards, own_length): &(Ends, Vector3<f64>, f64)| {
            direction.dot(towards).abs() >= least_cosine
                && ends
                    .iter()
                    .any(|end| (end - own[0]).norm() + (end - own[1]).norm() - own_length <= limit)
        };
        if !clusters.iter().any(fits) {
            clusters.push((*ends, direction, length));
        }
    }
    clusters.len()
}

/// Seconds of the fastest of three runs.
fn seconds(run: impl Fn() -> usize) -> f64 {
    (0..3)
        .map(|_| {
            let start = Instant::now();
            black_box(run());
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

/// The slope of log(time) over log(number), by least squares.
fn exponent(counts: &[usize], run: impl Fn(usize) -> f64) -> f64 {
    let points: Vec<(f64, f64)> = counts
        .iter()
        .map(|&count| ((count as f64).ln(), run(count).ln()))
        .collect();
    let n = points.len() as f64;
    let mean_x = points.iter().map(|p| p.0).sum::<f64>() / n;
    let mean_y = points.iter().map(|p| p.1).sum::<f64>() / n;
    let covariance: f64 = points.iter().map(|p| (p.0 - mean_x) * (p.1 - mean_y)).sum();
    let variance: f64 = points.iter().map(|p| (p.0 - mean_x).powi(2)).sum();
    covariance / variance
}

fn growth(criterion: &mut Criterion) {
    let counts = [12_500, 25_000, 50_000, 100_000];
    for (name, scene) in [("walk", walk as fn(usize) -> Vec<Ends>), ("room", room)] {
        let slope = exponent(&counts, |count| {
            let segments = scene(count);
            seconds(|| cluster(&segments))
        });
        eprintln!("{name}: exponent of growth {slope:.3} from 12 500 to 100 000 segments");
    }
    let slope = exponent(&counts[..2], |count| {
        let segments = walk(count);
        seconds(|| cluster_by_scan(&segments))
    });
    eprintln!("walk, scanning all clusters: exponent of growth {slope:.3} up to 25 000 segments");

    let mut group = criterion.benchmark_group("cluster");
    group.sample_size(10);
    for count in [10_000, 100_000] {
        group.throughput(Throughput::Elements(count as u64));
        for (name, segments) in [("walk", walk(count)), ("room", room(count))] {
            group.bench_with_input(
                BenchmarkId::new(name, count),
                &segments,
                |bencher, segments| {
                    bencher.iter(|| cluster(black_box(segments)));
                },
            );
        }
    }
    group.throughput(Throughput::Elements(10_000));
    let segments = walk(10_000);
    group.bench_with_input(
        BenchmarkId::new("walk_by_scan", 10_000),
        &segments,
        |bencher, segments| bencher.iter(|| cluster_by_scan(black_box(segments))),
    );
    group.finish();
}

criterion_group!(benches, growth);
criterion_main!(benches);
