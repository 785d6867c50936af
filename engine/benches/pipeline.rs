//! Time of the two halves of the pipeline on the sample, one thread.
//!
//! `front end` turns one keyframe's images into segments: decoding, depth, edges, fit. `back end` joins all keyframes
//! of the sample to the map, one after another: clusters, landmarks, tetrahedra, rays, surface. Baseline: a camera's own
//! keyframe rate. A hand-held camera gives 3 to 5 keyframes a second at the default selection, 200 to 330 ms each.

use std::hint::black_box;
use std::path::Path;

use criterion::{BatchSize, Criterion, Throughput, criterion_group, criterion_main};
use linecarve_engine::Options;
use linecarve_engine::front_end::{Keyframe, SensorFrontEnd, median_scene_depth};
use linecarve_engine::map::Map;
use linecarve_lines::depth::{DepthSensor, SensorNoise};
use linecarve_sequence::{OpenOptions, Sequence};

fn pipeline(criterion: &mut Criterion) {
    let sample = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/room");
    let sequence = Sequence::open(&sample, &OpenOptions::default()).expect("the sample is whole");
    let frames: Vec<usize> = (0..sequence.frames().len()).collect();
    let median_depth = median_scene_depth(&sequence, &frames)
        .expect("depth images fit")
        .expect("the sample has depth");
    let options = Options::default();
    let scale = sequence
        .depth_calibration()
        .expect("the sample has depth")
        .scale;
    let noise = SensorNoise::relative_at(options.sensor.relative_noise, median_depth, 1.0 / scale);
    let sensor = DepthSensor::registered(sequence.color_camera(), noise);
    let mut front_end =
        SensorFrontEnd::new(sensor, options.extract(median_depth)).expect("default options hold");
    let keyframes: Vec<Keyframe> = frames
        .iter()
        .map(|frame| {
            let keyframe = front_end
                .process(&sequence, *frame, *frame as u32)
                .expect("the sample is whole");
            Keyframe::Lines(Box::new(keyframe))
        })
        .collect();

    let mut group = criterion.benchmark_group("pipeline");
    group.sample_size(10);
    group.throughput(Throughput::Elements(1));
    group.bench_function("front end, one keyframe", |bench| {
        bench.iter(|| black_box(front_end.process(&sequence, black_box(12), 0)));
    });
    group.throughput(Throughput::Elements(keyframes.len() as u64));
    group.bench_function("back end, all keyframes", |bench| {
        bench.iter_batched(
            || {
                Map::of_sensor(&options, sequence.color_camera(), noise, median_depth)
                    .expect("default options hold")
            },
            |mut map| {
                for keyframe in &keyframes {
                    black_box(map.push(keyframe)).expect("the sample's poses are in range");
                }
                map
            },
            BatchSize::PerIteration,
        );
    });
    group.finish();
}

criterion_group!(benches, pipeline);
criterion_main!(benches);
