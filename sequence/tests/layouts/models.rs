//! Layouts of SLAM systems and of structure from motion: all give the same poses and points.

use std::path::Path;

use linecarve_sequence::{OpenOptions, Sequence};

use super::support::poses;
use super::writers::{
    FRAMES, body_from_camera, points, stamp_ns, write_colmap_binary, write_colmap_text,
    write_euroc, write_mvs, write_nvm, write_orb_slam, write_pose_list, write_stella,
    write_transforms,
};
use super::{MODELS, edit, folder_with, open, replace, warnings};

fn assert_poses(sequence: &Sequence, name: &str) {
    assert_eq!(sequence.frames().len(), FRAMES, "{name}");
    for (frame, pose) in sequence.frames().iter().zip(poses(FRAMES)) {
        let difference = frame.world_from_camera.inverse() * pose;
        assert!(difference.translation.vector.norm() < 1e-9, "{name}");
        assert!(difference.rotation.angle() < 1e-7, "{name}");
    }
}

#[test]
fn every_layout_gives_the_same_poses_and_points() {
    for (name, write, has_points) in MODELS {
        let folder = folder_with(write);
        let sequence = open(folder.path()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(sequence.layout(), name);
        assert_poses(&sequence, name);
        assert!((sequence.color_camera().cx() - 31.5).abs() < 1e-9, "{name}");
        assert_eq!(sequence.load_gray(1).unwrap().width(), 64);
        let Some(model) = sequence.sparse_model() else {
            assert!(!has_points, "{name}");
            continue;
        };
        assert_eq!(model.points.len(), points().len(), "{name}");
        assert_eq!(model.views.len(), FRAMES, "{name}");
        let mut observations = 0;
        for (point, expected) in model.points.iter().zip(points()) {
            assert!((point.point_in_world - expected).norm() < 1e-6, "{name}");
            assert!(
                point
                    .observations
                    .windows(2)
                    .all(|pair| pair[0].view < pair[1].view),
                "{name}"
            );
            for observation in &point.observations {
                let view = &model.views[observation.view as usize];
                let seen = view.world_from_camera.inverse() * point.point_in_world;
                let seen = view.camera.as_ref().unwrap().project(&seen).unwrap();
                if let Some([x, y]) = observation.pixel {
                    let error = (seen.x - x).hypot(seen.y - y);
                    assert!(error < 1e-4, "{name}: {error}");
                }
                observations += 1;
            }
        }
        assert!(observations > 3 * points().len(), "{name}: {observations}");
    }
}

#[test]
fn a_model_file_can_be_opened_without_images() {
    for (write, file) in [
        (write_mvs as fn(&Path), "scene.mvs"),
        (write_nvm, "model.nvm"),
        (write_stella, "map.msg"),
    ] {
        let folder = folder_with(write);
        let path = folder.path().join(file);
        assert_poses(&open(&path).unwrap(), file);
        let alone = tempfile::tempdir().unwrap();
        let copy = alone.path().join(file);
        std::fs::copy(&path, &copy).unwrap();
        let sequence = open(&copy).unwrap();
        assert!(sequence.frames().is_empty(), "{file}");
        assert_eq!(
            sequence.sparse_model().unwrap().points.len(),
            points().len()
        );
        assert!(
            warnings(&sequence).contains("only its points can be used"),
            "{}",
            warnings(&sequence)
        );
    }
}

#[test]
fn the_layout_can_be_given_and_alternatives_are_named() {
    let folder = folder_with(|folder| {
        write_colmap_text(folder);
        write_mvs(folder);
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.layout(), "colmap");
    assert!(sequence.conventions()[0].contains("could also be read as openmvs"));
    let force = |name: &str| {
        let mut options = OpenOptions::default();
        options.layout = Some(name.to_owned());
        Sequence::open(folder.path(), &options)
    };
    assert_eq!(force("openmvs").unwrap().layout(), "openmvs");
    let error = force("colmapp").unwrap_err().to_string();
    assert!(
        error.contains("takes one of") && error.contains("openmvs"),
        "{error}"
    );
    assert!(force("nvm").is_err());
}

fn with_poses(folder: &Path, file: &str, text: &str) -> Result<Sequence, String> {
    let path = folder.join(file);
    std::fs::write(&path, text).unwrap();
    let mut options = OpenOptions::default();
    options.poses = Some(path);
    Sequence::open(folder, &options).map_err(|error| error.to_string())
}

/// Poses as lines, each made from the number of the frame, position and quaternion.
fn lines(line: impl Fn(usize, [f64; 3], [f64; 4]) -> String) -> String {
    poses(FRAMES)
        .iter()
        .enumerate()
        .map(|(i, pose)| {
            let (t, q) = (pose.translation.vector, pose.rotation.coords);
            line(i, t.into(), [q.x, q.y, q.z, q.w]) + "\n"
        })
        .collect()
}

#[test]
fn an_external_trajectory_may_have_any_format() {
    let tum = |scale: f64, decimals: usize| {
        lines(move |i, [x, y, z], [qx, qy, qz, qw]| {
            let stamp = stamp_ns(i) as f64 / scale;
            format!("{stamp:.decimals$} {x} {y} {z} {qx} {qy} {qz} {qw}")
        })
    };
    let csv = lines(|i, [x, y, z], [qx, qy, qz, qw]| {
        // Body poses: the file inverts the extrinsics.
        let camera = nalgebra::Isometry3::from_parts(
            nalgebra::Translation3::new(x, y, z),
            nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(qw, qx, qy, qz)),
        );
        let body = camera * body_from_camera().inverse();
        let (t, q) = (body.translation.vector, body.rotation.coords);
        format!(
            "{},{},{},{},{},{},{},{}",
            stamp_ns(i),
            t.x,
            t.y,
            t.z,
            q.w,
            q.x,
            q.y,
            q.z
        )
    });
    let unstamped =
        lines(|_, [x, y, z], [qx, qy, qz, qw]| format!("{x} {y} {z} {qx} {qy} {qz} {qw}"));
    let indexed = lines(|i, [x, y, z], [qx, qy, qz, qw]| {
        let stamp = stamp_ns(i) as f64 / 1e9;
        format!("{i} {stamp:.6} {x} {y} {z} {qx} {qy} {qz} {qw}")
    });
    let matrices = |rows: usize| {
        poses(FRAMES)
            .iter()
            .map(|pose| {
                let m = pose.to_homogeneous().transpose();
                let numbers: Vec<String> =
                    m.iter().take(4 * rows).map(ToString::to_string).collect();
                numbers.join(" ") + "\n"
            })
            .collect::<String>()
    };
    let folder = folder_with(write_euroc);
    for (what, text) in [
        ("seconds", tum(1e9, 6)),
        ("milliseconds", tum(1e6, 0)),
        ("microseconds", tum(1e3, 0)),
        ("nanoseconds", tum(1.0, 0)),
        ("EuRoC", csv),
        ("no stamps", unstamped),
        ("an index", indexed),
        ("KITTI", matrices(3)),
        ("4x4", matrices(4)),
    ] {
        let sequence = with_poses(folder.path(), "given.txt", &text)
            .unwrap_or_else(|error| panic!("{what}: {error}"));
        assert_eq!(sequence.layout(), "euroc");
        assert_poses(&sequence, what);
    }
    let late =
        lines(|i, [x, y, z], [qx, qy, qz, qw]| format!("{i}.5 {x} {y} {z} {qx} {qy} {qz} {qw}"));
    let error = with_poses(folder.path(), "given.txt", &late).unwrap_err();
    assert!(
        error.contains("given.txt") && error.contains("same clock"),
        "{error}"
    );
    let few = matrices(3).lines().take(2).collect::<Vec<_>>().join("\n");
    let error = with_poses(folder.path(), "given.txt", &few).unwrap_err();
    assert!(
        error.contains("2 poses") && error.contains("6 images"),
        "{error}"
    );
    let error = with_poses(folder.path(), "given.txt", "1 2 3 4 5\n").unwrap_err();
    assert!(
        error.contains("line 1") && error.contains("5 fields"),
        "{error}"
    );
}

#[test]
fn a_folder_of_images_and_a_trajectory_are_enough() {
    let folder = folder_with(write_pose_list);
    std::fs::rename(
        folder.path().join("pose.txt"),
        folder.path().join("odd.name"),
    )
    .unwrap();
    assert!(open(folder.path()).is_err());
    let mut options = OpenOptions::default();
    options.poses = Some(folder.path().join("odd.name"));
    let sequence = Sequence::open(folder.path(), &options).unwrap();
    assert_poses(&sequence, "images-and-poses");
    assert!(sequence.load_depth(0).unwrap().is_some());
    std::fs::remove_file(folder.path().join("linecarve.toml")).unwrap();
    let error = Sequence::open(folder.path(), &options)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("no file gives the camera intrinsics"),
        "{error}"
    );
}

