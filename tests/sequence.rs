//! Reading sequences: each layout, each kind of bad input, and whatever bytes a broken disk may bring.
// Helpers of tests stand outside of test functions, where the lints would otherwise apply.
#![allow(clippy::unwrap_used)]

mod support;

use std::path::Path;

use linecarve::sequence::{FrameError, InspectOptions, OpenOptions, Sequence, inspect};
use proptest::prelude::*;
use support::{poses, sidecar, write_open3d, write_seven_scenes, write_tum};

fn open(folder: &Path) -> Result<Sequence, String> {
    Sequence::open(folder, &OpenOptions::default()).map_err(|error| error.to_string())
}

fn folder_with(write: impl FnOnce(&Path)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    folder
}

fn warnings(sequence: &Sequence) -> String {
    sequence
        .warnings()
        .iter()
        .map(|w| format!("{w}\n"))
        .collect()
}

fn edit(path: &Path, change: impl FnOnce(String) -> String) {
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::write(path, change(text)).unwrap();
}

fn replace(path: &Path, from: &str, to: &str) {
    edit(path, |text| {
        assert!(text.contains(from), "{text}");
        text.replacen(from, to, 1)
    });
}

/// Line `number`, from 1, becomes `to`.
fn replace_line(path: &Path, number: usize, to: &str) {
    edit(path, |text| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines[number - 1] = to;
        lines.join("\n")
    });
}

type Writer = fn(&Path);
const LAYOUTS: [(&str, Writer); 3] = [
    ("7-scenes", |folder| write_seven_scenes(folder, 6)),
    ("tum-rgbd", |folder| write_tum(folder, 6)),
    ("open3d-log", |folder| write_open3d(folder, 11, 2)),
];

#[test]
fn every_layout_gives_the_same_sequence() {
    for (name, write) in LAYOUTS {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        assert_eq!(sequence.layout(), name);
        assert_eq!(sequence.frames().len(), 6, "{name}");
        assert_eq!(warnings(&sequence), "", "{name}");
        let step = if name == "open3d-log" { 2 } else { 1 };
        for (frame, pose) in sequence.frames().iter().zip(poses(11).iter().step_by(step)) {
            let difference = frame.world_from_camera.inverse() * pose;
            assert!(difference.translation.vector.norm() < 1e-6, "{name}");
            assert!(difference.rotation.angle() < 1e-6, "{name}");
        }
        assert!(
            sequence
                .frames()
                .windows(2)
                .all(|pair| pair[0].timestamp_ns < pair[1].timestamp_ns)
        );
        let depth = sequence.load_depth(2).unwrap().unwrap();
        // The back wall.
        let seen = depth.get(32, 24).copied().unwrap();
        assert!((2.6..3.0).contains(&seen), "{name}: {seen}");
        assert_eq!(sequence.load_gray(2).unwrap().width(), 64);
        assert_eq!(sequence.load_color(2).unwrap().dimensions(), (64, 48));
        // What the poses say agrees with what the images show; the inverse does not.
        let facts = inspect(
            &sequence,
            &InspectOptions {
                gaps: vec![3],
                ..InspectOptions::default()
            },
        )
        .unwrap();
        let found = &facts.consistency[0];
        assert!(found.as_read.median_relative < 0.002, "{name}: {found:?}");
        assert!(facts.warnings.is_empty(), "{:?}", facts.warnings);
    }
}

#[test]
fn inverse_poses_are_suspected() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 8));
    for (i, pose) in poses(8).iter().enumerate() {
        let matrix = pose.inverse().to_homogeneous();
        let text: String = (0..4)
            .map(|r| format!("{:?}\n", matrix.row(r).iter().collect::<Vec<_>>()))
            .collect();
        let text = text.replace(['[', ']', ','], " ");
        std::fs::write(folder.path().join(format!("frame-{i:06}.pose.txt")), text).unwrap();
    }
    let sequence = open(folder.path()).unwrap();
    let facts = inspect(
        &sequence,
        &InspectOptions {
            gaps: vec![5],
            ..InspectOptions::default()
        },
    )
    .unwrap();
    assert!(
        facts
            .warnings
            .iter()
            .any(|w| w.what.contains("inverse poses (camera from world)")),
        "{facts:#?}"
    );
}

