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
    photo_through(|pixel| pixel, world_from_camera, gain)
}

/// The same through a lens, which is given by the pixel of a pinhole camera at a pixel.
fn photo_through(
    lens: impl Fn([f64; 2]) -> [f64; 2],
    world_from_camera: &Isometry3<f64>,
    gain: f64,
) -> RgbImage {
    RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
        let point = on_walls(world_from_camera, lens([x, y].map(f64::from)));
        Rgb([(gain * brightness(&point)).clamp(0.0, 255.0) as u8; 3])
    })
}

/// What a pinhole camera sees of the walls, which are z = 2 - |x|.
fn on_walls(world_from_camera: &Isometry3<f64>, [x, y]: [f64; 2]) -> Point3<f64> {
    let ray = camera().point_at_depth(&Point2::new(x, y), 1.0).unwrap();
    let ray = world_from_camera.rotation * ray.coords;
    let eye = world_from_camera.translation.vector;
    let reach = |side: f64| (DEPTH - eye.z - side * eye.x) / (ray.z + side * ray.x);
    Point3::from(eye + f64::min(reach(1.0), reach(-1.0)) * ray)
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
    let (found, _) = alignment.align(&mesh, &view(given), &photo(&truth, 0.85));
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
        let bound = if index < 2 { 1e-9 } else { 0.5 };
        assert!(moved < bound, "{index}: {moved}");
    }
}

#[test]
fn photographs_of_a_camera_share_a_distortion() {
    // 3 % shorter focal length along x, and barrel distortion: up to 8 pixels.
    let lens = |[x, y]: [f64; 2]| {
        let (x, y) = ((x - 159.5) / 300.0, (y - 119.5) / 300.0);
        let longer = 1.0 + 0.04 * (x * x + y * y);
        [1.03 * longer * x, longer * y]
    };
    let lens = |pixel| {
        let [x, y] = lens(pixel);
        [159.5 + 300.0 * x, 119.5 + 300.0 * y]
    };
    let pose = |at: usize| {
        let (column, row) = ((at % 3) as f64 - 1.0, (at / 3) as f64 - 1.0);
        Isometry3::new(
            Vector3::new(0.3 * column, 0.25 * row, 0.1 * column * row),
            Vector3::new(0.1 * row, -0.2 * column, 0.2 * (column - row)),
        )
    };
    let views: Vec<_> = (0..9).map(|at| view(pose(at))).collect();
    let load = |at: usize| Some(photo_through(lens, &pose(at), 1.0));
    let alignment = align_photos(&corner(), &views, &load);
    // Where the views see points of the walls before and after, apart from the mean of all views.
    let (mut before, mut after) = (0.0, 0.0);
    for x in [-0.6, -0.3, 0.2, 0.5] {
        for y in [-0.5, -0.1, 0.4] {
            let point = Point3::new(x, y, DEPTH - f64::abs(x));
            let seen = |at: usize| {
                let pinhole = camera().project(&(pose(at).inverse() * point)).unwrap();
                let mut pixel = [pinhole.x, pinhole.y];
                for _ in 0..20 {
                    let [x, y] = lens(pixel);
                    pixel = [pixel[0] + pinhole.x - x, pixel[1] + pinhole.y - y];
                }
                let distortion = alignment.distortions[at].as_ref().unwrap();
                let aligned = distortion.pinhole_from_photo(pixel);
                [
                    on_walls(&pose(at), pixel),
                    on_walls(&alignment.views[at].world_from_camera, aligned),
                ]
            };
            let seen: Vec<_> = (0..9).map(seen).collect();
            for (which, sum) in [&mut before, &mut after].into_iter().enumerate() {
                let mean = seen
                    .iter()
                    .map(|seen| seen[which].coords)
                    .sum::<Vector3<f64>>()
                    / 9.0;
                let squares = seen
                    .iter()
                    .map(|seen| (seen[which].coords - mean).norm_squared());
                *sum += squares.sum::<f64>();
            }
        }
    }
    let [before, after] = [before, after].map(f64::sqrt);
    assert!(after < 0.25 * before, "{before} {after}");
}

#[test]
fn cameras_turn_while_rows_are_exposed() {
    // Between 3 and 6 pixels from the first row to the last.
    let rotations = [
        [0.015, -0.012, 0.01],
        [-0.01, 0.018, 0.0],
        [0.006, 0.01, -0.01],
        [-0.011, -0.016, 0.0],
    ]
    .map(Vector3::from);
    let pose_of_row = |at: usize, y: f64| {
        let share = (y + 0.5) / f64::from(HEIGHT) - 0.5;
        poses()[at][0] * Isometry3::new(Vector3::zeros(), -share * rotations[at])
    };
    let load = |at: usize| {
        Some(RgbImage::from_fn(WIDTH, HEIGHT, |x, y| {
            let [x, y] = [x, y].map(f64::from);
            Rgb([brightness(&on_walls(&pose_of_row(at, y), [x, y])) as u8; 3])
        }))
    };
    let views: Vec<_> = poses().iter().map(|[truth, _]| view(*truth)).collect();
    let alignment = align_photos(&corner(), &views, &load);
    let (mut before, mut after) = (0.0, 0.0);
    for (at, view) in views.iter().enumerate() {
        let distortion = alignment.distortions[at].as_ref().unwrap();
        for pixel in [[60.0, 20.0], [160.0, 60.0], [250.0, 200.0], [100.0, 220.0]] {
            let truth = on_walls(&pose_of_row(at, pixel[1]), pixel);
            let aligned = distortion.pinhole_from_photo(pixel);
            let found = on_walls(&alignment.views[at].world_from_camera, aligned);
            before += (on_walls(&view.world_from_camera, pixel) - truth).norm_squared();
            after += (found - truth).norm_squared();
        }
    }
    assert!(after.sqrt() < 0.3 * before.sqrt(), "{before} {after}");
}