#[test]
fn a_euroc_folder_without_poses_suggests_a_trajectory() {
    let folder = folder_with(write_euroc);
    std::fs::rename(
        folder
            .path()
            .join("mav0/state_groundtruth_estimate0/data.csv"),
        folder.path().join("truth.csv"),
    )
    .unwrap();
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("--poses") && error.contains("truth.csv"),
        "{error}"
    );
}

#[test]
fn camera_models_are_read_or_refused_by_name() {
    let folder = folder_with(write_colmap_text);
    let cameras = folder.path().join("sparse/0/cameras.txt");
    for (line, accepted) in [
        ("1 SIMPLE_PINHOLE 64 48 60 32 24", true),
        ("1 SIMPLE_RADIAL 64 48 60 32 24 -0.01", true),
        ("1 RADIAL 64 48 60 32 24 -0.01 0.002", true),
        ("1 OPENCV 64 48 60 60 32 24 -0.01 0.002 0 0", true),
        ("1 OPENCV_FISHEYE 64 48 60 60 32 24 -0.01 0.002 0 0", true),
        (
            "1 FULL_OPENCV 64 48 60 60 32 24 -0.01 0.002 0 0 0 0 0 0",
            true,
        ),
        (
            "1 FULL_OPENCV 64 48 60 60 32 24 -0.01 0.002 0 0 0 0.1 0 0",
            false,
        ),
        (
            "1 THIN_PRISM_FISHEYE 64 48 60 60 32 24 0 0 0 0 0 0 0 0",
            false,
        ),
        ("1 FOV 64 48 60 60 32 24 0.9", false),
        ("1 PINHOLE 64 48 60 60 32", false),
        ("1 HOLGA 64 48 60 60 32 24", false),
    ] {
        std::fs::write(&cameras, line).unwrap();
        match open(folder.path()) {
            Ok(sequence) => {
                assert!(accepted, "{line}");
                assert!((sequence.stored_color_camera().cx() - 31.5).abs() < 1e-12);
            }
            Err(error) => {
                assert!(!accepted, "{line}: {error}");
                assert!(
                    error.contains("cameras.txt, line 1: camera model"),
                    "{error}"
                );
            }
        }
    }
}