#[test]
fn a_wrong_depth_scale_is_suspected() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 8));
    std::fs::write(
        folder.path().join("linecarve.toml"),
        "[depth]\nscale = 5000.0\n",
    )
    .unwrap();
    let sequence = open(folder.path()).unwrap();
    let facts = inspect(
        &sequence,
        &InspectOptions {
            gaps: vec![2],
            ..InspectOptions::default()
        },
    )
    .unwrap();
    assert!(
        facts
            .warnings
            .iter()
            .any(|w| w.what.contains("scale of 1000 instead of 5000")),
        "{facts:#?}"
    );
}

#[test]
fn folders_that_hold_no_sequence_have_a_message_each() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| open(path).unwrap_err();
    assert!(message(&folder.path().join("nowhere")).contains("there is no folder"));
    assert!(message(folder.path()).contains("is empty"));
    std::fs::write(folder.path().join("notes.md"), "x").unwrap();
    assert!(message(&folder.path().join("notes.md")).contains("is a file"));
    let unknown = message(folder.path());
    for part in ["notes.md", "frame-NNNNNN", "rgb.txt", "trajectory.log"] {
        assert!(unknown.contains(part), "{unknown}");
    }
    let inside = folder.path().join("seq-01");
    std::fs::create_dir(&inside).unwrap();
    write_seven_scenes(&inside, 1);
    let hint = message(folder.path());
    assert!(hint.contains("seq-01 is a sequence (7-scenes)"), "{hint}");
}

#[test]
fn one_frame_is_a_sequence() {
    for write in [
        |f: &Path| write_seven_scenes(f, 1),
        |f: &Path| write_tum(f, 1),
        |f: &Path| write_open3d(f, 1, 1),
    ] {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap();
        assert_eq!(sequence.frames().len(), 1);
        let facts = inspect(&sequence, &InspectOptions::default()).unwrap();
        assert!(facts.consistency.is_empty());
        assert_eq!(facts.motion.path_length, 0.0);
    }
}

#[test]
fn poses_that_are_not_finite_are_left_out_and_counted() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 5));
    for i in [1, 3] {
        let path = folder.path().join(format!("frame-00000{i}.pose.txt"));
        replace_line(&path, 1, if i == 1 { "nan 0 0 0" } else { "1 0 0 -1.#IND" });
    }
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 3);
    assert!(
        warnings(&sequence)
            .contains("2 of 5 poses are not finite and were left out: frame-000001, frame-000003"),
        "{}",
        warnings(&sequence)
    );

    let folder = folder_with(|folder| write_tum(folder, 5));
    replace_line(
        &folder.path().join("groundtruth.txt"),
        3,
        "1305031103.171100 nan nan nan nan nan nan nan",
    );
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 4);
    assert!(
        warnings(&sequence).contains("1 of 5 poses are not finite"),
        "{}",
        warnings(&sequence)
    );

    let folder = folder_with(|folder| write_open3d(folder, 5, 1));
    replace_line(&folder.path().join("trajectory.log"), 12, "inf 0 0 0");
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 4);
    assert!(warnings(&sequence).contains("poses are not finite and were left out: 00002"));
}

#[test]
fn no_finite_pose_at_all_is_an_error() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 2));
    for i in 0..2 {
        replace_line(
            &folder.path().join(format!("frame-00000{i}.pose.txt")),
            2,
            "0 nan 0 0",
        );
    }
    let message = open(folder.path()).unwrap_err();
    assert!(
        message.contains("no frame is left") && message.contains("2 a pose that is not finite"),
        "{message}"
    );
}

#[test]
fn malformed_lines_are_named() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 2));
    let pose = folder.path().join("frame-000001.pose.txt");
    for (text, message) in [
        (
            "1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n",
            "line 2: 4 numbers expected, 3 found",
        ),
        (
            "1 0 0 0\n0 1 0 0\n0 0 x 0\n0 0 0 1\n",
            "line 3: 'x' is not a number",
        ),
        ("1 0 0 0\n0 1 0 0\n", "2 rows found"),
        ("", "0 rows found"),
        (
            "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n0 0 0 1\n",
            "line 5: a matrix of 4 rows expected",
        ),
    ] {
        std::fs::write(&pose, text).unwrap();
        let found = open(folder.path()).unwrap_err();
        assert!(
            found.contains("frame-000001.pose.txt") && found.contains(message),
            "{found}"
        );
    }

    let folder = folder_with(|folder| write_tum(folder, 3));
    replace_line(
        &folder.path().join("groundtruth.txt"),
        3,
        "1305031103.17 1 2 3",
    );
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("groundtruth.txt, line 3: 8 numbers expected, 4 found")
    );

    let folder = folder_with(|folder| write_open3d(folder, 3, 1));
    replace_line(&folder.path().join("trajectory.log"), 6, "1 one 2 3");
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("trajectory.log, line 6: the head of entry 1")
    );
    let folder = folder_with(|folder| write_open3d(folder, 3, 1));
    edit(&folder.path().join("trajectory.log"), |text| {
        text.lines().take(13).collect::<Vec<_>>().join("\n")
    });
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("line 11: the matrix of this entry has 2 rows")
    );
}

