//! A slanted wall with random tiles, rendered analytically, seen by cameras with known poses.

use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::camera::Camera;
use crate::edges::EdgeDetector;
use crate::image::GrayImage;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;

fn camera() -> Camera {
    Camera::pinhole(260.0, 260.0, 159.5, 119.5).unwrap()
}

/// The wall `z = 2 + 0.3 x` in units of `scale`.
struct Wall {
    scale: f64,
}

impl Wall {
    /// Depth z along a pixel's ray in the camera, and the point.
    fn hit(&self, pose: &Isometry3<f64>, pixel: &Point2<f64>) -> Option<(f64, Point3<f64>)> {
        let ray = camera().unproject(pixel).unwrap();
        let ray = pose * (ray / ray.z);
        let origin = pose.translation.vector;
        let normal = Vector3::new(-0.3, 0.0, 1.0);
        let depth = (2.0 * self.scale - normal.dot(&origin)) / normal.dot(&ray);
        (depth > 0.0).then(|| (depth, Point3::from(origin + depth * ray)))
    }

    fn level(&self, point: &Point3<f64>) -> f64 {
        let tile = |v: f64, size: f64| (v / self.scale / size).floor() as i64;
        let (i, j) = (tile(point.x, 0.17), tile(point.y + 0.3 * point.x, 0.13));
        let hash = (i.wrapping_mul(7919) ^ j.wrapping_mul(104_729)).wrapping_mul(2_654_435_761);
        30.0 + ((hash >> 9) & 0xff) as f64 * 0.7
    }

    fn render(&self, pose: &Isometry3<f64>, gain: f64, offset: f64, noise: f64) -> GrayImage {
        let mut rng = ChaCha8Rng::seed_from_u64(7 + (1e3 * pose.translation.x.abs()) as u64);
        let mut samples = Vec::with_capacity(WIDTH * HEIGHT);
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let mut sum = 0.0;
                for sub in 0..16 {
                    let shift = |k: usize| (k as f64 + 0.5) / 4.0 - 0.5;
                    let pixel = Point2::new(x as f64 + shift(sub % 4), y as f64 + shift(sub / 4));
                    sum += self.hit(pose, &pixel).map_or(0.0, |(_, p)| self.level(&p));
                }
                let deviate = (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0;
                let level = gain * sum / 16.0 + offset + noise * deviate;
                samples.push(level.round().clamp(0.0, 255.0) as u8);
            }
        }
        GrayImage::new(WIDTH, HEIGHT, samples).unwrap()
    }

    fn view(&self, x: f64, y: f64, turn: f64) -> MatchView {
        self.exposed(x, y, turn, 1.0, 0.0)
    }

    fn pose(&self, x: f64, y: f64, turn: f64) -> Isometry3<f64> {
        Isometry3::from_parts(
            (Vector3::new(x, y, 0.02 * x) * self.scale).into(),
            UnitQuaternion::from_scaled_axis(Vector3::new(0.3 * turn, turn, 0.5 * turn)),
        )
    }

    fn exposed(&self, x: f64, y: f64, turn: f64, gain: f64, offset: f64) -> MatchView {
        let pose = self.pose(x, y, turn);
        prepared(&self.render(&pose, gain, offset, 1.0), &pose)
    }
}

fn prepared(image: &GrayImage, pose: &Isometry3<f64>) -> MatchView {
    MatchView::new(image, &camera(), pose, &mut EdgeDetector::default()).unwrap()
}

fn estimate(reference: &MatchView, neighbours: &[MatchView]) -> SemiDenseDepth {
    let views: Vec<&MatchView> = neighbours.iter().collect();
    let estimator = SemiDense::new(SemiDenseOptions::default()).unwrap();
    estimator.estimate(reference, &views, None).unwrap()
}

/// Share of edge pixels with depth, median relative error, share within two standard deviations.
fn figures(wall: &Wall, reference: &MatchView, depth: &SemiDenseDepth) -> (f64, f64, f64) {
    let chains = reference.chains();
    let mut errors = Vec::new();
    let mut within = 0;
    for (&[x, y], p) in chains.pixels().iter().zip(chains.positions()) {
        let Some(found) = depth.map.get(usize::from(x), usize::from(y)) else {
            continue;
        };
        let pixel = Point2::new(f64::from(p[0]), f64::from(p[1]));
        let (z, _) = wall.hit(reference.world_from_camera(), &pixel).unwrap();
        errors.push((found.depth() / z - 1.0).abs());
        within +=
            usize::from((f64::from(found.rho) - 1.0 / z).abs() <= 2.0 * f64::from(found.sigma));
    }
    let known = errors.len();
    errors.sort_by(f64::total_cmp);
    (
        known as f64 / chains.pixels().len() as f64,
        errors.get(known / 2).copied().unwrap_or(f64::NAN),
        within as f64 / known.max(1) as f64,
    )
}

