//! Recorded data, found through the environment variable `LINECARVE_DATA`: every set opens by its own layout, and wrong
//! conventions are recognised.
#![allow(clippy::print_stdout)]

use std::path::{Path, PathBuf};

use linecarve_sequence::export::{TrajectoryFormat, write_colmap, write_transforms};
use linecarve_sequence::{InspectOptions, OpenOptions, Sequence, SequenceFacts, inspect};
use nalgebra::Matrix4;

fn data(name: &str) -> Option<PathBuf> {
    let Some(root) = std::env::var_os("LINECARVE_DATA") else {
        println!("skipped: LINECARVE_DATA is not set");
        return None;
    };
    let path = PathBuf::from(root).join(name);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
        return None;
    }
    Some(path)
}

fn facts(sequence: &Sequence, gaps: &[usize]) -> SequenceFacts {
    let few = InspectOptions {
        samples: 2,
        pairs: 5,
        gaps: gaps.to_vec(),
        matched_pairs: 5,
        registrations: 0,
    };
    inspect(sequence, &few).unwrap()
}

#[test]
fn every_set_opens_by_its_own_layout() {
    for (path, layout, frames, points, reprojection) in [
        ("seven-scenes", "7-scenes", 334, 0, 0.0),
        ("livingroom-synthetic", "open3d-log", 53, 0, 0.0),
        ("line3dpp", "colmap", 26, 11_367, 0.66),
        ("line3dpp/colmap", "colmap", 26, 11_367, 0.66),
        ("line3dpp/model.nvm", "nvm", 26, 11_367, 0.66),
        ("sceaux-castle", "colmap", 11, 8032, 0.51),
        ("sceaux-castle/scene.mvs", "openmvs", 0, 12_683, 0.0),
        ("euroc-v101", "colmap", 99, 27_133, 0.44),
    ] {
        let Some(path) = data(path) else { return };
        let sequence = Sequence::open(&path, &OpenOptions::default()).unwrap();
        assert_eq!(sequence.layout(), layout, "{}", path.display());
        assert_eq!(sequence.frames().len(), frames, "{}", path.display());
        let Some(model) = sequence.sparse_model() else {
            assert_eq!(points, 0);
            continue;
        };
        assert_eq!(model.points.len(), points);
        let mut errors: Vec<f64> = Vec::new();
        for point in &model.points {
            for observation in &point.observations {
                let view = &model.views[observation.view as usize];
                let seen = view.world_from_camera.inverse() * point.point_in_world;
                assert!(layout == "openmvs" || seen.z > 0.0);
                if let (Some([x, y]), Some(camera)) = (observation.pixel, &view.camera) {
                    let pixel = camera.project(&seen).unwrap();
                    errors.push((pixel.x - x).hypot(pixel.y - y));
                }
            }
        }
        if !errors.is_empty() {
            // The error that COLMAP states, a mean over all observations.
            let mean = errors.iter().sum::<f64>() / errors.len() as f64;
            assert!(
                (mean - reprojection).abs() < 0.05,
                "{}: {mean}",
                path.display()
            );
        }
    }
}

#[test]
fn euroc_takes_poses_from_elsewhere() {
    let Some(folder) = data("euroc-v101") else {
        return;
    };
    let with = |file: &str| {
        let options = OpenOptions {
            poses: Some(folder.join(file)),
            ..OpenOptions::default()
        };
        Sequence::open(&folder, &options).unwrap()
    };
    let sequence = with("cam0_trajectory_tum.txt");
    assert_eq!((sequence.layout(), sequence.frames().len()), ("euroc", 99));
    // The same poses as the model beside them.
    let model = Sequence::open(&folder, &OpenOptions::default()).unwrap();
    for (a, b) in sequence.frames().iter().zip(model.frames()) {
        assert_eq!(a.timestamp_ns, b.timestamp_ns);
        let difference = a.world_from_camera.inverse() * b.world_from_camera;
        assert!(difference.translation.vector.norm() < 1e-6);
    }
    let found = facts(&sequence, &[1]);
    let epipolar = found.epipolar.unwrap();
    assert!(epipolar.as_read.median_px < 1.5, "{:?}", epipolar.as_read);
    assert!(found.warnings.is_empty(), "{:?}", found.warnings);

    // The known fault: rotations camera from world, positions of the camera and not of the body.
    let found = facts(&with("V101_GT.txt"), &[1]);
    let warning = found
        .warnings
        .iter()
        .map(ToString::to_string)
        .collect::<String>();
    for part in [
        "the inverse rotations (camera from world) at the same positions",
        "poses of the colour camera itself",
        "camera = \"color\", direction = \"rotation-inverse\"",
    ] {
        assert!(warning.contains(part), "{warning}");
    }
}