#[test]
fn frames_without_image_pose_or_depth_are_counted() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 6));
    for name in [
        "frame-000001.color.png",
        "frame-000002.pose.txt",
        "frame-000004.depth.png",
    ] {
        std::fs::remove_file(folder.path().join(name)).unwrap();
    }
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 4);
    let text = warnings(&sequence);
    assert!(
        text.contains("1 of 6 frames have no colour image and were left out: frame-000001"),
        "{text}"
    );
    assert!(
        text.contains("1 of 6 frames have no pose and were left out: frame-000002"),
        "{text}"
    );
    assert!(
        text.contains("1 of 4 frames have no depth image: frame-000004"),
        "{text}"
    );
    let without = sequence
        .frames()
        .iter()
        .position(|f| f.depth.is_none())
        .unwrap();
    assert!(sequence.load_depth(without).unwrap().is_none());
}

#[test]
fn a_sequence_without_any_depth_says_so() {
    let folder = folder_with(|folder| write_tum(folder, 3));
    std::fs::remove_file(folder.path().join("depth.txt")).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.depth_calibration().is_none());
    assert_eq!(warnings(&sequence), "");
}

#[test]
fn a_truncated_image_concerns_its_frame_only() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 3));
    for (name, keep) in [
        ("frame-000000.color.png", 20),
        ("frame-000001.depth.png", 60),
        ("frame-000002.color.png", 0),
    ] {
        let path = folder.path().join(name);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..keep]).unwrap();
    }
    let sequence = open(folder.path()).unwrap();
    for error in [
        sequence.load_gray(0).unwrap_err(),
        sequence.load_depth(1).unwrap_err(),
        sequence.load_color(2).unwrap_err(),
    ] {
        assert!(error.is_limited_to_frame());
        assert!(error.to_string().contains("cannot be decoded"), "{error}");
    }
    assert!(sequence.load_gray(1).is_ok());
    std::fs::remove_file(folder.path().join("frame-000001.color.png")).unwrap();
    assert!(matches!(
        sequence.load_gray(1),
        Err(FrameError::Unreadable { .. })
    ));
    let facts = inspect(&sequence, &InspectOptions::default()).unwrap();
    assert!(facts.images.is_none());
    assert_eq!(facts.depth.unwrap().undecodable, 1);
}

#[test]
fn when_no_image_can_be_read_there_is_no_sequence() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 2));
    for i in 0..2 {
        std::fs::write(
            folder.path().join(format!("frame-00000{i}.color.png")),
            "no image",
        )
        .unwrap();
    }
    let message = open(folder.path()).unwrap_err();
    assert!(
        message.contains("not one of 2 colour images can be read"),
        "{message}"
    );
}