const AROUND: [(f64, f64, f64); 7] = [
    (0.12, 0.0, 0.02),
    (-0.14, 0.02, -0.01),
    (0.02, 0.13, 0.0),
    (-0.03, -0.15, 0.03),
    (0.25, 0.05, 0.05),
    (-0.26, -0.04, -0.04),
    (0.1, 0.2, 0.02),
];

fn around(wall: &Wall) -> Vec<MatchView> {
    AROUND
        .iter()
        .map(|&(x, y, turn)| wall.view(x, y, turn))
        .collect()
}

#[test]
fn a_wall_is_measured_within_its_deviations() {
    let wall = Wall { scale: 1.0 };
    let reference = wall.view(0.0, 0.0, 0.0);
    let depth = estimate(&reference, &around(&wall));
    let (coverage, error, within) = figures(&wall, &reference, &depth);
    assert!(coverage > 0.8, "{coverage}");
    assert!(error < 0.004, "{error}");
    assert!(within >= 0.8, "{within}");
}

#[test]
fn exposure_is_measured_and_made_up_for() {
    let wall = Wall { scale: 1.0 };
    let reference = wall.view(0.0, 0.0, 0.0);
    let exposures = [
        (0.8, 10.0),
        (1.15, -12.0),
        (0.9, 20.0),
        (1.0, 8.0),
        (1.1, 0.0),
        (0.75, 30.0),
        (1.0, -15.0),
    ];
    let neighbours: Vec<MatchView> = AROUND
        .iter()
        .zip(exposures)
        .map(|(&(x, y, turn), (gain, offset))| wall.exposed(x, y, turn, gain, offset))
        .collect();
    let depth = estimate(&reference, &neighbours);
    for (pair, (gain, offset)) in depth.pairs.iter().zip(exposures) {
        let at_100 = pair.gain * 100.0 + pair.offset.unwrap();
        assert!(
            (pair.gain - gain).abs() < 0.06 && (at_100 - 100.0 * gain - offset).abs() < 3.0,
            "{pair:?}"
        );
    }
    let (coverage, error, _) = figures(&wall, &reference, &depth);
    assert!(coverage > 0.75 && error < 0.005, "{coverage} {error}");
}

#[test]
fn errors_of_poses_enter_the_deviation() {
    let wall = Wall { scale: 1.0 };
    let reference = wall.view(0.0, 0.0, 0.0);
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let neighbours: Vec<MatchView> = AROUND
        .iter()
        .map(|&(x, y, turn)| {
            let pose = wall.pose(x, y, turn);
            let image = wall.render(&pose, 1.0, 0.0, 1.0);
            // Up to two pixels of rotation and some of translation.
            let mut error =
                |size: f64| Vector3::from_fn(|_, _| size * (2.0 * rng.random::<f64>() - 1.0));
            let wrong = Isometry3::from_parts(
                (pose.translation.vector + error(0.002)).into(),
                UnitQuaternion::from_scaled_axis(error(2.0 / 260.0)) * pose.rotation,
            );
            prepared(&image, &wrong)
        })
        .collect();
    let depth = estimate(&reference, &neighbours);
    let (coverage, error, within) = figures(&wall, &reference, &depth);
    assert!(coverage > 0.4 && error < 0.05, "{coverage} {error}");
    assert!(within >= 0.8, "{within}");
}

#[test]
fn no_depth_is_invented() {
    let wall = Wall { scale: 1.0 };
    let reference = wall.view(0.0, 0.0, 0.0);
    let black = GrayImage::new(WIDTH, HEIGHT, vec![0; WIDTH * HEIGHT]).unwrap();
    let white = GrayImage::new(WIDTH, HEIGHT, vec![255; WIDTH * HEIGHT]).unwrap();
    let uniform = |image: &GrayImage| -> Vec<MatchView> {
        AROUND
            .iter()
            .map(|&(x, y, turn)| prepared(image, &wall.pose(x, y, turn)))
            .collect()
    };
    let rotated: Vec<MatchView> = (0..7)
        .map(|i| wall.view(0.0, 0.0, 0.03 * f64::from(i - 3)))
        .collect();
    let backwards: Vec<MatchView> = AROUND
        .iter()
        .map(|&(x, y, _)| wall.view(x, y, 2.6))
        .collect();
    for (what, neighbours) in [
        ("none", Vec::new()),
        ("one", vec![wall.view(0.1, 0.0, 0.0)]),
        ("identical poses", vec![reference.clone(); 7]),
        ("pure rotation", rotated),
        ("nothing in common", backwards),
        ("black", uniform(&black)),
        ("saturated", uniform(&white)),
    ] {
        let depth = estimate(&reference, &neighbours);
        assert_eq!(depth.map.known_count(), 0, "{what}");
    }
    for image in [black, white] {
        let depth = estimate(&prepared(&image, &wall.pose(0.0, 0.0, 0.0)), &around(&wall));
        assert_eq!(depth.map.known_count(), 0);
    }
}

