use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{DepthCorrection, InverseDepth, InverseDepthMap};
use nalgebra::{Isometry3, Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;

const SIDE: [usize; 2] = [160, 120];
const SIGMA: f64 = 1e-3;

fn camera() -> Camera {
    Camera::pinhole(130.0, 130.0, 79.5, 59.5).unwrap()
}

/// A room of planes `n . x = d`, seen from inside, and a box in it.
fn planes() -> Vec<(Vector3<f64>, f64)> {
    let normals = [
        Vector3::x(),
        -Vector3::x(),
        Vector3::y(),
        -Vector3::y(),
        Vector3::z(),
        -Vector3::z(),
        Vector3::new(0.6, 0.0, 0.8),
        Vector3::new(-0.48, 0.6, 0.64),
    ];
    let distances = [2.2, 2.0, 1.3, 1.5, 2.6, 2.4, 2.5, 2.4];
    normals.into_iter().zip(distances).collect()
}

/// Depth of the room from a pose; `disturbed` changes a depth at a pixel.
fn map(
    pose: &Isometry3<f64>,
    random: &mut ChaCha8Rng,
    disturbed: impl Fn(f64, [f64; 2]) -> f64,
) -> InverseDepthMap {
    let [width, height] = SIDE;
    let mut map = InverseDepthMap::unknown(width, height).unwrap();
    let center = pose.translation.vector;
    for at in 0..width * height {
        let [x, y] = [(at % width) as f64, (at / width) as f64];
        let ray = pose.rotation * Vector3::new((x - 79.5) / 130.0, (y - 59.5) / 130.0, 1.0);
        let rho = planes()
            .iter()
            .map(|(normal, offset)| normal.dot(&ray) / (offset - normal.dot(&center)))
            .fold(0.0, f64::max);
        let noisy = 1.0 / disturbed(1.0 / rho, [x, y]) + SIGMA * (random.random::<f64>() - 0.5);
        map.set(
            at % width,
            at / width,
            InverseDepth::new(noisy as f32, SIGMA as f32),
        );
    }
    map
}

/// A walk to and fro before a corner of the room.
fn poses(count: usize) -> Vec<Isometry3<f64>> {
    (0..count)
        .map(|i| {
            let t = i as f64 * 0.55;
            let eye = Vector3::new(0.9 * t.sin(), 0.3 * (1.7 * t).sin(), 0.6 * (0.6 * t).cos());
            let turn = Vector3::new(
                0.3 * (1.3 * t).sin(),
                0.6 * (0.8 * t).sin() + 0.3,
                0.1 * t.cos(),
            );
            Isometry3::new(eye, turn)
        })
        .collect()
}

fn spread(random: &mut ChaCha8Rng, size: f64) -> f64 {
    size * (2.0 * random.random::<f64>() - 1.0)
}

fn small_vector(random: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::new(
        spread(random, size),
        spread(random, size),
        spread(random, size),
    )
}

struct Errors {
    translation: f64,
    rotation: f64,
    scale: f64,
    shift: f64,
    /// Share by which waves of the depth are off, the same in all images, as sensors have them.
    bias: f64,
}

/// Layers with errors, the true poses and depth corrections.
fn disturbed(errors: &Errors) -> (Vec<DepthLayer>, Vec<Isometry3<f64>>, Vec<DepthCorrection>) {
    let mut random = ChaCha8Rng::seed_from_u64(3);
    let truth = poses(24);
    let mut layers = Vec::new();
    let mut corrections = Vec::new();
    for pose in &truth {
        let scale = 1.0 + spread(&mut random, errors.scale);
        let shift = spread(&mut random, errors.shift);
        let map = map(pose, &mut random, |z, [x, y]| {
            let bias = errors.bias * (x / 9.0).sin() * (y / 8.0).sin();
            (scale + bias) * z + shift
        });
        let motion = Isometry3::new(
            small_vector(&mut random, errors.translation),
            small_vector(&mut random, errors.rotation),
        );
        layers.push(DepthLayer::new(&map, &camera(), &(pose * motion)));
        corrections.push(DepthCorrection {
            scale: 1.0 / scale,
            inverse_shift: 0.0,
            shift: -shift / scale,
        });
    }
    (layers, truth, corrections)
}

/// RMS of the distances of four points of each layer from where they are in truth.
fn error(
    placements: &[LayerPlacement],
    truth: &[Isometry3<f64>],
    corrections: &[DepthCorrection],
) -> f64 {
    let mut sum = 0.0;
    for ((placement, truth), correction) in placements.iter().zip(truth).zip(corrections) {
        for (x, y, z) in [
            (0.3, 0.2, 1.5),
            (-0.4, 0.1, 2.0),
            (0.1, -0.3, 2.5),
            (0.0, 0.0, 1.8),
        ] {
            let at = |z: f64| Point3::new(x * z, y * z, z);
            let there = placement.world_from_camera * at(placement.depth.depth(z).unwrap());
            sum += (there - truth * at(correction.depth(z).unwrap())).norm_squared();
        }
    }
    (sum / (4 * placements.len()) as f64).sqrt()
}

fn check(errors: &Errors, best: f64) {
    let (layers, truth, corrections) = disturbed(errors);
    let given: Vec<LayerPlacement> = layers
        .iter()
        .map(|layer| LayerPlacement::given(*layer.given()))
        .collect();
    let alignment = align_layers(&layers);
    let before = error(&given, &truth, &corrections);
    let after = error(&alignment.placements, &truth, &corrections);
    assert!(alignment.model.is_some() && alignment.after < 0.5 * alignment.before);
    assert!(after < best * before, "{before} -> {after}");
}

#[test]
fn layers_that_agree_stay_as_they_are() {
    let (layers, truth, _) = disturbed(&Errors {
        translation: 0.0,
        rotation: 0.0,
        scale: 0.0,
        shift: 0.0,
        bias: 0.0,
    });
    let alignment = align_layers(&layers);
    assert_eq!(alignment.model, None);
    assert!(alignment.held_back > 10 && alignment.overlaps.len() > 3 * alignment.held_back);
    for (placement, truth) in alignment.placements.iter().zip(&truth) {
        assert_eq!(*placement, LayerPlacement::given(*truth));
    }
}

#[test]
fn poses_that_are_off_are_corrected() {
    check(
        &Errors {
            translation: 0.03,
            rotation: 0.02,
            scale: 0.0,
            shift: 0.0,
            bias: 0.0,
        },
        0.4,
    );
}

#[test]
fn scales_that_are_off_are_corrected() {
    check(
        &Errors {
            translation: 0.0,
            rotation: 0.0,
            scale: 0.1,
            shift: 0.0,
            bias: 0.0,
        },
        0.2,
    );
}

#[test]
fn all_errors_together_are_corrected() {
    check(
        &Errors {
            translation: 0.02,
            rotation: 0.015,
            scale: 0.1,
            shift: 0.05,
            bias: 0.0,
        },
        0.3,
    );
}

/// The error of the poses is halved under a small bias. Where bias is all that is left, poses are taken as given: they are never made worse.
#[test]
fn bias_of_the_depth_does_not_bend_the_path() {
    for (bias, most) in [
        (0.0025, 0.5),
        (0.005, 0.6),
        (0.01, 0.9),
        (0.02, 1.0),
        (0.04, 1.0),
    ] {
        let (layers, truth, corrections) = disturbed(&Errors {
            translation: 0.03,
            rotation: 0.02,
            scale: 0.0,
            shift: 0.0,
            bias,
        });
        let given: Vec<LayerPlacement> = layers
            .iter()
            .map(|layer| LayerPlacement::given(*layer.given()))
            .collect();
        let before = error(&given, &truth, &corrections);
        let alignment = align_layers(&layers);
        let after = error(&alignment.placements, &truth, &corrections);
        assert!(after <= most * before, "{bias}: {before} -> {after}");
    }
}

/// A scale and shift of all depth images change overlaps as small motions of the cameras do, which bend the room by as much.
#[test]
fn an_error_of_all_depth_images_is_not_taken_for_motion() {
    let measured = |depth: f64| 0.9 * depth + 0.3;
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let poses = poses(16);
    let layers: Vec<DepthLayer> = poses
        .iter()
        .map(|pose| {
            let map = map(pose, &mut random, |depth, _| measured(depth));
            DepthLayer::new(&map, &camera(), pose)
        })
        .collect();
    let alignment = align_layers(&layers);
    for (placement, pose) in alignment.placements.iter().zip(&poses) {
        let motion = placement.world_from_camera.translation.vector - pose.translation.vector;
        assert!(motion.norm() < 0.03, "{motion}");
        for depth in [1.5, 2.0, 2.5] {
            let corrected = placement.depth.depth(measured(depth)).unwrap();
            assert!(
                (corrected / depth - 1.0).abs() < 0.03,
                "{depth}: {corrected}"
            );
        }
    }
}

#[test]
fn nothing_is_made_of_nothing() {
    let alignment = align_layers(&[]);
    assert_eq!((alignment.model, alignment.overlaps.len()), (None, 0));
    let unknown = InverseDepthMap::unknown(160, 120).unwrap();
    let layer = DepthLayer::new(&unknown, &camera(), &Isometry3::identity());
    let alignment = align_layers(&[layer.clone(), layer]);
    assert_eq!((alignment.model, alignment.overlaps.len()), (None, 0));
}
