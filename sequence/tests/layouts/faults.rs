//! Bad input gives an error that names file and remedy, or a warning with a count.

use std::path::Path;

use linecarve_sequence::{FrameError, InspectOptions, inspect};

use super::support::{write_open3d, write_seven_scenes, write_tum};
use super::{edit, folder_with, open, replace, replace_line, warnings};

#[test]
fn each_kind_of_unusable_folder_has_its_message() {
    let folder = tempfile::tempdir().unwrap();
    let message = |path: &Path| open(path).unwrap_err();
    assert!(message(&folder.path().join("nowhere")).contains("does not exist"));
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
fn poses_that_are_not_finite_are_skipped_and_counted() {
    let folder = folder_with(|folder| write_seven_scenes(folder, 5));
    for i in [1, 3] {
        let path = folder.path().join(format!("frame-00000{i}.pose.txt"));
        replace_line(&path, 1, if i == 1 { "nan 0 0 0" } else { "1 0 0 -1.#IND" });
    }
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), 3);
    assert!(
        warnings(&sequence)
            .contains("2 of 5 poses are not finite and were skipped: frame-000001, frame-000003"),
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
    assert!(warnings(&sequence).contains("poses are not finite and were skipped: 00002"));
}

#[test]
fn a_sequence_without_finite_poses_is_refused() {
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
        message.contains("no usable frame") && message.contains("2 a pose that is not finite"),
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
            "line 2: expected 4 numbers, found 3",
        ),
        (
            "1 0 0 0\n0 1 0 0\n0 0 x 0\n0 0 0 1\n",
            "line 3: 'x' is not a number",
        ),
        ("1 0 0 0\n0 1 0 0\n", "found 2 rows"),
        ("", "found 0 rows"),
        (
            "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n0 0 0 1\n",
            "line 5: expected a matrix of 4 rows",
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
            .contains("groundtruth.txt, line 3: expected 8 numbers, found 4")
    );

    let folder = folder_with(|folder| write_open3d(folder, 3, 1));
    replace_line(&folder.path().join("trajectory.log"), 6, "1 one 2 3");
    assert!(
        open(folder.path())
            .unwrap_err()
            .contains("trajectory.log, line 6: expected the head of entry 1")
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
        text.contains("1 of 6 frames have no colour image and were skipped: frame-000001"),
        "{text}"
    );
    assert!(
        text.contains("1 of 6 frames have no pose and were skipped: frame-000002"),
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
fn a_truncated_image_affects_only_its_frame() {
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
fn a_sequence_without_readable_images_is_refused() {
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
        message.contains("none of the 2 colour images can be read"),
        "{message}"
    );
}

#[test]
fn size_mismatches_name_file_sizes_and_remedy() {
    let small = image::GrayImage::new(32, 24);
    let small_depth =
        image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(32, 24, image::Luma([900]));

    // Registered depth of another size affects the whole sequence.
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
    // With a separate depth camera any size is valid, but all images must have it.
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

    // The default camera of the layout has another size.
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
    assert!(open(folder.path()).unwrap_err().contains("is not a camera"));
}