/// Every fourth of the first hundred frames of a 7-Scenes folder, poses changed.
fn changed(
    source: &Path,
    with_depth: bool,
    change: impl Fn(Matrix4<f64>) -> Matrix4<f64>,
) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let sequence = Sequence::open(source, &OpenOptions::default()).unwrap();
    for frame in sequence.frames().iter().step_by(2).take(40) {
        let name = &frame.name;
        let text = std::fs::read_to_string(source.join(format!("{name}.pose.txt"))).unwrap();
        let numbers = text
            .split_whitespace()
            .map(|field| field.parse::<f64>().unwrap());
        let matrix = change(Matrix4::from_row_iterator(numbers));
        let rows: Vec<String> = matrix
            .row_iter()
            .map(|row| format!("{:e} {:e} {:e} {:e}", row[0], row[1], row[2], row[3]))
            .collect();
        std::fs::write(
            folder.path().join(format!("{name}.pose.txt")),
            rows.join("\n"),
        )
        .unwrap();
        let parts: &[&str] = if with_depth {
            &["color.jpg", "depth.png"]
        } else {
            &["color.jpg"]
        };
        for part in parts {
            let file = format!("{name}.{part}");
            std::fs::copy(source.join(&file), folder.path().join(&file)).unwrap();
        }
    }
    std::fs::copy(
        source.join("linecarve.toml"),
        folder.path().join("linecarve.toml"),
    )
    .unwrap();
    folder
}

#[test]
fn wrong_conventions_of_seven_scenes_are_recognised() {
    let Some(source) = data("seven-scenes") else {
        return;
    };
    let inverse = |m: Matrix4<f64>| {
        let mut m = m.try_inverse().unwrap();
        m.set_row(3, &nalgebra::RowVector4::new(0.0, 0.0, 0.0, 1.0));
        m
    };
    let flipped =
        |m: Matrix4<f64>| m * Matrix4::from_diagonal(&nalgebra::Vector4::new(1.0, -1.0, -1.0, 1.0));
    let warnings = |folder: &Path| {
        let sequence = Sequence::open(folder, &OpenOptions::default()).unwrap();
        let found = facts(&sequence, &[5]);
        found
            .warnings
            .iter()
            .map(|w| format!("{w}\n"))
            .collect::<String>()
    };
    let right = changed(&source, true, |m| m);
    assert_eq!(warnings(right.path()), "");
    for with_depth in [true, false] {
        let folder = changed(&source, with_depth, inverse);
        let text = warnings(folder.path());
        assert!(
            text.contains("better with the inverse poses (camera from world) (")
                || text.contains("px with the inverse poses (camera from world):"),
            "{with_depth}: {text}"
        );
        assert!(text.contains("direction = \"inverse\""), "{text}");
        let folder = changed(&source, with_depth, flipped);
        let text = warnings(folder.path());
        assert!(
            text.contains("axes y up, z backward (OpenGL)"),
            "{with_depth}: {text}"
        );
        assert!(text.contains("axes = \"y-and-z-flipped\""), "{text}");
    }
    let sidecar = right.path().join("linecarve.toml");
    super::replace(&sidecar, "scale = 1000.0", "scale = 5000.0");
    let text = warnings(right.path());
    assert!(
        text.contains("a depth scale of 1000 instead of 5000"),
        "{text}"
    );
    assert!(text.contains("[depth] scale = 1000.0"), "{text}");
}

