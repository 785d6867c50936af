//! Folders as scripts and simulators leave them.

use std::fmt::Write;
use std::path::Path;

use nalgebra::Isometry3;

use crate::support::{FOCAL, SIZE, color_image, depth_image, poses};

pub(crate) const FRAMES: usize = 6;

pub(crate) fn matrix_lines(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    (0..4).fold(String::new(), |mut text, r| {
        let row: Vec<String> = (0..4).map(|c| matrix[(r, c)].to_string()).collect();
        writeln!(text, "{}", row.join(" ")).unwrap();
        text
    })
}

pub(crate) fn intrinsics_text(scale: f64) -> String {
    let center = |side: u32| scale * f64::from(side) / 2.0 - 0.5;
    format!(
        "{f} 0 {cx}\n0 {f} {cy}\n0 0 1\n",
        f = scale * FOCAL,
        cx = center(SIZE.0),
        cy = center(SIZE.1)
    )
}

/// Images and depth images under names that are given by the number of the frame.
pub(crate) fn write_images(
    folder: &Path,
    scale: f64,
    color: impl Fn(usize) -> String,
    depth: impl Fn(usize) -> String,
) {
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        for (name, is_color) in [(color(i), true), (depth(i), false)] {
            let path = folder.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            if is_color {
                color_image(pose).save(path).unwrap();
            } else {
                depth_image(pose, scale).save(path).unwrap();
            }
        }
    }
}

/// A pose file for each image and intrinsics: folders of ScanNet and of many scripts.
pub(crate) fn write_pose_folder(folder: &Path) {
    let numbered = |part: &str, end: &str| {
        let (part, end) = (part.to_owned(), end.to_owned());
        move |i: usize| format!("{part}/{i}.{end}")
    };
    write_images(
        folder,
        1000.0,
        numbered("color", "png"),
        numbered("depth", "png"),
    );
    std::fs::create_dir(folder.join("pose")).unwrap();
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        std::fs::write(folder.join(format!("pose/{i}.txt")), matrix_lines(pose)).unwrap();
    }
    std::fs::write(folder.join("intrinsics.txt"), intrinsics_text(1.0)).unwrap();
}

/// Poses in a list, and the camera in the folder above.
pub(crate) fn write_replica(root: &Path) {
    let room = root.join("room0");
    write_images(
        &room,
        6553.5,
        |i| format!("results/frame{i:06}.png"),
        |i| format!("results/depth{i:06}.png"),
    );
    let lines: String = poses(FRAMES)
        .iter()
        .map(|pose| matrix_lines(pose).replace('\n', " ") + "\n")
        .collect();
    std::fs::write(room.join("traj.txt"), lines).unwrap();
    let text = format!(
        "{{\"camera\": {{\"w\": {}, \"h\": {}, \"fx\": {FOCAL}, \"fy\": {FOCAL}, \"cx\": 31.5, \"cy\": 23.5, \"scale\": 6553.5}}}}",
        SIZE.0, SIZE.1
    );
    std::fs::write(root.join("cam_params.json"), text).unwrap();
}

/// ICL-NUIM: a list with depth first, and counted poses from a number on.
pub(crate) fn write_icl(root: &Path, first_pose: usize) {
    write_images(
        root,
        5000.0,
        |i| format!("rgb/{i}.png"),
        |i| format!("depth/{i}.png"),
    );
    let (mut list, mut trajectory) = (String::new(), String::new());
    for (i, pose) in poses(FRAMES).iter().enumerate() {
        writeln!(list, "{i} depth/{i}.png {i} rgb/{i}.png").unwrap();
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        let number = i + first_pose;
        writeln!(
            trajectory,
            "{number} {} {} {} {} {} {} {}",
            t.x, t.y, t.z, q.x, q.y, q.z, q.w
        )
        .unwrap();
    }
    let sidecar = crate::support::sidecar() + "[depth]\nscale = 5000.0\n";
    for (name, text) in [
        ("associations.txt", list),
        ("livingRoom1.gt.freiburg", trajectory),
        ("linecarve.toml", sidecar),
    ] {
        std::fs::write(root.join(name), text).unwrap();
    }
}