#[test]
fn images_of_a_second_camera_are_resampled_to_the_first() {
    let folder = folder_with(write_colmap_text);
    let model = folder.path().join("sparse/0");
    std::fs::write(
        model.join("cameras.txt"),
        "1 PINHOLE 64 48 60 60 32 24\n2 PINHOLE 64 48 60 60 37 24\n3 PINHOLE 48 64 60 60 24 32\n",
    )
    .unwrap();
    let images = model.join("images.txt");
    replace(&images, " 1 view1.png", " 2 view1.png");
    replace(&images, " 1 view2.png", " 3 view2.png");
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES - 1);
    assert!(
        warnings(&sequence).contains("another size than 64 x 48"),
        "{}",
        warnings(&sequence)
    );
    assert_eq!(sequence.stored_camera(1).cx(), 36.5);
    let stored = image::open(folder.path().join("images/view1.png"))
        .unwrap()
        .to_luma8();
    let loaded = sequence.load_gray(1).unwrap();
    // With the principal point 5 px further right, every point is 5 px further right.
    assert_eq!(loaded.get(20, 20), Some(&stored.get_pixel(25, 20).0[0]));
}

#[test]
fn the_sidecar_sets_the_pose_convention() {
    let folder = folder_with(write_pose_list);
    let inverse: String = poses(FRAMES)
        .iter()
        .map(|pose| {
            let pose = pose.inverse();
            let (t, q) = (pose.translation.vector, pose.rotation.coords);
            format!("{} {} {} {} {} {} {}\n", t.x, t.y, t.z, q.w, q.x, q.y, q.z)
        })
        .collect();
    std::fs::write(folder.path().join("pose.txt"), inverse).unwrap();
    edit(&folder.path().join("linecarve.toml"), |text| {
        text + "[poses]\ndirection = \"inverse\"\nquaternion = \"w-first\"\n"
    });
    assert_poses(&open(folder.path()).unwrap(), "sidecar");
}

#[test]
fn binary_models_name_the_byte() {
    let folder = folder_with(write_colmap_binary);
    let path = folder.path().join("colmap/points3D.bin");
    let mut bytes = std::fs::read(&path).unwrap();
    bytes[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    std::fs::write(&path, bytes).unwrap();
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("points3D.bin, byte 0: 18446744073709551615 points are announced"),
        "{error}"
    );
}

#[test]
fn truncated_models_are_refused() {
    for (write, file) in [
        (write_mvs as fn(&Path), "scene.mvs"),
        (write_nvm, "model.nvm"),
        (write_stella, "map.msg"),
        (write_transforms, "transforms.json"),
        (write_orb_slam, "kf_run.txt"),
    ] {
        let folder = folder_with(write);
        let path = folder.path().join(file);
        let bytes = std::fs::read(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() * 3 / 5]).unwrap();
        if let Err(error) = open(folder.path()) {
            assert!(error.contains(file), "{file}: {error}");
        } else {
            // A truncated trajectory is valid.
            assert_eq!(file, "kf_run.txt");
        }
    }
}
