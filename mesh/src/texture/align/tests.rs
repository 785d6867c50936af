use image::{Rgb, RgbImage};
use linecarve_lines::camera::Camera;
use nalgebra::{Point2, Point3, Vector3};

use super::*;

const WIDTH: u32 = 320;
const HEIGHT: u32 = 240;
const DEPTH: f64 = 2.0;

fn camera() -> Camera {
    Camera::pinhole(300.0, 300.0, 159.5, 119.5).unwrap()
}

/// Two walls that meet at a right angle.
fn corner() -> TriangleMesh {
    let at = |x: f64, z: f64| [-1.5, 1.5].map(|y| Point3::new(x, y, z));
    let positions = [at(-2.0, 0.0), at(0.0, DEPTH), at(2.0, 0.0)].concat();
    TriangleMesh {
        positions,
        triangles: vec![[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]],
        colors: None,
    }
}

/// Brightness of the walls, without a period in reach.
fn brightness(point: &Point3<f64>) -> f64 {
    let wave = |a: f64, b: f64, c: f64| (a * point.x + b * point.y + c * point.z).sin();
    128.0 + 30.0 * wave(9.0, 3.0, 1.0) + 30.0 * wave(-2.0, 11.0, 3.0) + 30.0 * wave(21.0, 17.0, 5.0)
}

/// What a camera sees of the walls, with a gain of its brightness.
fn photo(world_from_camera: &Isometry3<f64>, gain: f64) -> RgbImage {
    let camera = camera();
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let pixel = Point2::new(f64::from(x), f64::from(y));
        let ray = camera.point_at_depth(&pixel, 1.0).unwrap().coords;
        let ray = world_from_camera.rotation * ray;
        let eye = world_from_camera.translation.vector;
        // The walls are z = 2 - |x|.
        let reach = |side: f64| (DEPTH - eye.z - side * eye.x) / (ray.z + side * ray.x);
        let point = Point3::from(eye + f64::min(reach(1.0), reach(-1.0)) * ray);
        Rgb([(gain * brightness(&point)).clamp(0.0, 255.0) as u8; 3])
    })
}

/// True poses, and given ones that are off by several pixels; the mean of the errors is zero.
fn poses() -> Vec<[Isometry3<f64>; 2]> {
    let places = [-0.3, -0.1, 0.1, 0.3];
    let errors = [
        ([0.008, -0.006, 0.01], [0.01, 0.0, -0.02]),
        ([-0.01, -0.008, -0.004], [0.0, 0.02, 0.01]),
        ([0.006, 0.012, -0.01], [-0.02, 0.0, 0.0]),
        ([-0.004, 0.002, 0.004], [0.01, -0.02, 0.01]),
    ];
    let pose = |(x, (rotation, shift)): (f64, ([f64; 3], [f64; 3]))| {
        let truth = Isometry3::new(
            Vector3::new(x, 0.2 * x, 0.0),
            Vector3::new(0.0, -0.2 * x, 0.0),
        );
        [
            truth,
            truth * Isometry3::new(Vector3::from(shift), Vector3::from(rotation)),
        ]
    };
    places.into_iter().zip(errors).map(pose).collect()
}

fn view(world_from_camera: Isometry3<f64>) -> TextureView {
    TextureView {
        camera: camera(),
        world_from_camera,
    }
}

/// Root mean square distance in pixels between where points are in two poses.
fn apart_px(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let camera = camera();
    let places = [-0.6, -0.2, 0.2, 0.6];
    let points = places
        .into_iter()
        .flat_map(|x| places.map(|y| Point3::new(x, 0.7 * y, DEPTH - f64::abs(x))));
    let squares = points.map(|point| {
        let [a, b] = [a, b].map(|pose| camera.project(&(pose.inverse() * point)).unwrap());
        (a - b).norm_squared()
    });
    (squares.sum::<f64>() / 16.0).sqrt()
}

#[test]
fn photographs_move_to_where_they_agree() {
    let poses = poses();
    let views: Vec<_> = poses.iter().map(|[_, given]| view(*given)).collect();
    let gains = [1.0, 0.8, 1.1, 0.9];
    let load = |index: usize| Some(photo(&poses[index][0], gains[index]));
    let mesh = corner();
    let alignment = align_photos(&mesh, &views, &load);
    let mut moved = 0.0;
    for ([truth, given], view) in poses.iter().zip(&alignment.views) {
        let [before, after] = [given, &view.world_from_camera].map(|pose| apart_px(truth, pose));
        assert!(before > 2.0, "{before}");
        assert!(after < 0.2 * before, "{before} {after}");
        moved += before / 4.0;
    }
    assert!(
        (alignment.moved_px / moved - 1.0).abs() < 0.4,
        "{} {moved}",
        alignment.moved_px
    );

    // A further photograph moves to what these show.
    let truth = Isometry3::new(Vector3::new(0.05, 0.1, 0.05), Vector3::zeros());
    let given = truth
        * Isometry3::new(
            Vector3::new(0.01, 0.0, 0.0),
            Vector3::new(0.01, -0.01, 0.01),
        );
    let found = alignment.align(&mesh, &view(given), &photo(&truth, 0.85));
    let [before, after] = [given, found].map(|pose| apart_px(&truth, &pose));
    assert!(after < 0.2 * before, "{before} {after}");
}

#[test]
fn a_missing_photograph_and_one_of_something_else_keep_their_poses() {
    let poses = poses();
    let views: Vec<_> = poses.iter().map(|[truth, _]| view(*truth)).collect();
    let load = |index: usize| match index {
        0 => None,
        1 => Some(RgbImage::from_pixel(WIDTH, HEIGHT, Rgb([90; 3]))),
        _ => Some(photo(&poses[index][0], 1.0)),
    };
    let alignment = align_photos(&corner(), &views, &load);
    for (index, (given, found)) in views.iter().zip(&alignment.views).enumerate() {
        let moved = apart_px(&given.world_from_camera, &found.world_from_camera);
        let bound = if index < 2 { 1e-9 } else { 0.3 };
        assert!(moved < bound, "{index}: {moved}");
    }
}
