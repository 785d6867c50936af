//! A slanted wall, rendered analytically, seen by cameras with known poses: smooth texture, or dark bars on it.

use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};

use super::plane_hypotheses::PlaneHypothesis;
use super::*;
use crate::camera::Camera;
use crate::depth::map::InverseDepthMap;
use crate::depth::semi_dense::SemiDenseOptions;
use crate::edges::EdgeDetector;
use crate::image::GrayImage;

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Centres of the reference and of its neighbours.
const CENTRES: [[f64; 2]; 6] = [
    [0.0, 0.0],
    [0.2, 0.02],
    [-0.22, 0.0],
    [0.03, 0.19],
    [-0.02, -0.21],
    [0.3, 0.1],
];

fn camera() -> Camera {
    Camera::pinhole(260.0, 260.0, 159.5, 119.5).unwrap()
}

/// Depth z of the wall `z = 2 + 0.3 x` along a pixel's ray, and the point.
fn hit(pose: &Isometry3<f64>, pixel: Point2<f64>) -> (f64, Point3<f64>) {
    let ray = camera().unproject(&pixel).unwrap();
    let ray = pose.rotation * (ray / ray.z);
    let origin = pose.translation.vector;
    let normal = Vector3::new(-0.3, 0.0, 1.0);
    let depth = (2.0 - normal.dot(&origin)) / normal.dot(&ray);
    (depth, Point3::from(origin + depth * ray))
}

fn true_rho([x, y]: [u16; 2]) -> f32 {
    let pixel = Point2::new(f64::from(x), f64::from(y));
    hit(&Isometry3::identity(), pixel).0.recip() as f32
}

/// Waves too smooth for an edge.
fn waves(point: &Point3<f64>) -> f64 {
    let bend = |v: f64| 1.5 * (7.0 * v).sin();
    120.0
        + 6.0 * (40.0 * point.x + bend(point.y)).sin()
        + 6.0 * (37.0 * point.y + bend(point.x)).sin()
}

/// Waves, and dark bars with edges that can be measured.
fn barred(point: &Point3<f64>) -> f64 {
    let is_on_bar = |v: f64| (v / 0.43).rem_euclid(1.0) < 0.1;
    if is_on_bar(point.x + 0.2 * point.y) || is_on_bar(point.y - 0.3 * point.x) {
        20.0
    } else {
        waves(point)
    }
}

fn views(level: impl Fn(&Point3<f64>) -> f64) -> Vec<MatchView> {
    CENTRES
        .iter()
        .map(|[x, y]| {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.1 * y, -0.1 * x, 0.05 * x));
            let pose = Isometry3::from_parts(Vector3::new(*x, *y, 0.02 * x).into(), turn);
            let samples = (0..WIDTH * HEIGHT)
                .map(|at| {
                    let pixel = Point2::new((at % WIDTH) as f64, (at / WIDTH) as f64);
                    level(&hit(&pose, pixel).1).round() as u8
                })
                .collect();
            let image = GrayImage::new(WIDTH, HEIGHT, samples).unwrap();
            MatchView::new(&image, &camera(), &pose, &mut EdgeDetector::default()).unwrap()
        })
        .collect()
}

/// Sweeps hypotheses at the true plane times `factor` all over the image.
fn swept(views: &[MatchView], factor: f32) -> Vec<Option<SurfacePoint>> {
    let options = SweepOptions::default();
    let sources = views[1..]
        .iter()
        .filter_map(|view| SourceView::new(&views[0], view, &UnitQuaternion::identity()))
        .collect();
    let sweep = PlaneSweep::new(&views[0], sources, 1.5, &options);
    (0..48)
        .map(|i| [40 + 30 * (i % 8), 40 + 30 * (i / 8)])
        .map(|pixel: [u16; 2]| {
            let rho = true_rho(pixel);
            let slope = true_rho([pixel[0] + 1, pixel[1]]) - rho;
            sweep.measure(&PlaneHypothesis {
                pixel,
                rho: factor * rho,
                slope: [factor * slope, 0.0],
            })
        })
        .collect()
}

fn error(point: &SurfacePoint) -> f32 {
    point.depth.rho / true_rho(point.pixel) - 1.0
}