#[test]
fn sizes_that_do_not_fit_name_file_sizes_and_remedy() {
    let small = image::GrayImage::new(32, 24);
    let small_depth =
        image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(32, 24, image::Luma([900]));

    // Registered depth of another size: no other frame would mend that.
    let folder = folder_with(|folder| write_seven_scenes(folder, 2));
    small_depth
        .save(folder.path().join("frame-000000.depth.png"))
        .unwrap();
    let message = open(folder.path()).unwrap_err();
    for part in [
        "frame-000000.depth.png",
        "32 x 24",
        "64 x 48",
        "[depth] section",
    ] {
        assert!(message.contains(part), "{message}");
    }
    // With a depth camera of its own the size is free, but one for all.
    let camera = "[depth]\nfx = 30.0\nfy = 30.0\ncx = 15.5\ncy = 11.5\n";
    std::fs::write(folder.path().join("linecarve.toml"), camera).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.load_depth(0).unwrap().unwrap().width(), 32);
    let error = sequence.load_depth(1).unwrap_err();
    assert!(
        !error.is_limited_to_frame() && error.to_string().contains("frame-000001.depth.png"),
        "{error}"
    );

    // One colour image differs from the first.
    let folder = folder_with(|folder| write_seven_scenes(folder, 2));
    small
        .save(folder.path().join("frame-000001.color.png"))
        .unwrap();
    let error = open(folder.path()).unwrap().load_gray(1).unwrap_err();
    assert!(
        !error.is_limited_to_frame() && error.to_string().contains("32 x 24, expected 64 x 48"),
        "{error}"
    );

    // The calibration is for another size.
    let folder = folder_with(|folder| write_open3d(folder, 2, 1));
    replace(
        &folder.path().join("camera_primesense.json"),
        "\"width\": 64",
        "\"width\": 640",
    );
    let message = open(folder.path()).unwrap_err();
    assert!(
        message.contains("expected 640 x 48 (by camera_primesense.json)"),
        "{message}"
    );

    // The default of the layout is for another size, and tells so.
    let folder = folder_with(|folder| write_tum(folder, 2));
    std::fs::remove_file(folder.path().join("linecarve.toml")).unwrap();
    let message = open(folder.path()).unwrap_err();
    assert!(
        message.contains("640 x 480") && message.contains("linecarve.toml"),
        "{message}"
    );

    // A principal point outside of the image.
    let folder = folder_with(|folder| write_seven_scenes(folder, 1));
    std::fs::write(
        folder.path().join("camera-intrinsics.txt"),
        "585 0 320\n0 585 240\n0 0 1\n",
    )
    .unwrap();
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("principal point (320, 240)")
    );
}

#[test]
fn depth_of_eight_bits_is_refused() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 1));
    image::GrayImage::new(64, 48)
        .save(folder.path().join("frame-000000.depth.png"))
        .unwrap();
    let error = open(folder.path()).unwrap().load_depth(0).unwrap_err();
    assert!(!error.is_limited_to_frame());
    assert!(
        error.to_string().contains("1 channel(s) of 8 bits"),
        "{error}"
    );
}

#[test]
fn zero_and_65535_are_unknown_and_pgm_is_read() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 1));
    std::fs::remove_file(folder.path().join("frame-000000.depth.png")).unwrap();
    let mut bytes = b"P5\n64 48\n65535\n".to_vec();
    for i in 0..64 * 48 {
        let value: u16 = [0, 65535, 1234, 65534][i % 4];
        bytes.extend(value.to_be_bytes());
    }
    std::fs::write(folder.path().join("frame-000000.depth.pgm"), bytes).unwrap();
    let depth = open(folder.path()).unwrap().load_depth(0).unwrap().unwrap();
    assert_eq!(depth.samples()[..4], [0.0, 0.0, 1.234, 65.534]);
}

#[test]
fn a_sidecar_moves_poses_of_the_depth_camera_to_the_colour_camera() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 2));
    let text = format!(
        "{}[depth]\nfx = 60.0\nfy = 60.0\ncx = 31.5\ncy = 23.5\ncolor_from_depth = \
         [[1.0, 0.0, 0.0, -0.03], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]\n\
         [poses]\ncamera = \"depth\"\n",
        sidecar()
    );
    let elsewhere = folder.path().join("elsewhere.toml");
    std::fs::write(&elsewhere, text).unwrap();
    let options = OpenOptions {
        calibration: Some(elsewhere.clone()),
    };
    let sequence = Sequence::open(folder.path(), &options).unwrap();
    let offset = poses(1)[0].inverse() * sequence.frames()[0].world_from_camera;
    assert!((offset.translation.vector - nalgebra::Vector3::new(0.03, 0.0, 0.0)).norm() < 1e-9);
    assert!(!sequence.depth_calibration().unwrap().registered);

    replace(&elsewhere, "fx = 60.0", "fx = 60.0\nspeed = 1");
    let message = Sequence::open(folder.path(), &options)
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("elsewhere.toml") && message.contains("speed"),
        "{message}"
    );
    let missing = OpenOptions {
        calibration: Some(folder.path().join("missing.toml")),
    };
    assert!(
        Sequence::open(folder.path(), &missing)
            .unwrap_err()
            .to_string()
            .contains("missing.toml")
    );
}

