//! Helpers of the end-to-end tests: the program, a small rendered sequence, comparison of folders.

#![allow(dead_code, reason = "each test binary uses a part")]

pub(crate) mod delta_reader;
pub(crate) mod live_client;
pub(crate) mod live_recording;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::Point2;
use tempfile::TempDir;

/// Runs the program to its end.
pub(crate) fn linecarve<S: AsRef<std::ffi::OsStr>>(
    arguments: impl IntoIterator<Item = S>,
) -> Output {
    Command::cargo_bin("linecarve")
        .expect("cargo builds the program before its tests")
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// Runs the program and demands an exit status; both outputs are shown when it is another.
pub(crate) fn expect_status<S: AsRef<std::ffi::OsStr>>(
    status: i32,
    arguments: impl IntoIterator<Item = S>,
) -> Output {
    let output = linecarve(arguments);
    assert_eq!(
        output.status.code(),
        Some(status),
        "\nstdout: {}\nstderr: {}",
        String::from_utf8_lossy(&output.stdout),
        stderr(&output)
    );
    output
}

/// Standard error as text.
pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Feeds lines to `linecarve stream`; its exit status and replies.
pub(crate) fn stream(
    arguments: &[&str],
    lines: &[String],
) -> (Option<i32>, Vec<serde_json::Value>) {
    let output = Command::cargo_bin("linecarve")
        .expect("cargo builds the program before its tests")
        .args(["stream", "--quiet"])
        .args(arguments)
        .write_stdin(lines.join("\n"))
        .output()
        .expect("the program starts");
    let replies = String::from_utf8(output.stdout).expect("replies are text");
    let replies = replies
        .lines()
        .map(|line| serde_json::from_str(line).expect("a reply is a JSON object"));
    (output.status.code(), replies.collect())
}

/// A configuration in `folder` that leaves holes of the final mesh open, so that its triangles are those of the last keyframe.
pub(crate) fn with_open_holes(folder: &Path) -> PathBuf {
    let path = folder.join("open-holes.toml");
    std::fs::write(&path, "[surface]\nholes = \"none\"\n").unwrap();
    path
}

/// A rendered sequence in a folder of its own.
pub(crate) fn small_sequence(frames: usize, layout: &str) -> TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("sequence");
    let frames = frames.to_string();
    expect_status(
        0,
        [
            "synth",
            "boxes",
            "--frames",
            &frames,
            "--size",
            "320x240",
            "--layout",
            layout,
            "--quiet",
            "--out",
            out.to_str().expect("temporary paths are UTF-8"),
        ],
    );
    folder
}

/// Reconstructs the mesh of a sequence, `mesh.ply` alone beside segments and report, with these further arguments.
pub(crate) fn reconstruct_mesh(status: i32, sequence: &Path, more: &[&str], out: &Path) {
    let fixed = [
        "--final-only",
        "--no-page",
        "--no-picture",
        "--format",
        "ply",
        "--quiet",
    ];
    let command = ["reconstruct", text(sequence), "--out", text(out)].into_iter();
    expect_status(status, command.chain(fixed).chain(more.iter().copied()));
}

/// Every file below a folder with its bytes, by relative path, but for the list of what was written, which is no result.
pub(crate) fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    fn walk(root: &Path, folder: &Path, into: &mut BTreeMap<PathBuf, Vec<u8>>) {
        for entry in std::fs::read_dir(folder).expect("a readable folder") {
            let path = entry.expect("a readable entry").path();
            if path.is_dir() {
                walk(root, &path, into);
            } else if path.file_name() != Some(".linecarve-files".as_ref()) {
                let name = path.strip_prefix(root).expect("below the root").to_owned();
                into.insert(name, std::fs::read(&path).expect("a readable file"));
            }
        }
    }
    let mut files = BTreeMap::new();
    walk(folder, folder, &mut files);
    files
}

/// Applies the changes in the replies of a session; returns the final number of triangles.
pub(crate) fn triangles_after(replies: &[serde_json::Value]) -> usize {
    let (mut vertices, mut triangles) = (0, 0);
    for reply in replies {
        assert_eq!(reply["type"], "surface", "{reply}");
        assert_eq!(reply["first_vertex"], vertices);
        let count = |key: &str| reply[key].as_array().expect("a list").len();
        vertices += count("vertices");
        triangles = triangles + count("added") - count("removed");
        assert_eq!(reply["triangles"], triangles);
    }
    triangles
}

