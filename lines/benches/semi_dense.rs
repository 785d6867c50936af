//! Time of the semi-dense depth of one 640 x 480 keyframe from seven neighbours, on one and on two threads.
//!
//! With `LINECARVE_DATA` set to a folder that holds `seven-scenes` the input is one keyframe in the middle of it; otherwise a wall with
//! random tiles. Bar: 60 ms on two threads. For comparison, preparing one view (smoothing, edges, noise) is timed too.

#[allow(dead_code)]
#[path = "../tests/support/sequence.rs"]
mod sequence;

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, criterion_group, criterion_main};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::semi_dense::{
    MatchView, NeighbourOptions, SemiDense, SemiDenseOptions, ViewGeometry, choose_neighbours,
};
use linecarve_lines::edges::EdgeDetector;
use linecarve_lines::image::GrayImage;
use nalgebra::{Isometry3, Vector3};

pub(crate) type AnyError = Box<dyn std::error::Error>;

struct Input {
    image: GrayImage,
    reference: MatchView,
    neighbours: Vec<MatchView>,
}

fn real(folder: &Path) -> Result<Input, AnyError> {
    let sequence = sequence::Sequence::open(folder)?;
    let keyframes = sequence.keyframes(0.15, 10.0_f64.to_radians());
    let middle = keyframes.len() / 2;
    let mut detector = EdgeDetector::default();
    let mut views = Vec::new();
    for keyframe in &keyframes[middle - 8..=middle + 8] {
        let image = sequence.gray(keyframe)?;
        let pose = &keyframe.world_from_camera;
        views.push(MatchView::new(
            &image,
            &sequence.color_camera,
            pose,
            &mut detector,
        )?);
    }
    let image = sequence.gray(&keyframes[middle])?;
    let reference = views.remove(8);
    let geometries: Vec<ViewGeometry> = views.iter().map(MatchView::geometry).collect();
    let candidates: Vec<&ViewGeometry> = geometries.iter().collect();
    let options = NeighbourOptions::default();
    let chosen = choose_neighbours(&reference.geometry(), &candidates, 1.8, &options);
    let neighbours = chosen.iter().map(|&index| views[index].clone()).collect();
    Ok(Input {
        image,
        reference,
        neighbours,
    })
}

/// A wall at depth 2 with tiles of random grey.
fn procedural() -> Result<Input, AnyError> {
    let (width, height) = (640_usize, 480_usize);
    let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5)?;
    let level = |x: f64, y: f64| {
        let tile = |v: f64| (v / 0.07).floor() as i64;
        let (i, j) = (tile(x), tile(y + 0.2 * x));
        let hash = (i.wrapping_mul(7919) ^ j.wrapping_mul(104_729)).wrapping_mul(2_654_435_761);
        30 + ((hash >> 9) & 0x7f) as u8
    };
    let image = |x: f64, y: f64| -> Result<GrayImage, AnyError> {
        let samples = (0..width * height).map(|i| {
            let u = ((i % width) as f64 - 319.5) / 525.0 * 2.0 + x;
            let v = ((i / width) as f64 - 239.5) / 525.0 * 2.0 + y;
            level(u, v)
        });
        Ok(GrayImage::new(width, height, samples.collect())?)
    };
    let mut detector = EdgeDetector::default();
    let mut view = |x: f64, y: f64| -> Result<MatchView, AnyError> {
        let pose = Isometry3::translation(x, y, 0.0);
        Ok(MatchView::new(
            &image(x, y)?,
            &camera,
            &pose,
            &mut detector,
        )?)
    };
    let around = [
        (0.15, 0.0),
        (-0.15, 0.02),
        (0.3, 0.1),
        (-0.3, -0.1),
        (0.1, 0.2),
        (-0.1, -0.2),
        (0.45, 0.0),
    ];
    let neighbours = around
        .iter()
        .map(|&(x, y)| view(x, y))
        .collect::<Result<_, _>>()?;
    Ok(Input {
        image: image(0.0, 0.0)?,
        reference: view(0.0, 0.0)?,
        neighbours,
    })
}

fn semi_dense(criterion: &mut Criterion) {
    let input = match std::env::var("LINECARVE_DATA") {
        Ok(folder) => {
            real(&Path::new(&folder).join("seven-scenes")).expect("seven-scenes is readable")
        }
        Err(_) => procedural().expect("the procedural views are valid"),
    };
    let estimator = SemiDense::new(SemiDenseOptions::default()).expect("default options are valid");
    let neighbours: Vec<&MatchView> = input.neighbours.iter().collect();
    let mut group = criterion.benchmark_group("semi_dense");
    group.sample_size(20);
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .expect("threads can be started");
        group.bench_function(format!("estimate, {threads} thread(s)"), |bencher| {
            bencher.iter(|| {
                pool.install(|| estimator.estimate(black_box(&input.reference), &neighbours, None))
                    .expect("the image can be addressed")
            });
        });
    }
    let mut detector = EdgeDetector::default();
    let camera = input.reference.camera().clone();
    let pose = Isometry3::from_parts(Vector3::zeros().into(), Default::default());
    group.bench_function("view", |bencher| {
        bencher.iter(|| MatchView::new(black_box(&input.image), &camera, &pose, &mut detector));
    });
    group.finish();
}

criterion_group!(benches, semi_dense);
criterion_main!(benches);