#[test]
fn lens_distortion_is_removed_on_loading() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 1));
    let text = format!(
        "{}distortion = [-0.2, 0.0, 0.0, 0.0]\nmodel = \"radial-tangential\"\n",
        sidecar()
    );
    std::fs::write(folder.path().join("linecarve.toml"), text).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.color_camera().is_pinhole());
    assert!(!sequence.stored_color_camera().is_pinhole());
    let depth = sequence.depth_calibration().unwrap();
    assert_eq!(depth.camera, *sequence.color_camera());
    let (gray, color) = (
        sequence.load_gray(0).unwrap(),
        sequence.load_color(0).unwrap(),
    );
    assert_eq!((gray.width(), gray.height()), (64, 48));
    assert!(
        gray.samples()
            .iter()
            .zip(color.pixels())
            .all(|(g, c)| c.0 == [*g; 3])
    );
    assert!(
        sequence
            .load_depth(0)
            .unwrap()
            .unwrap()
            .samples()
            .iter()
            .all(|&z| z > 0.0)
    );
}

#[test]
fn tum_files_of_many_hands_are_read() {
    let folder = folder_with(|folder| write_tum(folder, 4));
    let path = |name: &str| folder.path().join(name);
    // A byte order mark, a head line without #, commas, CRLF, scientific notation, a repeated stamp, no order.
    edit(&path("groundtruth.txt"), |text| {
        let mut lines: Vec<String> = text
            .lines()
            .skip(1)
            .map(|line| line.replace(' ', ", "))
            .collect();
        lines.reverse();
        lines.push(lines[0].clone());
        lines[1] = lines[1].replace("1305031104.171100", "1.3050311041711e9");
        format!(
            "\u{feff}timestamp, tx, ty, tz, qx, qy, qz, qw\r\n{}\r\n",
            lines.join("\r\n")
        )
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 4);
    let text = warnings(&sequence);
    assert!(
        text.contains("1 of 5 time stamps in groundtruth.txt stand there before"),
        "{text}"
    );
    assert!(text.contains("do not ascend"), "{text}");
    assert_eq!(sequence.frames()[2].timestamp_ns, 1_305_031_104_175_304_000);
    for (frame, pose) in sequence.frames().iter().zip(poses(4)) {
        assert!(
            (frame.world_from_camera.translation.vector - pose.translation.vector).norm() < 1e-6
        );
    }

    // Images without a pose near in time are left out, and files that are not there.
    edit(&path("rgb.txt"), |text| {
        text.replace("1305031103.175304 rgb", "1305031103.775304 rgb")
    });
    std::fs::remove_file(path("rgb/1305031105.175304.png")).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 2);
    let text = warnings(&sequence);
    assert!(
        text.contains("1 of 3 images have no pose within 0.02 s"),
        "{text}"
    );
    assert!(
        text.contains("1 of 4 files that rgb.txt lists do not exist"),
        "{text}"
    );

    std::fs::remove_file(path("groundtruth.txt")).unwrap();
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("groundtruth.txt: is missing")
    );
}

#[test]
fn utf16_poses_are_read() {
    let folder = folder_with(|folder| write_tum(folder, 2));
    let path = folder.path().join("groundtruth.txt");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut bytes = vec![0xFF, 0xFE];
    bytes.extend(text.encode_utf16().flat_map(u16::to_le_bytes));
    std::fs::write(&path, bytes).unwrap();
    assert_eq!(open(folder.path()).unwrap().frames().len(), 2);
}

