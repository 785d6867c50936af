//! Stereo pairs: KITTI and EuRoC, with what can be wrong with them, and image folders of any name.

use linecarve_sequence::{OpenOptions, Sequence};

use super::writers::{
    BASELINE, FRAMES, body_from_camera, write_euroc, write_images, write_kitti, write_pose_list,
};
use super::{edit, folder_with, open, replace, replace_line, warnings};

#[test]
fn kitti_has_rectified_pairs_and_poses_of_the_left_grey_camera() {
    let folder = folder_with(write_kitti);
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.has_time());
    let pair = sequence.stereo().unwrap();
    assert!((pair.baseline() - BASELINE).abs() < 1e-12);
    assert_eq!(pair.camera(), sequence.color_camera());
    let (left, right) = sequence.load_stereo(2).unwrap();
    assert_eq!(left.samples(), sequence.load_gray(2).unwrap().samples());
    let right = right.unwrap();
    assert!(left.samples() != right.samples());

    // The colour cameras stand beside the grey ones, so their poses differ, and their pictures with them.
    for grey in ["image_0", "image_1"] {
        std::fs::remove_dir_all(folder.path().join(grey)).unwrap();
    }
    let colour = open(folder.path()).unwrap();
    assert!((colour.stereo().unwrap().baseline() - BASELINE).abs() < 1e-12);
    for (a, b) in sequence.frames().iter().zip(colour.frames()) {
        let displaced = a.world_from_camera.inverse() * b.world_from_camera;
        assert!(
            (displaced.translation.vector - nalgebra::Vector3::new(-0.06, 0.0, 0.0)).norm() < 1e-12
        );
    }
}

#[test]
fn damaged_rows_of_kitti_are_named() {
    let folder = folder_with(write_kitti);
    let error_of = |file: &str, line: usize, text: &str| {
        let path = folder.path().join(file);
        let before = std::fs::read(&path).unwrap();
        replace_line(&path, line, text);
        let error = open(folder.path()).unwrap_err();
        std::fs::write(&path, before).unwrap();
        error
    };
    for (file, line, text, parts) in [
        (
            "calib.txt",
            1,
            "P0: 1 2 3",
            ["calib.txt, line 1", "12 numbers"],
        ),
        (
            "calib.txt",
            2,
            "P1: x 0 1 0 0 1 1 0 0 0 1 0",
            ["calib.txt, line 2", "'x' is not a number"],
        ),
        (
            "calib.txt",
            2,
            "P1: 1 5 1 0 0 1 1 0 0 0 1 0",
            ["calib.txt, line 2", "rectified"],
        ),
        (
            "calib.txt",
            1,
            "P0: -1 0 1 0 0 1 1 0 0 0 1 0",
            ["calib.txt, line 1", "focal length"],
        ),
        (
            "calib.txt",
            2,
            "P0: 60 0 31.5 0 0 60 23.5 0 0 0 1 0",
            ["calib.txt, line 2", "given twice"],
        ),
        (
            "calib.txt",
            2,
            "P1: 60 0 31.5 15 0 60 23.5 0 0 0 1 0",
            ["calib.txt, P1", "exchanged"],
        ),
        ("calib.txt", 1, "Q: 1", ["calib.txt", "no row P0"]),
        (
            "times.txt",
            3,
            "late",
            ["times.txt, line 3", "not a time stamp"],
        ),
        ("times.txt", 3, "", ["times.txt", "5 times for 6 images"]),
        (
            "poses.txt",
            2,
            "1 0 0 0 0 1 0",
            ["poses.txt, line 2", "expected 12 numbers"],
        ),
        ("poses.txt", 2, "", ["poses.txt", "5 poses for 6 images"]),
    ] {
        let error = error_of(file, line, text);
        for part in parts {
            assert!(error.contains(part), "{text}: {error}");
        }
    }
    std::fs::remove_file(folder.path().join("poses.txt")).unwrap();
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("--poses FILE"), "{error}");
    let unposed = Sequence::open_without_poses(folder.path(), &OpenOptions::default()).unwrap();
    assert_eq!(unposed.frames().len(), FRAMES);
}

#[test]
fn a_missing_right_image_leaves_the_left_one_alone() {
    let folder = folder_with(write_kitti);
    std::fs::remove_file(folder.path().join("image_1/000003.png")).unwrap();
    let sequence = open(folder.path()).unwrap();
    assert!(
        warnings(&sequence).contains("1 of 6 images have no image of the right camera: 000003"),
        "{}",
        warnings(&sequence)
    );
    assert!(sequence.load_stereo(3).unwrap().1.is_none());
    std::fs::write(folder.path().join("image_1/000004.png"), "no image").unwrap();
    let error = sequence.load_stereo(4).unwrap_err();
    assert!(
        error.is_limited_to_frame() && error.to_string().contains("image_1/000004.png"),
        "{error}"
    );
}

#[test]
fn euroc_has_a_right_camera_at_its_mounting() {
    let folder = folder_with(write_euroc);
    let [left, right] = ["cam0", "cam1"].map(|name| folder.path().join("mav0").join(name));
    assert!(open(folder.path()).unwrap().stereo().is_none());
    let names: Vec<String> = std::fs::read_dir(left.join("data"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    write_images(&right.join("data"), &names);
    std::fs::copy(left.join("data.csv"), right.join("data.csv")).unwrap();
    let sensor = std::fs::read_to_string(left.join("sensor.yaml")).unwrap();
    let text = |pose: nalgebra::Isometry3<f64>| {
        let matrix = pose.to_homogeneous().transpose();
        let numbers: Vec<String> = matrix.iter().map(|v| format!("{v:?}")).collect();
        numbers.join(", ")
    };
    let from = text(body_from_camera());
    let moved = body_from_camera() * nalgebra::Isometry3::translation(0.11, 0.0, 0.0);
    assert!(sensor.contains(&from));
    std::fs::write(
        right.join("sensor.yaml"),
        sensor.replace(&from, &text(moved)),
    )
    .unwrap();
    let sequence = open(folder.path()).unwrap();
    assert!((sequence.stereo().unwrap().baseline() - 0.11).abs() < 1e-12);
    assert!(sequence.frames().iter().all(|frame| frame.right.is_some()));

    replace(&right.join("sensor.yaml"), "T_BS", "T_of_what");
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.stereo().is_none() && warnings(&sequence).contains("T_BS"));
    edit(&right.join("sensor.yaml"), |_| "intrinsics: 7".to_owned());
    assert!(open(folder.path()).unwrap_err().contains("sensor.yaml"));
}

#[test]
fn one_folder_of_images_may_have_any_name() {
    let folder = folder_with(write_pose_list);
    let rename = |from: &str, to: &str| {
        std::fs::rename(folder.path().join(from), folder.path().join(to)).unwrap();
    };
    rename("color", "holiday pictures");
    assert_eq!(open(folder.path()).unwrap().frames().len(), FRAMES);
    rename("pose.txt", "odd.name");
    let mut options = OpenOptions::default();
    options.poses = Some(folder.path().join("odd.name"));
    let sequence = Sequence::open(folder.path(), &options).unwrap();
    assert!(sequence.load_depth(0).unwrap().is_some());
    let unposed = Sequence::open_without_poses(folder.path(), &OpenOptions::default()).unwrap();
    assert_eq!(unposed.frames().len(), FRAMES);
    // With two of them there is no telling which is meant.
    write_images(&folder.path().join("other"), &["1.png".to_owned()]);
    assert!(Sequence::open(folder.path(), &options).is_err());
}
