//! Time per keyframe of each stage, single thread, 640 x 480.
//!
//! With `LINECARVE_DATA` set to a folder that holds `seven-scenes` the input is eight real keyframes of it, one iteration
//! being all eight (throughput is per keyframe); otherwise one procedural image.
//!
//! Basis of comparison: OpenCV 5.0's EdgeDrawing (Sobel, thresholds 36 and 8, smoothing included) takes 3.7 to 4.3 ms for
//! such an image on the machine where the bars were set; the paper's fit took 7.4 ms a keyframe on an i7-6700K. Bars: edges
//! 4 ms (ratio 1.0), fit 2.5 ms. Run OpenCV in turns with this bench on the same machine and quote the ratio: absolute
//! times vary.

#[allow(dead_code)]
#[path = "../tests/support/sequence.rs"]
mod sequence;

use std::hint::black_box;
use std::path::Path;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{
    DepthSensor, EdgeDepthOptions, EdgeDepths, InverseDepthMap, SensorNoise,
};
use linecarve_lines::edges::{EdgeChains, EdgeDetector, EdgeOptions};
use linecarve_lines::fit::{FitInput, FitOptions, SegmentFitter};
use linecarve_lines::image::{GrayImage, Plane};
use linecarve_lines::paper::{PaperFitter, PaperInput, PaperOptions};
use nalgebra::Isometry3;

pub(crate) type AnyError = Box<dyn std::error::Error>;

struct Keyframe {
    image: GrayImage,
    depth: Plane<f32>,
    map: InverseDepthMap,
}

struct Input {
    keyframes: Vec<Keyframe>,
    camera: Camera,
    sensor: DepthSensor,
}

fn input() -> Input {
    match std::env::var("LINECARVE_DATA") {
        Ok(folder) => {
            real(&Path::new(&folder).join("seven-scenes")).expect("seven-scenes is readable")
        }
        Err(_) => procedural().expect("the procedural keyframe is valid"),
    }
}

fn real(folder: &Path) -> Result<Input, AnyError> {
    let sequence = sequence::Sequence::open(folder)?;
    let sensor = DepthSensor {
        camera: sequence.depth_camera.clone(),
        color_from_depth: sequence.color_from_depth,
        is_registered: sequence.is_registered,
        noise: SensorNoise::relative_at(SensorNoise::STRUCTURED_LIGHT_RELATIVE, 2.0, 0.001),
    };
    let views = sequence.keyframes(0.15, 10.0_f64.to_radians());
    let mut keyframes = Vec::new();
    for view in views.iter().step_by(6).take(8) {
        let image = sequence.gray(view)?;
        let depth = sequence.depth(view)?;
        let map = sensor.inverse_depth(
            &depth,
            &sequence.color_camera,
            image.width(),
            image.height(),
        )?;
        keyframes.push(Keyframe { image, depth, map });
    }
    Ok(Input {
        keyframes,
        camera: sequence.color_camera,
        sensor,
    })
}

/// Slanted bars of texture on a floor and a box in front of it.
fn procedural() -> Result<Input, AnyError> {
    let (width, height) = (640, 480);
    let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5)?;
    let is_box = |x: usize, y: usize| (200..420).contains(&x) && (150..330).contains(&y);
    let mut pixels = Vec::new();
    let mut depths = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let (u, v) = (x as f64, y as f64);
            let stripes = ((u + 0.6 * v) / 9.0).sin() * 40.0 + ((v - 0.2 * u) / 23.0).cos() * 50.0;
            pixels.push(if is_box(x, y) {
                230.0 - 0.2 * u
            } else {
                110.0 + stripes
            } as u8);
            depths.push(if is_box(x, y) {
                1.2
            } else {
                1.0 / (0.3 + 0.0005 * v)
            } as f32);
        }
    }
    let sensor = DepthSensor {
        camera: Camera::pinhole(585.0, 585.0, 319.5, 239.5)?,
        color_from_depth: Isometry3::translation(-0.03, 0.007, 0.0),
        is_registered: false,
        noise: SensorNoise::relative_at(SensorNoise::STRUCTURED_LIGHT_RELATIVE, 2.0, 0.001),
    };
    let image = GrayImage::new(width, height, pixels)?;
    let depth = Plane::new(width, height, depths)?;
    let map = sensor.inverse_depth(&depth, &camera, width, height)?;
    Ok(Input {
        keyframes: vec![Keyframe { image, depth, map }],
        camera,
        sensor,
    })
}

fn stages(criterion: &mut Criterion) {
    let Input {
        keyframes,
        camera,
        sensor,
    } = input();
    let mut group = criterion.benchmark_group("keyframe");
    group.throughput(Throughput::Elements(keyframes.len() as u64));
    group.sample_size(30);

    let mut detector =
        EdgeDetector::new(EdgeOptions::default()).expect("default options are valid");
    let mut chains = EdgeChains::default();
    group.bench_function("edges", |bencher| {
        bencher.iter(|| {
            for keyframe in &keyframes {
                detector.detect_into(black_box(&keyframe.image), None, &mut chains);
            }
        });
    });

    let edges: Vec<EdgeChains> = keyframes
        .iter()
        .map(|k| detector.detect(&k.image))
        .collect();
    let mut depths = EdgeDepths::default();
    group.bench_function("edge_depth", |bencher| {
        bencher.iter(|| {
            for (keyframe, chains) in keyframes.iter().zip(&edges) {
                depths.compute(
                    black_box(&keyframe.map),
                    chains,
                    &EdgeDepthOptions::default(),
                );
            }
        });
    });

    let all_depths: Vec<EdgeDepths> = keyframes
        .iter()
        .zip(&edges)
        .map(|(keyframe, chains)| {
            let mut depths = EdgeDepths::default();
            depths.compute(&keyframe.map, chains, &EdgeDepthOptions::default());
            depths
        })
        .collect();
    let fitter = SegmentFitter::new(FitOptions::default()).expect("the options are valid");
    let mut segments = Vec::new();
    group.bench_function("fit", |bencher| {
        bencher.iter(|| {
            for ((keyframe, chains), depths) in keyframes.iter().zip(&edges).zip(&all_depths) {
                segments.clear();
                let input = FitInput {
                    chains,
                    depths,
                    image: &keyframe.image,
                    camera: &camera,
                    keyframe: 0,
                };
                fitter.fit_into(black_box(&input), &mut segments);
            }
        });
    });
    let fitter = PaperFitter::new(PaperOptions::with_unit(1.0)).expect("the options are valid");
    group.bench_function("fit_paper", |bencher| {
        bencher.iter(|| {
            for (keyframe, chains) in keyframes.iter().zip(&edges) {
                let input = PaperInput {
                    chains,
                    depth: &keyframe.map,
                    image: &keyframe.image,
                    camera: &camera,
                    keyframe: 0,
                };
                black_box(fitter.fit(black_box(&input)));
            }
        });
    });

    group.bench_function("sensor_registration", |bencher| {
        bencher.iter(|| {
            for keyframe in &keyframes {
                let image = &keyframe.image;
                let map =
                    sensor.inverse_depth(&keyframe.depth, &camera, image.width(), image.height());
                black_box(map).expect("the sensor is valid");
            }
        });
    });
    group.finish();
}

criterion_group!(benches, stages);
criterion_main!(benches);