#[test]
fn open3d_images_and_trajectory_are_joined_by_number_or_by_order() {
    let folder = folder_with(|folder| write_open3d(folder, 4, 1));
    let log = folder.path().join("trajectory.log");
    // Images 0..3, entries 1..4: numbers do not fit, counts do.
    edit(&log, |text| {
        let numbered = |(i, line): (usize, &str)| match i % 5 {
            0 => format!("{0} {0} {1}", i / 5 + 1, i / 5 + 2),
            _ => line.to_owned(),
        };
        text.lines()
            .enumerate()
            .map(numbered)
            .collect::<Vec<_>>()
            .join("\n")
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 4);
    assert!(warnings(&sequence).contains("joined in order"));
    assert!((sequence.frames()[3].world_from_camera.translation.vector.x - 0.3).abs() < 1e-6);

    // One entry fewer: numbers decide, and the image without one is counted.
    edit(&log, |text| {
        text.lines().take(15).collect::<Vec<_>>().join("\n")
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 3);
    assert!(warnings(&sequence).contains("1 of 4 images have no entry in the trajectory"));
}

#[test]
fn open3d_cameras_that_contradict_are_refused() {
    let folder = folder_with(|folder| write_open3d(folder, 1, 1));
    let camera = folder.path().join("camera_primesense.json");
    let text = std::fs::read_to_string(&camera).unwrap();
    std::fs::write(
        folder.path().join("camera_other.json"),
        text.replace("60", "61"),
    )
    .unwrap();
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("are different cameras")
    );
    std::fs::remove_file(folder.path().join("camera_other.json")).unwrap();
    std::fs::write(&camera, text.replace("60, 0, 0", "60, 1, 0")).unwrap();
    assert!(open(folder.path()).unwrap_err().contains("no skew"));
    std::fs::write(&camera, &text[..40]).unwrap();
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("is not an Open3D camera")
    );
}

/// Small text files of a sequence, one of which is damaged.
fn text_files(layout: usize) -> &'static [&'static str] {
    [
        &["frame-000001.pose.txt", "camera-intrinsics.txt"][..],
        &["rgb.txt", "depth.txt", "groundtruth.txt", "linecarve.toml"],
        &["trajectory.log", "camera_primesense.json"],
    ][layout]
}

fn damage(bytes: &mut Vec<u8>, kind: u8, at: &prop::sample::Index, with: &[u8]) {
    let at = at.index(bytes.len().max(1)).min(bytes.len());
    match kind {
        0 => bytes.truncate(at),
        1 => bytes.splice(at..at, with.iter().copied()).for_each(drop),
        2 => {
            for (slot, value) in bytes[at..].iter_mut().zip(with) {
                *slot = *value;
            }
        }
        3 => {
            // A number becomes what is none or far too large.
            let number = [
                &b"nan"[..],
                b"-inf",
                b"1e999",
                b"99999999999999999999",
                b"-0",
            ][with.len() % 5];
            bytes.splice(at..at, number.iter().copied()).for_each(drop);
        }
        _ => {
            let copy = bytes.clone();
            bytes.extend(copy);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn any_damage_to_text_files_is_read_or_refused(
        layout in 0_usize..3,
        file in any::<prop::sample::Index>(),
        hits in prop::collection::vec(
            (0_u8..5, any::<prop::sample::Index>(), prop::collection::vec(any::<u8>(), 0..12)),
            1..4,
        ),
    ) {
        let folder = folder_with(LAYOUTS[layout].1);
        let path = folder.path().join(file.get(text_files(layout)));
        let mut bytes = std::fs::read(&path).unwrap();
        for (kind, at, with) in &hits {
            damage(&mut bytes, *kind, at, with);
        }
        std::fs::write(&path, bytes).unwrap();
        match open(folder.path()) {
            Ok(sequence) => {
                prop_assert!(!sequence.frames().is_empty());
                for frame in sequence.frames() {
                    let finite = frame.world_from_camera.to_homogeneous().iter().all(|v| v.is_finite());
                    prop_assert!(finite);
                }
                let _ = sequence.load_gray(0);
                let _ = sequence.load_depth(0);
            }
            // A message says where.
            Err(message) => prop_assert!(message.contains(&*folder.path().to_string_lossy()), "{message}"),
        }
    }

    #[test]
    fn any_damage_to_images_is_decoded_or_refused(
        kind in 0_u8..3,
        at in any::<prop::sample::Index>(),
        with in prop::collection::vec(any::<u8>(), 1..12),
        is_depth in any::<bool>(),
    ) {
        let folder = folder_with(|folder| write_seven_scenes(folder, 1));
        let name = if is_depth { "frame-000000.depth.png" } else { "frame-000000.color.png" };
        let path = folder.path().join(name);
        let mut bytes = std::fs::read(&path).unwrap();
        damage(&mut bytes, kind, &at, &with);
        std::fs::write(&path, bytes).unwrap();
        if let Ok(sequence) = open(folder.path()) {
            let _ = sequence.load_gray(0);
            let _ = sequence.load_color(0);
            let _ = sequence.load_depth(0);
            let _ = inspect(&sequence, &InspectOptions::default());
        }
    }
}