#[test]
fn nearly_pure_rotation_claims_nothing() {
    // Centres that differ by rounding only: everything at zero disparity, as if infinitely far.
    let wall = Wall { scale: 1.0 };
    let reference = wall.view(0.0, 0.0, 0.0);
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let neighbours: Vec<MatchView> = (0..7)
        .map(|i| {
            let pose = wall.pose(0.0, 0.0, 0.02 * f64::from(i - 3));
            let image = wall.render(&pose, 1.0, 0.0, 1.0);
            let mut moved = pose;
            moved.translation.vector += Vector3::from_fn(|_, _| 1e-9 * (rng.random::<f64>() - 0.5));
            prepared(&image, &moved)
        })
        .collect();
    let depth = estimate(&reference, &neighbours);
    let known = depth.map.known_count();
    assert!(known * 100 <= reference.chains().pixels().len(), "{known}");
}

#[test]
fn the_unit_of_the_poses_does_not_matter() {
    let small = Wall { scale: 1.0 };
    let large = Wall { scale: 1024.0 };
    let neighbours = |wall: &Wall| -> Vec<MatchView> {
        AROUND
            .iter()
            .map(|&(x, y, turn)| {
                let image = small.render(&small.pose(x, y, turn), 1.0, 0.0, 1.0);
                prepared(&image, &wall.pose(x, y, turn))
            })
            .collect()
    };
    let reference = small.view(0.0, 0.0, 0.0);
    let (a, b) = (
        estimate(&reference, &neighbours(&small)),
        estimate(&reference, &neighbours(&large)),
    );
    assert!(a.map.known_count() > 1000);
    let scaled: Vec<(usize, usize, f32)> = b
        .map
        .known()
        .map(|(x, y, d)| (x, y, d.rho * 1024.0))
        .collect();
    assert_eq!(
        a.map
            .known()
            .map(|(x, y, d)| (x, y, d.rho))
            .collect::<Vec<_>>(),
        scaled
    );
}

#[test]
fn threads_change_nothing() {
    let wall = Wall { scale: 1.0 };
    let reference = wall.view(0.0, 0.0, 0.0);
    let neighbours = around(&wall);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| estimate(&reference, &neighbours).map)
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn consistent_depths_are_kept_and_wrong_ones_removed() {
    let wall = Wall { scale: 1.0 };
    let views: Vec<MatchView> = std::iter::once(wall.view(0.0, 0.0, 0.0))
        .chain(around(&wall))
        .collect();
    let depths: Vec<SemiDenseDepth> = (0..views.len())
        .map(|own| {
            let others: Vec<&MatchView> = (0..views.len())
                .filter(|&other| other != own)
                .map(|other| &views[other])
                .collect();
            SemiDense::new(SemiDenseOptions::default())
                .unwrap()
                .estimate(&views[own], &others, None)
                .unwrap()
        })
        .collect();
    let others: Vec<DepthView> = (1..views.len())
        .map(|other| DepthView {
            view: &views[other],
            map: &depths[other].map,
            correction: depths[0].corrections[other - 1],
        })
        .collect();
    let mut right = depths[0].map.clone();
    let known = right.known_count();
    let removed = enforce_consistency(
        &views[0],
        &mut right,
        &others,
        &ConsistencyOptions::default(),
    );
    assert!(removed * 10 < known, "{removed} of {known}");
    let strict = ConsistencyOptions {
        least_agreeing: 2,
        ..ConsistencyOptions::default()
    };
    // Doubled depths agree with no other keyframe.
    let mut wrong = depths[0].map.clone();
    for (x, y, found) in depths[0].map.known() {
        wrong.set(
            x,
            y,
            crate::depth::InverseDepth::new(0.5 * found.rho, found.sigma),
        );
    }
    let removed = enforce_consistency(&views[0], &mut wrong, &others, &strict);
    assert!(removed * 10 > 9 * known, "{removed} of {known}");
}