/// Distorts the image of a pinhole camera by a radial coefficient.
pub(crate) fn distort(path: &Path, pinhole: &Camera, k1: f64) {
    let (fx, fy, cx, cy) = (pinhole.fx(), pinhole.fy(), pinhole.cx(), pinhole.cy());
    let lens = Camera::with_distortion(fx, fy, cx, cy, Distortion::radial(k1)).expect("a camera");
    let undistorted = image::open(path).expect("an image").into_rgb8();
    let (width, height) = undistorted.dimensions();
    let mut distorted = undistorted.clone();
    for (x, y, pixel) in distorted.enumerate_pixels_mut() {
        let direction = lens.unproject(&Point2::new(f64::from(x), f64::from(y)));
        let from = pinhole
            .project(&direction.expect("inside the model").into())
            .expect("in front");
        let [u, v] = [(from.x, width), (from.y, height)]
            .map(|(at, side)| at.clamp(0.0, f64::from(side) - 1.001));
        let [left, top] = [u as u32, v as u32];
        let [a, b] = [u.fract(), v.fract()];
        let at = |x: u32, y: u32, channel: usize| f64::from(undistorted.get_pixel(x, y)[channel]);
        for channel in 0..3 {
            let row = |y: u32| at(left, y, channel) * (1.0 - a) + at(left + 1, y, channel) * a;
            pixel[channel] = (row(top) * (1.0 - b) + row(top + 1) * b).round() as u8;
        }
    }
    distorted.save(path).expect("a writable folder");
}

/// A recording in the folder `LINECARVE_DATA`. Tests that use it are ignored by default.
pub(crate) fn data(name: &str) -> PathBuf {
    let root = std::env::var_os("LINECARVE_DATA")
        .expect("LINECARVE_DATA must name the folder of the recordings");
    let path = PathBuf::from(root).join(name);
    assert!(
        path.exists(),
        "{} does not exist; LINECARVE_DATA must name the folder of the recordings",
        path.display()
    );
    path
}

/// A path as text.
pub(crate) fn text(path: &Path) -> &str {
    path.to_str().expect("paths of the tests are UTF-8")
}

/// A COLMAP model without images: a relief of 12 x 9 points and four views that see all of them, shifted.
pub(crate) fn colmap_relief(folder: &Path, shift: [f64; 3]) {
    std::fs::create_dir_all(folder).unwrap();
    let points: Vec<[f64; 3]> = (0..108)
        .map(|i| (i % 12, i / 12))
        .map(|(i, j)| {
            let relief = 0.05 * f64::from((3 * i + 5 * j) % 7);
            [
                0.2 * f64::from(i) - 1.1,
                0.2 * f64::from(j) - 0.8,
                3.0 + relief,
            ]
        })
        .collect();
    let centers = [[-0.6, 0.0], [0.6, 0.1], [0.0, -0.5], [0.1, 0.5]];
    let mut images = String::new();
    for (view, [x, y]) in centers.iter().enumerate() {
        let number = view + 1;
        let center = [x + shift[0], y + shift[1], shift[2]].map(|c| -c);
        images += &format!(
            "{number} 1 0 0 0 {} {} {} 1 view{number}.png\n",
            center[0], center[1], center[2]
        );
        for (id, p) in points.iter().enumerate() {
            let pixel = [
                500.0 * (p[0] - x) / p[2] + 320.0,
                500.0 * (p[1] - y) / p[2] + 240.0,
            ];
            images += &format!("{} {} {} ", pixel[0], pixel[1], id + 1);
        }
        images.push('\n');
    }
    let mut lines = String::new();
    for (id, p) in points.iter().enumerate() {
        let [x, y, z]: [f64; 3] = std::array::from_fn(|k| p[k] + shift[k]);
        lines += &format!("{} {x} {y} {z} 200 120 40 0.1", id + 1);
        for view in 1..=centers.len() {
            lines += &format!(" {view} {id}");
        }
        lines.push('\n');
    }
    let camera = "1 PINHOLE 640 480 500 500 320 240\n";
    for (name, content) in [
        ("cameras.txt", camera),
        ("images.txt", &images),
        ("points3D.txt", &lines),
    ] {
        std::fs::write(folder.join(name), content).unwrap();
    }
}
