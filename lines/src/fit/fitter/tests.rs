use nalgebra::{Point2, Point3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::depth::{EdgeDepthOptions, InverseDepthMap};

thread_local! {
    /// Number of pixels that were compared with lines.
    pub(super) static TESTED: std::cell::Cell<usize> = const { std::cell::Cell::new(0) };
}

const WIDTH: usize = 640;
const HEIGHT: usize = 480;

fn camera() -> Camera {
    Camera::pinhole(525.0, 525.0, 319.5, 239.5).unwrap()
}

/// An 8-connected chain along the image of 3D polylines, with the inverse depth of the point that each pixel shows.
struct Scene {
    chains: EdgeChains,
    map: InverseDepthMap,
}

impl Scene {
    fn new() -> Self {
        Self {
            chains: EdgeChains::new(WIDTH, HEIGHT),
            map: InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap(),
        }
    }

    /// Draws a chain through corners in the camera frame; `noise` gives the error of each inverse depth, `None` takes the
    /// depth away.
    fn draw(&mut self, corners: &[Point3<f64>], mut noise: impl FnMut(usize) -> Option<f64>) {
        let mut indices: Vec<u32> = Vec::new();
        let mut positions = Vec::new();
        for pair in corners.windows(2) {
            let [a, b] = [pair[0], pair[1]].map(|p| camera().project(&p).unwrap());
            let steps = (b - a).abs().max().ceil() as usize;
            for step in 0..=steps {
                let share = step as f64 / steps as f64;
                let pixel = a + (b - a) * share;
                let (x, y) = (pixel.x.round() as usize, pixel.y.round() as usize);
                let index = (y * WIDTH + x) as u32;
                if indices.last() == Some(&index) {
                    continue;
                }
                // Inverse depth is linear along the image.
                let rho = 1.0 / pair[0].z + (1.0 / pair[1].z - 1.0 / pair[0].z) * share;
                let measured = noise(indices.len())
                    .and_then(|error| InverseDepth::new((rho + error) as f32, 0.0015));
                self.map.set(x, y, measured);
                indices.push(index);
                positions.push([pixel.x as f32, pixel.y as f32]);
            }
        }
        self.chains.push_at(&indices, &positions);
    }

    fn fit(&self, options: FitOptions) -> Vec<Segment> {
        let mut depths = EdgeDepths::default();
        depths.compute(&self.map, &self.chains, &EdgeDepthOptions::raw());
        let image = GrayImage::new(WIDTH, HEIGHT, vec![0; WIDTH * HEIGHT]).unwrap();
        let input = FitInput {
            chains: &self.chains,
            depths: &depths,
            image: &image,
            camera: &camera(),
            keyframe: 7,
        };
        SegmentFitter::new(options).unwrap().fit(&input)
    }
}

fn all_options() -> [FitOptions; 2] {
    // Depth is only nearly linear.
    let depth = FitOptions {
        depth_model: DepthModel::Depth,
        ..FitOptions::default().for_independent_depths()
    };
    [FitOptions::default(), depth]
}

#[test]
fn exact_line_is_found_whole() {
    let (a, b) = (Point3::new(-0.6, -0.3, 1.9), Point3::new(0.7, 0.35, 2.2));
    for (index, options) in all_options().into_iter().enumerate() {
        let mut scene = Scene::new();
        scene.draw(&[a, b], |_| Some(0.0));
        let segments = scene.fit(options);
        assert_eq!(segments.len(), 1, "options {index}");
        let segment = &segments[0];
        assert_eq!(segment.keyframe, 7);
        assert_eq!(segment.pixels, 0..scene.chains.pixels().len() as u32);
        // Half a pixel at 2 units is 2 mm across; depth times focal length is only nearly linear.
        let tolerance = if index == 0 { 0.004 } else { 0.012 };
        assert!((segment.ends_in_camera[0] - a).norm() < tolerance);
        assert!((segment.ends_in_camera[1] - b).norm() < tolerance);
        assert!(f64::from(segment.inliers) > 0.9 * segment.pixels.len() as f64);
        for segment in &segments {
            for end in &segment.ends_in_camera {
                let offset = (end - a).cross(&(b - a).normalize()).norm();
                assert!(offset < 0.012, "options {index}: {offset}");
            }
        }
    }
}

#[test]
fn a_corner_splits_the_chain_without_loss() {
    let corners = [
        Point3::new(-0.5, 0.2, 2.0),
        Point3::new(0.2, 0.25, 2.0),
        Point3::new(0.3, -0.4, 2.1),
    ];
    let mut scene = Scene::new();
    scene.draw(&corners, |_| Some(0.0));
    let segments = scene.fit(FitOptions::default());
    assert_eq!(segments.len(), 2);
    let gap = segments[1].pixels.start - segments[0].pixels.end;
    assert!(gap <= 5, "{gap} pixels lost at the corner");
    assert!(segments[0].pixels.end <= segments[1].pixels.start);
    for (segment, pair) in segments.iter().zip(corners.windows(2)) {
        assert!((segment.ends_in_camera[0] - pair[0]).norm() < 0.02);
        assert!((segment.ends_in_camera[1] - pair[1]).norm() < 0.02);
    }
}

#[test]
fn a_jump_in_depth_splits_a_straight_edge() {
    // One image line over two surfaces, 1.5 and 2.5 units away.
    let mut scene = Scene::new();
    let (a, b) = (Point3::new(-0.6, 0.0, 2.0), Point3::new(0.6, 0.1, 2.0));
    scene.draw(&[a, b], |i| {
        Some(if i < 150 {
            1.0 / 1.5 - 0.5
        } else {
            1.0 / 2.5 - 0.5
        })
    });
    let segments = scene.fit(FitOptions::default());
    assert_eq!(segments.len(), 2);
    assert!(
        segments[0]
            .ends_in_camera
            .iter()
            .all(|end| (end.z - 1.5).abs() < 0.01)
    );
    assert!(
        segments[1]
            .ends_in_camera
            .iter()
            .all(|end| (end.z - 2.5).abs() < 0.01)
    );
    assert_eq!(segments[0].pixels.end, 150);
}

#[test]
fn a_small_step_in_depth_splits_a_straight_edge() {
    // Boards 2 and 2.02 units away: a step of three deviations of the sensor, and of three pixels of parallax.
    let (a, b) = (Point3::new(-0.6, 0.0, 2.0), Point3::new(0.6, 0.1, 2.0));
    let mut scene = Scene::new();
    scene.draw(&[a, b], |i| {
        Some(if i < 150 { 0.0 } else { 1.0 / 2.02 - 0.5 })
    });
    let segments = scene.fit(FitOptions::default());
    let depths: Vec<_> = segments
        .iter()
        .map(|segment| segment.ends_in_camera.map(|end| end.z))
        .collect();
    assert_eq!(depths.len(), 2, "{depths:?}");
    for (ends, depth) in depths.iter().zip([2.0, 2.02]) {
        assert!(
            ends.iter().all(|end| (end - depth).abs() < 0.001),
            "{depths:?}"
        );
    }
}

#[test]
fn short_gaps_are_bridged_and_long_ones_end_a_segment() {
    let (a, b) = (Point3::new(-0.6, 0.0, 2.0), Point3::new(0.6, 0.1, 2.0));
    let with_gap = |length: usize| {
        let mut scene = Scene::new();
        scene.draw(&[a, b], |i| {
            (!(100..100 + length).contains(&i)).then_some(0.0)
        });
        scene.fit(FitOptions::default())
    };
    assert_eq!(with_gap(9).len(), 1);
    let parted = with_gap(14);
    assert_eq!(parted.len(), 2);
    assert_eq!((parted[0].pixels.end, parted[1].pixels.start), (100, 114));
    let mut unknown = Scene::new();
    unknown.draw(&[a, b], |_| None);
    assert!(unknown.fit(FitOptions::default()).is_empty());
}

#[test]
fn a_bad_beginning_does_not_cost_the_chain() {
    let (a, b) = (Point3::new(-0.6, 0.0, 2.0), Point3::new(0.6, 0.1, 2.0));
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut scene = Scene::new();
    scene.draw(&[a, b], |i| {
        Some(if i < 23 {
            rng.random_range(0.0..0.4)
        } else {
            0.0
        })
    });
    let segments = scene.fit(FitOptions::default());
    assert_eq!(segments.len(), 1);
    assert!(segments[0].pixels.start <= 25);
}

#[test]
fn outliers_do_not_bend_the_line() {
    let (a, b) = (Point3::new(-0.6, -0.2, 1.8), Point3::new(0.6, 0.1, 2.1));
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let mut scene = Scene::new();
    scene.draw(&[a, b], |_| {
        Some(if rng.random_bool(0.15) {
            rng.random_range(-0.2..0.3)
        } else {
            0.0
        })
    });
    let segments = scene.fit(FitOptions::default());
    let longest = segments.iter().max_by_key(|s| s.inliers).unwrap();
    assert!(longest.inliers > 150);
    for end in &longest.ends_in_camera {
        assert!((end - a).cross(&(b - a).normalize()).norm() < 0.006);
    }
}

#[test]
fn covariance_covers_the_error() {
    // Normal noise of the stated sigma: the squared depth error of the ends, in units of their variance without the
    // correlation factor, averages 1.
    let (a, b) = (Point3::new(-0.4, -0.2, 1.8), Point3::new(0.5, 0.1, 2.2));
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let options = FitOptions {
        depth_correlation_px: 1.0,
        ..FitOptions::default().for_independent_depths()
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for _ in 0..150 {
        let mut scene = Scene::new();
        scene.draw(&[a, b], |_| {
            let deviate: f64 = (0..12).map(|_| rng.random_range(0.0..1.0)).sum::<f64>() - 6.0;
            Some(0.0015 * deviate)
        });
        for segment in scene.fit(options) {
            for end in 0..2 {
                // The true inverse depth at the fitted pixel.
                let [pa, pb] = [a, b].map(|p| camera().project(&p).unwrap());
                let share = (segment.ends_px[end] - pa).dot(&(pb - pa)) / (pb - pa).norm_squared();
                let truth = 1.0 / a.z + (1.0 / b.z - 1.0 / a.z) * share;
                let error = segment.inverse_depths[end] - truth;
                sum += (error / segment.inverse_depth_sigmas[end]).powi(2);
                count += 1.0;
            }
        }
    }
    let ratio = sum / count;
    assert!((0.7..1.6).contains(&ratio), "{ratio} over {count} ends");
}

#[test]
fn covariance_is_symmetric_and_positive() {
    let mut scene = Scene::new();
    scene.draw(
        &[Point3::new(-0.4, -0.2, 1.8), Point3::new(0.5, 0.1, 2.2)],
        |_| Some(0.0),
    );
    for options in all_options() {
        for segment in scene.fit(options) {
            for covariance in &segment.end_covariances {
                assert!((covariance - covariance.transpose()).norm() <= 1e-12 * covariance.norm());
                assert!(covariance.symmetric_eigenvalues().min() > 0.0);
            }
        }
    }
}

#[test]
fn segments_along_the_view_ray_are_not_trusted() {
    // A line that leads away from the camera, 40 degrees off the axis and 17 off the view ray of its far end.
    let (sin, cos) = 40.0_f64.to_radians().sin_cos();
    let direction = nalgebra::Vector3::new(sin, 0.0, cos);
    let a = Point3::new(0.0, 0.3, 1.0);
    let mut scene = Scene::new();
    scene.draw(&[a, a + direction * 1.5], |_| Some(0.0));
    let trusting = FitOptions {
        minimum_view_angle_rad: 0.0,
        ..FitOptions::default()
    };
    assert_eq!(scene.fit(trusting).len(), 1);
    assert_eq!(scene.fit(FitOptions::default()).len(), 1);
    let strict = FitOptions::default().for_independent_depths();
    assert!(scene.fit(strict).is_empty());
}

#[test]
fn scale_of_the_map_plays_no_part() {
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    let errors: Vec<f64> = (0..700).map(|_| rng.random_range(-0.003..0.003)).collect();
    let (a, b) = (Point3::new(-0.6, -0.2, 1.5), Point3::new(0.6, 0.1, 2.1));
    let mut scene = Scene::new();
    scene.draw(&[a, b], |i| Some(errors[i]));
    let mut large = Scene::new();
    large.chains = scene.chains.clone();
    for (x, y, sample) in scene.map.known() {
        // A power of two scales without rounding.
        large.map.set(
            x,
            y,
            InverseDepth::new(sample.rho / 1024.0, sample.sigma / 1024.0),
        );
    }
    for options in all_options() {
        let (small, large) = (scene.fit(options), large.fit(options));
        assert_eq!(small.len(), large.len());
        for (s, l) in small.iter().zip(&large) {
            assert_eq!((&s.pixels, s.inliers), (&l.pixels, l.inliers));
            for (p, q) in s.ends_in_camera.iter().zip(&l.ends_in_camera) {
                assert!((p * 1024.0 - q).norm() < 1e-6);
            }
        }
    }
}

#[test]
fn hostile_depths_give_finite_segments() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    for round in 0..200 {
        let mut scene = Scene::new();
        let mut corner = || {
            Point3::new(
                rng.random_range(-0.5..0.5),
                rng.random_range(-0.4..0.4),
                1.0,
            )
        };
        let corners = [corner(), corner(), corner()];
        if corners
            .windows(2)
            .any(|pair| (pair[0] - pair[1]).norm() < 1e-3)
        {
            continue;
        }
        scene.draw(&corners, |i| match (i * 7 + round) % 5 {
            0 => None,
            1 => Some(1e30),
            2 => Some(-1.0 + 1e-7),
            3 => Some(f64::from(f32::MIN_POSITIVE)),
            _ => Some(0.0),
        });
        for options in all_options() {
            for segment in scene.fit(options) {
                let is_finite = |v: f64| v.is_finite();
                assert!(
                    segment
                        .ends_in_camera
                        .iter()
                        .flat_map(|p| p.iter().copied())
                        .all(is_finite)
                );
                assert!(
                    segment
                        .end_covariances
                        .iter()
                        .flat_map(|c| c.iter().copied())
                        .all(is_finite)
                );
                assert!(segment.ends_in_camera.iter().all(|p| p.z > 0.0));
            }
        }
    }
}

#[test]
fn closed_and_tiny_chains_are_harmless() {
    let mut scene = Scene::new();
    let p = |x: f64, y: f64| camera().point_at_depth(&Point2::new(x, y), 2.0).unwrap();
    scene.draw(
        &[
            p(100.0, 100.0),
            p(140.0, 100.0),
            p(140.0, 140.0),
            p(100.0, 140.0),
            p(100.0, 101.0),
        ],
        |_| Some(0.0),
    );
    scene.chains.push(&[5]);
    scene.chains.push(&[]);
    assert_eq!(scene.fit(FitOptions::default()).len(), 4);
}

#[test]
fn a_good_beginning_is_kept_when_inliers_become_sparse() {
    let (a, b) = (Point3::new(-0.6, 0.1, 2.0), Point3::new(0.6, 0.12, 2.0));
    // The first 80 pixels have a depth, then one in eight.
    let mut scene = Scene::new();
    scene.draw(&[a, b], |pixel| {
        (pixel < 80 || pixel % 8 == 0).then_some(0.0)
    });
    let segments = scene.fit(FitOptions::default());
    assert_eq!(segments.len(), 1);
    let segment = &segments[0];
    assert_eq!(segment.pixels.start, 0);
    assert!(segment.pixels.end >= 80, "{:?}", segment.pixels);
    assert!(f64::from(segment.inliers) >= 0.5 * segment.pixels.len() as f64);
}

#[test]
fn a_stretch_behind_sparse_inliers_is_found() {
    let (a, b) = (Point3::new(-0.6, 0.1, 2.0), Point3::new(0.6, 0.12, 2.0));
    let mut scene = Scene::new();
    scene.draw(&[a, b], |pixel| {
        (pixel < 40 || pixel % 8 == 0 || pixel >= 250).then_some(0.0)
    });
    let segments = scene.fit(FitOptions::default());
    assert_eq!(segments.len(), 2);
    for (segment, range) in segments.iter().zip([0..40, 260..300]) {
        assert!(
            segment.pixels.start <= range.start && segment.pixels.end >= range.end,
            "{:?} against {range:?}",
            segment.pixels
        );
    }
}

#[test]
fn the_cost_of_sparse_depth_is_linear() {
    // Depth on 5 of 13 pixels: windows pass, and segments end short.
    let tested = |passes: usize| {
        let mut scene = Scene::new();
        let row = |index: usize| 0.01 * (index as f64 - 10.0);
        let corners: Vec<_> = (0..=passes)
            .map(|index| Point3::new(if index % 2 == 0 { -1.1 } else { 1.1 }, row(index / 2), 2.0))
            .collect();
        scene.draw(&corners, |index| (index % 13 < 5).then_some(0.0));
        TESTED.set(0);
        scene.fit(FitOptions::default());
        TESTED.get() as f64 / scene.chains.pixels().len() as f64
    };
    let (one, many) = (tested(1), tested(12));
    assert!(one < 300.0 && many < 300.0, "{one} {many} tests a pixel");
}
