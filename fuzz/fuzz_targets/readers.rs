//! Any bytes as any file that a reader reads: a sequence, or an error that names the place. The first byte chooses the
//! file, the rest is what stands in it; the other files of its layout are well.
//!
//! `cargo +nightly fuzz run readers -- -rss_limit_mb=1024` in the folder above; with a stable toolchain
//! `RUSTC_BOOTSTRAP=1 cargo fuzz run readers`.

#![no_main]

use std::path::Path;
use std::sync::OnceLock;

use libfuzzer_sys::fuzz_target;
use linecarve::sequence::{OpenOptions, Sequence};
use tempfile::TempDir;

/// A grey image of 2 x 2 pixels.
const IMAGE: &[u8] = b"P5 2 2 255\n\x10\x20\x30\x40";

/// Two frames of each layout: the file that is replaced, then the others.
const FILES: [(&str, &[(&str, &str)]); 22] = [
    ("frame-000000.pose.txt", &[("frame-000000.color.pgm", "")]),
    (
        "camera-intrinsics.txt",
        &[("frame-000000.color.pgm", ""), ("frame-000000.pose.txt", "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1")],
    ),
    ("rgb.txt", &[("rgb/1.pgm", ""), ("groundtruth.txt", "1.0 0 0 0 0 0 0 1")]),
    ("groundtruth.txt", &[("rgb/1.pgm", ""), ("rgb.txt", "1.0 rgb/1.pgm")]),
    ("trajectory.log", &[("image/0.pgm", ""), ("image/1.pgm", "")]),
    (
        "camera.json",
        &[("image/0.pgm", ""), ("trajectory.log", "0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n")],
    ),
    ("cameras.txt", &[("a.pgm", ""), ("images.txt", "1 1 0 0 0 0 0 0 1 a.pgm\n\n")]),
    (
        "images.txt",
        &[("a.pgm", ""), ("cameras.txt", "1 PINHOLE 2 2 2 2 1 1"), ("points3D.txt", "1 0 0 1 1 2 3 0 1 0")],
    ),
    (
        "points3D.txt",
        &[("a.pgm", ""), ("cameras.txt", "1 PINHOLE 2 2 2 2 1 1"), ("images.txt", "1 1 0 0 0 0 0 0 1 a.pgm\n1 1 1\n")],
    ),
    ("cameras.bin", &[("a.pgm", ""), ("images.bin", "\0\0\0\0\0\0\0\0")]),
    ("images.bin", &[("a.pgm", ""), ("cameras.bin", "\0\0\0\0\0\0\0\0")]),
    (
        "points3D.bin",
        &[("cameras.bin", "\0\0\0\0\0\0\0\0"), ("images.bin", "\0\0\0\0\0\0\0\0")],
    ),
    ("model.nvm", &[("a.pgm", "")]),
    ("scene.mvs", &[("images/a.pgm", "")]),
    ("transforms.json", &[("a.pgm", "")]),
    ("map.msg", &[("images/1.000000.pgm", "")]),
    ("KeyFrameTrajectory.txt", &[("rgb/1.000000.pgm", ""), ("linecarve.toml", CAMERA)]),
    (
        "settings.yaml",
        &[("rgb/1.000000.pgm", ""), ("KeyFrameTrajectory.txt", "1.0 0 0 0 0 0 0 1")],
    ),
    (
        "MapPoints.txt",
        &[("rgb/1.000000.pgm", ""), ("KeyFrameTrajectory.txt", "1.0 0 0 0 0 0 0 1"), ("linecarve.toml", CAMERA)],
    ),
    ("mav0/cam0/sensor.yaml", &[("mav0/cam0/data/1403715274312143104.pgm", "")]),
    (
        "mav0/cam0/data.csv",
        &[
            ("mav0/cam0/data/1403715274312143104.pgm", ""),
            ("mav0/cam0/sensor.yaml", "intrinsics: [2.0, 2.0, 0.5, 0.5]\n"),
            ("mav0/vicon0/data.csv", "1403715274312143104,0,0,0,1,0,0,0\n"),
        ],
    ),
    (
        "linecarve.toml",
        &[("color/1.pgm", ""), ("pose.txt", "0 0 0 0 0 0 1")],
    ),
];

const CAMERA: &str = "[color]\nfx = 2.0\nfy = 2.0\ncx = 0.5\ncy = 0.5\n";

/// A folder for each entry of [`FILES`], made once.
fn folders() -> &'static [TempDir] {
    static FOLDERS: OnceLock<Vec<TempDir>> = OnceLock::new();
    FOLDERS.get_or_init(|| {
        FILES
            .iter()
            .map(|(_, others)| {
                let folder = tempfile::tempdir().expect("a temporary folder");
                for (name, text) in *others {
                    let bytes = if name.ends_with(".pgm") { IMAGE } else { text.as_bytes() };
                    write(&folder.path().join(name), bytes);
                }
                folder
            })
            .collect()
    })
}

fn write(path: &Path, bytes: &[u8]) {
    let parent = path.parent().expect("inside the folder");
    std::fs::create_dir_all(parent).expect("a folder");
    std::fs::write(path, bytes).expect("a file");
}

fuzz_target!(|data: &[u8]| {
    let Some((&which, bytes)) = data.split_first() else {
        return;
    };
    let which = usize::from(which) % FILES.len();
    let folder = folders()[which].path();
    write(&folder.join(FILES[which].0), bytes);
    match Sequence::open(folder, &OpenOptions::default()) {
        Ok(sequence) => {
            for (index, frame) in sequence.frames().iter().enumerate() {
                let pose = frame.world_from_camera.to_homogeneous();
                assert!(pose.iter().all(|value| value.is_finite()));
                let _ = sequence.load_gray(index);
            }
            if let Some(model) = sequence.map_points() {
                for point in &model.points {
                    assert!(point.point_in_world.iter().all(|value| value.is_finite()));
                    assert!(point.sightings.iter().all(|s| (s.view as usize) < model.views.len()));
                }
            }
        }
        Err(error) => {
            let message = error.to_string();
            assert!(message.contains(&*folder.to_string_lossy()), "{message}");
        }
    }
});