#[test]
fn a_hypothesis_near_the_surface_converges_to_it() {
    let views = views(waves);
    for factor in [0.97, 1.0, 1.025] {
        let found: Vec<SurfacePoint> = swept(&views, factor).into_iter().flatten().collect();
        assert!(found.len() >= 36, "{} at {factor}", found.len());
        for point in &found {
            assert!(error(point).abs() < 0.006, "{point:?} at {factor}");
            let sigmas = error(point).abs() * point.depth.rho / point.depth.sigma;
            assert!(sigmas < 4.0, "{sigmas} of {point:?}");
        }
    }
}

#[test]
fn a_hypothesis_off_the_surface_or_without_texture_is_rejected() {
    let textured = views(waves);
    for factor in [0.7, 1.4] {
        let found = swept(&textured, factor).into_iter().flatten().count();
        assert!(found <= 1, "{found} of 48 at {factor}");
    }
    let plain = views(|_| 120.0);
    assert_eq!(swept(&plain, 1.0), vec![None; 48]);
}

#[test]
fn points_between_bars_lie_on_the_wall() {
    let views = views(barred);
    let neighbours: Vec<&MatchView> = views[1..].iter().collect();
    let estimator = SemiDense::new(SemiDenseOptions::default()).unwrap();
    let depth = estimator.estimate(&views[0], &neighbours, None).unwrap();
    let points =
        |options: &SweepOptions| estimator.surface_points(&views[0], &depth, &neighbours, options);
    let found = points(&SweepOptions::default());
    assert!(found.len() >= 60, "{}", found.len());
    let right = found
        .iter()
        .filter(|point| error(point).abs() < 0.01)
        .count();
    assert!(10 * right >= 9 * found.len(), "{right} of {}", found.len());
    let one_thread = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    assert_eq!(
        one_thread.install(|| points(&SweepOptions::default())),
        found
    );
    for spacing_px in [0, WIDTH, usize::MAX] {
        let options = SweepOptions {
            spacing_px,
            ..SweepOptions::default()
        };
        assert_eq!(points(&options), []);
    }
    let alone = SweepOptions {
        neighbours: 1,
        ..SweepOptions::default()
    };
    assert_eq!(points(&alone), []);
}

/// Hypotheses from the edges of the bars with depths given per pixel.
fn hypotheses_of(rho: impl Fn([u16; 2]) -> f32) -> Vec<PlaneHypothesis> {
    let view = &views(barred)[0];
    let mut map = InverseDepthMap::unknown(WIDTH, HEIGHT).unwrap();
    for &[x, y] in view.chains().pixels() {
        let known = InverseDepth::new(rho([x, y]), 0.001);
        map.set(usize::from(x), usize::from(y), known);
    }
    plane_hypotheses(view, &map, 12)
}

#[test]
fn hypotheses_follow_the_plane_of_the_edges_and_cross_no_jump() {
    let plane = hypotheses_of(true_rho);
    assert!(plane.len() > 100, "{}", plane.len());
    for hypothesis in &plane {
        let error = hypothesis.rho / true_rho(hypothesis.pixel) - 1.0;
        assert!(error.abs() < 2e-3, "{hypothesis:?}");
    }
    // The right half is twice as far away.
    let jump = hypotheses_of(|[x, _]| if x < 160 { 0.5 } else { 0.25 });
    assert!(jump.len() > 80, "{}", jump.len());
    for hypothesis in &jump {
        let is_on_either = [0.5, 0.25]
            .iter()
            .any(|rho| (hypothesis.rho - rho).abs() < 1e-5);
        assert!(is_on_either, "{hypothesis:?}");
    }
}

#[test]
fn options_out_of_range_are_refused() {
    SweepOptions::default().validate().unwrap();
    let with = |change: fn(&mut SweepOptions)| {
        let mut options = SweepOptions::default();
        change(&mut options);
        options.validate().unwrap_err().name
    };
    assert_eq!(with(|o| o.reach = 0.0), "sweep.reach");
    assert_eq!(
        with(|o| o.least_correlation = f64::NAN),
        "sweep.least_correlation"
    );
    assert_eq!(with(|o| o.agreeing_share = 1.1), "sweep.agreeing_share");
    assert_eq!(with(|o| o.least_margin = -0.1), "sweep.least_margin");
    assert_eq!(
        with(|o| o.least_texture = f64::INFINITY),
        "sweep.least_texture"
    );
    assert_eq!(
        with(|o| o.largest_relative_sigma = -1.0),
        "sweep.largest_relative_sigma"
    );
}