#[test]
fn a_list_of_poses_needs_its_camera() {
    let Some(folder) = data("rgbd-5") else { return };
    let error = Sequence::open(&folder, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(error.contains("no file tells the camera"), "{error}");
    let sidecar = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(
        sidecar.path(),
        "[color]\nfx = 518.0\nfy = 519.0\ncx = 325.5\ncy = 253.5\n",
    )
    .unwrap();
    let options = OpenOptions {
        calibration: Some(sidecar.path().to_owned()),
        ..OpenOptions::default()
    };
    let sequence = Sequence::open(&folder, &options).unwrap();
    assert_eq!(
        (sequence.layout(), sequence.frames().len()),
        ("images-and-poses", 5)
    );
    let found = facts(&sequence, &[1]);
    let depth = found.depth.unwrap();
    assert_eq!((depth.frames, depth.scale), (5, 1000.0));
    assert!(found.consistency[0].as_read.median_difference < 0.15);
}

/// A calibration that a set needs where poses are brought along: nothing of `[poses]`, as written poses are of the colour
/// camera. Empty where the files beside the images tell the camera.
fn calibration_for(sequence: &Sequence) -> String {
    let camera = sequence.stored_color_camera();
    if sequence.layout() != "colmap" {
        return String::new();
    }
    let camera = camera.without_distortion();
    format!(
        "[color]\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n",
        camera.fx(),
        camera.fy(),
        camera.cx(),
        camera.cy()
    )
}

#[test]
fn recorded_trajectories_come_back_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for (name, poses, taking) in [
        ("seven-scenes", None, "7-scenes"),
        ("livingroom-synthetic", None, "open3d-log"),
        ("euroc-v101", Some("cam0_trajectory_tum.txt"), "euroc"),
        // Models keep their poses; their images take others.
        ("line3dpp", None, "images-and-poses"),
        ("sceaux-castle", None, "images-and-poses"),
    ] {
        let Some(source) = data(name) else { return };
        let options = OpenOptions {
            poses: poses.map(|file| source.join(file)),
            ..OpenOptions::default()
        };
        let sequence = Sequence::open(&source, &options).unwrap();
        let calibration = folder.path().join("calibration.toml");
        let text = match name {
            // Its own, without the table that makes poses those of the depth camera.
            "seven-scenes" => {
                assert_eq!(
                    sequence.sidecar_pose_convention(),
                    Some("camera = \"depth\"")
                );
                let text = std::fs::read_to_string(source.join("linecarve.toml")).unwrap();
                text.replace("camera = \"depth\"", "")
            }
            _ => {
                assert_eq!(sequence.sidecar_pose_convention(), None);
                calibration_for(&sequence)
            }
        };
        std::fs::write(&calibration, text).unwrap();
        let path = folder.path().join("trajectory.txt");
        for format in [
            TrajectoryFormat::Tum,
            TrajectoryFormat::Euroc,
            TrajectoryFormat::Kitti,
            TrajectoryFormat::Open3dLog,
        ] {
            super::export::write_as_read(&sequence, format, &path);
            let options = OpenOptions {
                poses: Some(path.clone()),
                layout: Some(taking.to_owned()),
                calibration: Some(calibration.clone()),
            };
            let back = Sequence::open(&source, &options).unwrap();
            super::export::assert_same(&sequence, &back, &format!("{name}, {format:?}"));
        }
    }
}

#[cfg(unix)]
#[test]
fn recorded_maps_come_back_as_colmap_and_transforms() {
    for (name, images) in [
        ("seven-scenes", "."),
        ("livingroom-synthetic", "."),
        ("euroc-v101", "."),
        ("line3dpp", "."),
        ("line3dpp/model.nvm", "."),
        ("sceaux-castle", "images"),
        ("sceaux-castle/scene.mvs", "images"),
    ] {
        let Some(source) = data(name) else { return };
        let sequence = Sequence::open(&source, &OpenOptions::default()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let set = if source.is_file() {
            source.parent().unwrap()
        } else {
            &source
        };
        std::os::unix::fs::symlink(set.join(images), folder.path().join("images")).unwrap();
        write_colmap(folder.path(), &sequence).unwrap();
        let back = Sequence::open(folder.path(), &OpenOptions::default()).unwrap();
        assert_eq!(back.layout(), "colmap");
        super::export::assert_same(&sequence, &back, name);
        super::export::assert_same_map(sequence.sparse_model(), back.sparse_model(), name);
        if sequence.frames().is_empty() {
            continue;
        }
        let elsewhere = tempfile::tempdir().unwrap();
        write_transforms(&elsewhere.path().join("transforms.json"), &sequence).unwrap();
        let back = Sequence::open(elsewhere.path(), &OpenOptions::default()).unwrap();
        assert_eq!(back.layout(), "transforms-json");
        super::export::assert_same(&sequence, &back, name);
    }
}
