//! The same recording in the layouts of phones and models: the same surface, or nearly so where the files lose digits.

use std::path::{Path, PathBuf};

use tempfile::TempDir;

use crate::program::{expect_status, linecarve, reconstruct_mesh, small_sequence, stderr, text};

const FRAMES: usize = 8;

/// A written recording, and the mesh of it.
struct Written {
    folder: TempDir,
}

impl Written {
    fn of(sequence: &Path, layout: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("recording");
        expect_status(
            0,
            [
                "convert",
                text(sequence),
                "--to",
                layout,
                "--out",
                text(&out),
            ],
        );
        Self { folder }
    }

    fn recording(&self) -> PathBuf {
        self.folder.path().join("recording")
    }

    fn mesh(&self, more: &[&str]) -> PathBuf {
        mesh_of(&self.recording(), self.folder.path(), more)
    }
}

fn mesh_of(sequence: &Path, folder: &Path, more: &[&str]) -> PathBuf {
    let out = folder.join("out");
    reconstruct_mesh(0, sequence, &[&["--every", "1"], more].concat(), &out);
    out.join("mesh.ply")
}

/// F at 1 cm of one mesh against another.
fn f_score(mesh: &Path, other: &Path) -> f64 {
    let arguments = [
        "evaluate",
        text(mesh),
        "--ground-truth",
        text(other),
        "--thresholds",
        "0.01",
        "--samples",
        "20000",
        "--json",
    ];
    let output = expect_status(0, arguments);
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    found["at"][0]["f"].as_f64().unwrap()
}

#[test]
fn each_layout_gives_the_surface_of_the_recording() {
    let source = small_sequence(FRAMES, "7-scenes");
    let sequence = source.path().join("sequence");
    let own = mesh_of(&sequence, source.path(), &[]);
    // Integer depth in millimetres, as in the source.
    for layout in [
        "stray-scanner",
        "polycam",
        "scannet",
        "arkit-scenes",
        "replica",
    ] {
        let written = Written::of(&sequence, layout);
        let f = f_score(&written.mesh(&[]), &own);
        assert!(f > 0.998, "{layout}: {f}");
    }
    // Floating-point depth, which has no steps: the same in each file format.
    let floats = Written::of(&sequence, "pfm");
    let expected = floats.mesh(&[]);
    for layout in ["exr", "record3d"] {
        let written = Written::of(&sequence, layout);
        let [ours, theirs] =
            [&written.mesh(&[]), &expected].map(|path| std::fs::read(path).unwrap());
        assert!(ours == theirs, "{layout}");
    }
    // Poses as matrices: rounded in the last digit.
    for layout in ["depth-anything-3", "colmap-dense", "mvsnet"] {
        let written = Written::of(&sequence, layout);
        let f = f_score(&written.mesh(&[]), &expected);
        assert!(f > 0.998, "{layout}: {f}");
    }
}

/// The pictures of a folder as an uncompressed video, in grey.
fn video_of(pictures: &Path) -> Vec<u8> {
    let mut names: Vec<PathBuf> = std::fs::read_dir(pictures)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    names.sort();
    let mut bytes = b"YUV4MPEG2 W320 H240 F10:1 Cmono XCOLORRANGE=FULL\n".to_vec();
    for name in names {
        bytes.extend(b"FRAME\n");
        bytes.extend(image::open(name).unwrap().into_luma8().into_raw());
    }
    bytes
}

#[test]
fn the_video_of_a_recording_is_unpacked_beside_the_results() {
    let source = small_sequence(FRAMES, "7-scenes");
    let written = Written::of(&source.path().join("sequence"), "stray-scanner");
    let expected = written.mesh(&[]);
    let scan = written.recording();
    let video = video_of(&scan.join("rgb"));
    std::fs::write(scan.join("rgb.mp4"), video).unwrap();
    std::fs::remove_dir_all(scan.join("rgb")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mesh = mesh_of(&scan, folder.path(), &[]);
    let f = f_score(&mesh, &expected);
    assert!(f > 0.9, "{f}");
    let pictures = std::fs::read_dir(folder.path().join("out/video/images")).unwrap();
    assert_eq!(pictures.count(), FRAMES);
    // A temporary folder for `info`, and a remedy where there is none.
    let output = expect_status(0, ["info", text(&scan)]);
    let shown = String::from_utf8_lossy(&output.stdout);
    assert!(shown.contains("stray-scanner"), "{shown}");
    assert!(shown.contains("y down, z forward"), "{shown}");
    let out = folder.path().join("lines");
    let output = linecarve(["lines", text(&scan), "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("rgb.mp4"), "{}", stderr(&output));
    let tracked = folder.path().join("tracked");
    expect_status(0, ["track", text(&scan), "--out", text(&tracked)]);
}

#[test]
fn damaged_archives_end_with_a_remedy() {
    let source = small_sequence(FRAMES, "7-scenes");
    for (layout, file) in [
        ("record3d", "recording.r3d"),
        ("depth-anything-3", "results.npz"),
    ] {
        let written = Written::of(&source.path().join("sequence"), layout);
        let path = written.recording().join(file);
        let output = expect_status(0, ["info", text(&path)]);
        let shown = String::from_utf8_lossy(&output.stdout);
        assert!(shown.contains(layout) && shown.contains("axes"), "{shown}");
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        let out = written.folder.path().join("damaged");
        let output = linecarve(["reconstruct", text(&path), "--out", text(&out)]);
        assert_eq!(output.status.code(), Some(2));
        let said = stderr(&output);
        assert!(
            said.contains(file) && said.contains("copy it again"),
            "{said}"
        );
    }
}

#[test]
fn a_recording_is_not_written_without_depth_or_over_files() {
    let source = small_sequence(FRAMES, "tum");
    let sequence = source.path().join("sequence");
    let output = linecarve([
        "convert",
        text(&sequence),
        "--to",
        "record3d",
        "--out",
        text(source.path()),
    ]);
    assert_eq!(output.status.code(), Some(2));
    let taken = tempfile::tempdir().unwrap();
    std::fs::write(taken.path().join("x"), "x").unwrap();
    let output = linecarve([
        "convert",
        text(&sequence),
        "--to",
        "polycam",
        "--out",
        text(taken.path()),
    ]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("not empty"), "{}", stderr(&output));
    std::fs::remove_dir_all(sequence.join("depth")).unwrap();
    let out = source.path().join("out");
    let output = linecarve([
        "convert",
        text(&sequence),
        "--to",
        "polycam",
        "--out",
        text(&out),
    ]);
    assert_eq!(output.status.code(), Some(2));
    assert!(
        stderr(&output).contains("no depth images"),
        "{}",
        stderr(&output)
    );
}

/// Poses that are off are corrected from the depth images, and are no other convention.
#[test]
fn noise_of_poses_is_corrected_and_no_contradiction() {
    let folder = tempfile::tempdir().unwrap();
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let truth = room.join("ground-truth-observed.ply");
    let disturbed = folder.path().join("disturbed");
    expect_status(
        0,
        [
            "convert",
            text(&room),
            "--to",
            "scannet",
            "--error-position",
            "0.02",
            "--error-rotation",
            "1",
            "--out",
            text(&disturbed),
        ],
    );
    let whole = f_score(&mesh_of(&room, folder.path(), &[]), &truth);
    let other = tempfile::tempdir().unwrap();
    let corrected = f_score(&mesh_of(&disturbed, other.path(), &[]), &truth);
    assert!(corrected > whole - 0.05, "{corrected} of {whole}");
}
