//! Writers of small sequences with depth, one for each layout.
//!
//! The scene is the inside of a box; the camera moves sideways and forward. Depth is exact.

use std::fmt::Write;
use std::path::Path;

use image::{GrayImage, ImageBuffer, Luma};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

/// Width and height of the images.
pub(crate) const SIZE: (u32, u32) = (64, 48);
/// Focal length in pixels; the principal point is the image centre.
pub(crate) const FOCAL: f64 = 60.0;

/// Poses of the frames, world from camera.
pub(crate) fn poses(count: usize) -> Vec<Isometry3<f64>> {
    (0..count)
        .map(|i| {
            let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.03 * i as f64, 0.0));
            Isometry3::from_parts(
                Translation3::new(0.1 * i as f64, 0.02 * i as f64, 0.08 * i as f64),
                turn,
            )
        })
        .collect()
}

/// Depth of the inside of a box, 4 wide, 3 high, its back wall at z = 3, in millimetres (or another scale).
pub(crate) fn depth_image(pose: &Isometry3<f64>, scale: f64) -> ImageBuffer<Luma<u16>, Vec<u16>> {
    ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (_, t) = hit(pose, x, y);
        Luma([(t * scale).round() as u16])
    })
}

/// A grey image: each wall has its own grey level, the back wall a checkerboard.
pub(crate) fn color_image(pose: &Isometry3<f64>) -> GrayImage {
    GrayImage::from_fn(SIZE.0, SIZE.1, |x, y| {
        let (point, _) = hit(pose, x, y);
        let level = if point.z > 2.999 {
            let cells = (point.x * 2.0).floor() + (point.y * 2.0).floor();
            if cells.rem_euclid(2.0) < 1.0 { 60 } else { 200 }
        } else if point.x.abs() > 1.999 {
            120
        } else {
            160
        };
        Luma([level])
    })
}

/// The point of the box at a pixel, and its depth z.
fn hit(pose: &Isometry3<f64>, x: u32, y: u32) -> (Vector3<f64>, f64) {
    let ray = Vector3::new(
        (f64::from(x) - f64::from(SIZE.0 - 1) / 2.0) / FOCAL,
        (f64::from(y) - f64::from(SIZE.1 - 1) / 2.0) / FOCAL,
        1.0,
    );
    let (from, along) = (pose.translation.vector, pose.rotation * ray);
    let walls = [
        (2.0, 0),
        (-2.0, 0),
        (1.5, 1),
        (-1.5, 1),
        (3.0, 2),
        (-3.0, 2),
    ];
    let t = walls
        .iter()
        .map(|&(wall, axis)| (wall - from[axis]) / along[axis])
        .filter(|t| *t > 0.0)
        .fold(f64::INFINITY, f64::min);
    (from + along * t, t)
}

fn matrix_text(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    let mut text = String::new();
    for r in 0..4 {
        let row: Vec<String> = (0..4).map(|c| format!("{:.9e}", matrix[(r, c)])).collect();
        writeln!(text, "{}", row.join(" ")).unwrap();
    }
    text
}

fn intrinsic_numbers() -> [f64; 4] {
    [
        FOCAL,
        FOCAL,
        f64::from(SIZE.0 - 1) / 2.0,
        f64::from(SIZE.1 - 1) / 2.0,
    ]
}

/// A sidecar with the camera of the images.
pub(crate) fn sidecar() -> String {
    let [fx, fy, cx, cy] = intrinsic_numbers();
    format!("[color]\nfx = {fx:.1}\nfy = {fy:.1}\ncx = {cx:.1}\ncy = {cy:.1}\n")
}

/// Writes 7-Scenes.
pub(crate) fn write_seven_scenes(folder: &Path, count: usize) {
    for (i, pose) in poses(count).iter().enumerate() {
        let file = |part: &str| folder.join(format!("frame-{i:06}.{part}"));
        color_image(pose).save(file("color.png")).unwrap();
        depth_image(pose, 1000.0).save(file("depth.png")).unwrap();
        std::fs::write(file("pose.txt"), matrix_text(pose)).unwrap();
    }
    let [fx, fy, cx, cy] = intrinsic_numbers();
    let text = format!("{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n");
    std::fs::write(folder.join("camera-intrinsics.txt"), text).unwrap();
}

/// Writes TUM RGB-D with a sidecar for the camera. Stamps of depth and poses are a few milliseconds late.
pub(crate) fn write_tum(folder: &Path, count: usize) {
    for name in ["rgb", "depth"] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
    }
    let mut lists = [
        "# color images\n# timestamp filename\n".to_owned(),
        "# depth maps\n".to_owned(),
        "# timestamp tx ty tz qx qy qz qw\n".to_owned(),
    ];
    for (i, pose) in poses(count).iter().enumerate() {
        let second = 1_305_031_102 + i;
        let stamps = [175_304, 179_000, 171_100].map(|micro| format!("{second}.{micro:06}"));
        color_image(pose)
            .save(folder.join(format!("rgb/{}.png", stamps[0])))
            .unwrap();
        depth_image(pose, 5000.0)
            .save(folder.join(format!("depth/{}.png", stamps[1])))
            .unwrap();
        writeln!(lists[0], "{0} rgb/{0}.png", stamps[0]).unwrap();
        writeln!(lists[1], "{0} depth/{0}.png", stamps[1]).unwrap();
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        writeln!(
            lists[2],
            "{} {:.6} {:.6} {:.6} {:.9} {:.9} {:.9} {:.9}",
            stamps[2], t.x, t.y, t.z, q.x, q.y, q.z, q.w
        )
        .unwrap();
    }
    for (name, text) in ["rgb.txt", "depth.txt", "groundtruth.txt"]
        .iter()
        .zip(lists)
    {
        std::fs::write(folder.join(name), text).unwrap();
    }
    std::fs::write(folder.join("linecarve.toml"), sidecar()).unwrap();
}

/// Writes Open3D with a pose for each frame and an image for every `step`-th.
pub(crate) fn write_open3d(folder: &Path, count: usize, step: usize) {
    for name in ["image", "depth"] {
        std::fs::create_dir_all(folder.join(name)).unwrap();
    }
    let mut log = String::new();
    for (i, pose) in poses(count).iter().enumerate() {
        write!(log, "{i} {i} {}\n{}", i + 1, matrix_text(pose)).unwrap();
        if i % step == 0 {
            color_image(pose)
                .save(folder.join(format!("image/{i:05}.png")))
                .unwrap();
            depth_image(pose, 1000.0)
                .save(folder.join(format!("depth/{i:05}.png")))
                .unwrap();
        }
    }
    std::fs::write(folder.join("trajectory.log"), log).unwrap();
    let [fx, fy, cx, cy] = intrinsic_numbers();
    let json = format!(
        "{{\"width\": {}, \"height\": {}, \"intrinsic_matrix\": [{fx}, 0, 0, 0, {fy}, 0, {cx}, {cy}, 1]}}",
        SIZE.0, SIZE.1
    );
    std::fs::write(folder.join("camera_primesense.json"), json).unwrap();
}
