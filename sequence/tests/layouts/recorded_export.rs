//! Round trips of recorded data through the exported formats.

use linecarve_sequence::export::{TrajectoryFormat, write_colmap, write_transforms};
use linecarve_sequence::{OpenOptions, Sequence};

use super::export::{assert_same, assert_same_map, write_as_read};
use super::recorded::data;

/// The sidecar that a data set needs with external poses: intrinsics for models, else nothing. It has no `[poses]` table,
/// since exported poses are of the colour camera.
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
#[ignore = "needs LINECARVE_DATA"]
fn recorded_trajectories_survive_a_round_trip_in_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for (name, poses, taking) in [
        ("seven-scenes", None, "7-scenes"),
        ("livingroom-synthetic", None, "open3d-log"),
        ("euroc-v101", Some("cam0_trajectory_tum.txt"), "euroc"),
        // Models accept no external poses; their images do.
        ("line3dpp", None, "images-and-poses"),
        ("sceaux-castle", None, "images-and-poses"),
    ] {
        let source = data(name);
        let mut options = OpenOptions::default();
        options.poses = poses.map(|file| source.join(file));
        let sequence = Sequence::open(&source, &options).unwrap();
        let calibration = folder.path().join("calibration.toml");
        let text = match name {
            // Without the pose convention of the depth camera.
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
            write_as_read(&sequence, format, &path);
            let mut options = OpenOptions::default();
            options.poses = Some(path.clone());
            options.layout = Some(taking.to_owned());
            options.calibration = Some(calibration.clone());
            let back = Sequence::open(&source, &options).unwrap();
            assert_same(&sequence, &back, &format!("{name}, {format:?}"));
        }
    }
}

#[cfg(unix)]
#[test]
#[ignore = "needs LINECARVE_DATA"]
fn recorded_models_survive_a_round_trip_as_colmap_and_transforms() {
    for (name, images) in [
        ("seven-scenes", "."),
        ("livingroom-synthetic", "."),
        ("euroc-v101", "."),
        ("line3dpp", "."),
        ("line3dpp/model.nvm", "."),
        ("sceaux-castle", "images"),
        ("sceaux-castle/scene.mvs", "images"),
    ] {
        let source = data(name);
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
        assert_same(&sequence, &back, name);
        assert_same_map(sequence.sparse_model(), back.sparse_model(), name);
        if sequence.frames().is_empty() {
            continue;
        }
        let elsewhere = tempfile::tempdir().unwrap();
        write_transforms(&elsewhere.path().join("transforms.json"), &sequence).unwrap();
        let back = Sequence::open(elsewhere.path(), &OpenOptions::default()).unwrap();
        assert_eq!(back.layout(), "transforms-json");
        assert_same(&sequence, &back, name);
    }
}
