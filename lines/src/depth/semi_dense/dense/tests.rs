//! A slanted wall, rendered analytically, seen by cameras with known poses.

use nalgebra::{Isometry3, Point2, Point3, UnitQuaternion, Vector3};

use crate::camera::Camera;
use crate::depth::semi_dense::{
    DenseOptions, MatchView, SemiDense, SemiDenseOptions, SurfaceView, fuse_surfaces,
};
use crate::edges::EdgeDetector;
use crate::image::GrayImage;
use crate::triangulation::{SurfaceSample, SurfaceSamples};

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

fn true_rho(pixel: Point2<f64>) -> f64 {
    hit(&Isometry3::identity(), pixel).0.recip()
}

/// Waves too smooth for an edge, and dark bars with edges that can be measured.
fn barred(point: &Point3<f64>) -> f64 {
    let bend = |v: f64| 1.5 * (7.0 * v).sin();
    let is_on_bar = |v: f64| (v / 0.83).rem_euclid(1.0) < 0.05;
    if is_on_bar(point.x + 0.2 * point.y) || is_on_bar(point.y - 0.3 * point.x) {
        return 20.0;
    }
    120.0
        + 6.0 * (40.0 * point.x + bend(point.y)).sin()
        + 6.0 * (37.0 * point.y + bend(point.x)).sin()
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

fn surface(views: &[MatchView]) -> SurfaceSamples {
    let estimator = SemiDense::new(SemiDenseOptions::default()).unwrap();
    let neighbours: Vec<&MatchView> = views[1..].iter().collect();
    let depth = estimator.estimate(&views[0], &neighbours, None).unwrap();
    let surface = estimator.dense_surface(&views[0], &depth, &neighbours, &DenseOptions::default());
    let view = SurfaceView {
        samples: &surface.samples,
        camera: views[0].camera(),
        world_from_camera: views[0].world_from_camera(),
    };
    fuse_surfaces(&view, &[], &surface.is_open)
}

fn known(surface: &SurfaceSamples) -> Vec<(Point2<f64>, SurfaceSample)> {
    (0..surface.rows())
        .flat_map(|row| (0..surface.columns()).map(move |column| (column, row)))
        .filter_map(|(column, row)| Some((surface.pixel(column, row), surface.get(column, row)?)))
        .collect()
}

#[test]
fn depth_and_slope_of_a_textured_wall_are_measured() {
    let surface = surface(&views(barred));
    assert_eq!(
        (surface.step_px(), surface.columns(), surface.rows()),
        (2, 160, 120)
    );
    let known = known(&surface);
    let total = surface.columns() * surface.rows();
    assert!(5 * known.len() > 4 * total, "{} of {total}", known.len());
    let (mut errors, mut turns, mut within) = (Vec::new(), Vec::new(), 0);
    for (pixel, sample) in &known {
        let rho = true_rho(*pixel);
        let slope = true_rho(pixel + nalgebra::Vector2::x()) - rho;
        errors.push((f64::from(sample.rho) / rho - 1.0).abs());
        turns.push(
            (f64::from(sample.slope[0]) - slope)
                .abs()
                .max(sample.slope[1].abs().into()),
        );
        within += usize::from((f64::from(sample.rho) - rho).abs() <= 2.0 * f64::from(sample.sigma));
    }
    errors.sort_by(f64::total_cmp);
    turns.sort_by(f64::total_cmp);
    let at = |share: f64| (share * known.len() as f64) as usize;
    assert!(
        errors[at(0.5)] < 0.002 && errors[at(0.95)] < 0.02,
        "{} {}",
        errors[at(0.5)],
        errors[at(0.95)]
    );
    // The wall has a slope of 0.3 rho / f = 6e-4.
    assert!(turns[at(0.5)] < 1e-4, "{}", turns[at(0.5)]);
    assert!(
        20 * within > 17 * known.len(),
        "{within} of {}",
        known.len()
    );
}

#[test]
fn nothing_is_invented_where_there_is_no_texture() {
    // The right part is blank, and its border lies on one side of it.
    let is_blank = |x: f64| x > 0.1;
    let surface = surface(&views(|point| {
        if is_blank(point.x) {
            90.0
        } else {
            barred(point)
        }
    }));
    let known = known(&surface);
    assert!(known.len() > 2000, "{}", known.len());
    let margin = 0.25;
    let invented = known
        .iter()
        .filter(|(pixel, _)| is_blank(hit(&Isometry3::identity(), *pixel).1.x - margin))
        .count();
    assert_eq!(invented, 0);
}

#[test]
fn a_blank_panel_lies_on_the_plane_of_its_surroundings() {
    let is_panel = |point: &Point3<f64>| (point.x - 0.1).abs() < 0.3 && point.y.abs() < 0.25;
    let surface = surface(&views(
        |point| if is_panel(point) { 90.0 } else { barred(point) },
    ));
    let known = known(&surface);
    let on_panel: Vec<&(Point2<f64>, SurfaceSample)> = known
        .iter()
        .filter(|(pixel, _)| is_panel(&hit(&Isometry3::identity(), *pixel).1))
        .collect();
    assert!(on_panel.len() > 1000, "{}", on_panel.len());
    let is_wrong = |(pixel, sample): &&&(Point2<f64>, SurfaceSample)| {
        (f64::from(sample.rho) / true_rho(*pixel) - 1.0).abs() > 0.02
    };
    let wrong = on_panel.iter().filter(is_wrong).count();
    assert!(50 * wrong < on_panel.len(), "{wrong} of {}", on_panel.len());
}

#[test]
fn threads_and_repetitions_change_nothing() {
    let views = views(barred);
    let first = surface(&views);
    for threads in [1, 3] {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        assert!(pool.install(|| surface(&views)) == first);
    }
}

#[test]
fn images_without_edges_or_neighbours_have_no_surface() {
    let blank = views(|_| 90.0);
    assert_eq!(surface(&blank).known_count(), 0);
    assert_eq!(surface(&blank[..1]).known_count(), 0);
    assert_eq!(surface(&views(barred)[..2]).known_count(), 0);
}
