//! The layouts with depth, read from intact files.

use std::path::Path;

use linecarve_sequence::{InspectOptions, OpenOptions, Sequence, inspect};

use super::support::{poses, sidecar, write_open3d, write_seven_scenes, write_tum};
use super::{LAYOUTS, edit, folder_with, open, replace, warnings};

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
        // Depth is consistent under the poses as read.
        let facts = inspect(&sequence, &{
            let mut options = InspectOptions::default();
            options.gaps = vec![3];
            options
        })
        .unwrap();
        let found = &facts.consistency[0];
        assert!(found.as_read.median_relative < 0.002, "{name}: {found:?}");
        assert!(facts.warnings.is_empty(), "{:?}", facts.warnings);
    }
}

#[test]
fn inverse_poses_are_reported() {
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
    let facts = inspect(&sequence, &{
        let mut options = InspectOptions::default();
        options.gaps = vec![5];
        options
    })
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
fn a_wrong_depth_scale_is_reported() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 8));
    std::fs::write(
        folder.path().join("linecarve.toml"),
        "[depth]\nscale = 5000.0\n",
    )
    .unwrap();
    let sequence = open(folder.path()).unwrap();
    let facts = inspect(&sequence, &{
        let mut options = InspectOptions::default();
        options.gaps = vec![2];
        options
    })
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
        assert_eq!(facts.motion.unwrap().path_length, 0.0);
    }
}

#[test]
fn depth_is_optional() {
    let folder = folder_with(|folder| write_tum(folder, 3));
    std::fs::remove_file(folder.path().join("depth.txt")).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.depth_calibration().is_none());
    assert_eq!(warnings(&sequence), "");
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
    let mut options = OpenOptions::default();
    options.calibration = Some(elsewhere.clone());
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
    let mut missing = OpenOptions::default();
    missing.calibration = Some(folder.path().join("missing.toml"));
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
fn tum_files_in_unusual_formats_are_read() {
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
        text.contains("1 of 5 time stamps in groundtruth.txt are repeated"),
        "{text}"
    );
    assert!(text.contains("do not ascend"), "{text}");
    assert_eq!(sequence.frames()[2].timestamp_ns, 1_305_031_104_175_304_000);
    for (frame, pose) in sequence.frames().iter().zip(poses(4)) {
        assert!(
            (frame.world_from_camera.translation.vector - pose.translation.vector).norm() < 1e-6
        );
    }

    // Images without a pose near in time, and missing files, are skipped.
    edit(&path("rgb.txt"), |text| {
        text.replace("1305031103.175304 rgb", "1305031103.775304 rgb")
    });
    std::fs::remove_file(path("rgb/1305031105.175304.png")).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 2);
    let text = warnings(&sequence);
    assert!(
        text.contains("1 of 3 images have no pose in groundtruth.txt"),
        "{text}"
    );
    assert!(
        text.contains("1 of 4 files listed in rgb.txt do not exist"),
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
    // Images 0..3, entries 1..4: the numbers differ, the counts agree.
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

    // With one entry fewer the numbers decide, and the image without an entry is counted.
    edit(&log, |text| {
        text.lines().take(15).collect::<Vec<_>>().join("\n")
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 3);
    assert!(warnings(&sequence).contains("1 of 4 images have no entry in the trajectory"));
}
