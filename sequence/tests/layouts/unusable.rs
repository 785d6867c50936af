//! Poses, depth and calibration that lie in the folder and cannot be used as they are: what is said, and what is read after all.

use std::path::Path;

use linecarve_sequence::{FileRole, OpenOptions, Sequence, SequenceError, check_images};
use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use crate::folder_writers::{FRAMES, matrix_lines};
use crate::support::{poses, write_tum};
use crate::writers::write_colmap_text;
use crate::{edit, folder_with, open, warnings};

use crate::loose_folders::{one_line, write_plain};

/// The pose in a file whose x, y and z axes point in these directions of the image; a left-handed world is mirrored in x.
fn with_axes(camera: &Isometry3<f64>, columns: [Vector3<f64>; 3]) -> Isometry3<f64> {
    let columns = Matrix3::from_columns(&columns);
    let mirror = Matrix3::from_diagonal(&Vector3::new(columns.determinant(), 1.0, 1.0));
    let rotation = mirror * camera.rotation.to_rotation_matrix().matrix() * columns;
    Isometry3::from_parts(
        (mirror * camera.translation.vector).into(),
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation)),
    )
}

#[test]
fn axes_of_bodies_and_turned_images_are_named_and_read() {
    let [right, down, forward] = [Vector3::x(), Vector3::y(), Vector3::z()];
    for (name, columns) in [
        ("flu", [forward, -right, -down]),
        ("frd", [forward, right, down]),
        ("luf", [-right, -down, forward]),
    ] {
        let folder = folder_with(|root| {
            write_plain(root);
            let lines: String = poses(FRAMES)
                .iter()
                .map(|pose| one_line(&with_axes(pose, columns)))
                .collect();
            std::fs::write(root.join("poses.txt"), lines).unwrap();
        });
        let text = check_images(&open(folder.path()).unwrap())
            .unwrap()
            .contradiction;
        let text = text.unwrap_or_else(|| panic!("{name} is not noticed"));
        let line = format!("axes = \"{name}\"");
        assert!(text.contains(&line), "{name}: {text}");
        edit(&folder.path().join("linecarve.toml"), |text| {
            text + "[poses]\n" + &line
        });
        let sequence = open(folder.path()).unwrap();
        assert_eq!(
            check_images(&sequence).unwrap().contradiction,
            None,
            "{name}"
        );
        for (frame, pose) in sequence.frames().iter().zip(poses(FRAMES)) {
            let off = frame.world_from_camera.inverse() * pose;
            assert!(off.translation.vector.norm() < 1e-6, "{name}");
            assert!(off.rotation.angle() < 1e-6, "{name}");
        }
    }
    let folder = folder_with(|root| {
        write_plain(root);
        edit(&root.join("linecarve.toml"), |text| {
            text + "[poses]\naxes = \"rlf\""
        });
    });
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("rlf") && error.contains("such as \"flu\""),
        "{error}"
    );
}

fn rewrite_stamps(root: &Path, stamp: impl Fn(f64) -> String) {
    edit(&root.join("groundtruth.txt"), |text| {
        text.lines()
            .filter(|line| !line.starts_with('#'))
            .map(|line| {
                let (time, rest) = line.split_once(' ').unwrap();
                format!("{} {rest}\n", stamp(time.parse().unwrap()))
            })
            .collect()
    });
}

#[test]
fn ground_truth_in_another_unit_of_time_is_joined() {
    let folder = folder_with(|root| {
        write_tum(root, FRAMES);
        rewrite_stamps(root, |time| format!("{:.0}", 1000.0 * time));
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES);
    let said = warnings(&sequence);
    assert!(said.contains("milliseconds"), "{said}");
}

#[test]
fn poses_that_cannot_be_used_are_no_sequence_without_poses() {
    let unusable = |change: &dyn Fn(&Path)| {
        let folder = folder_with(|root| {
            write_tum(root, FRAMES);
            change(root);
        });
        match Sequence::open(folder.path(), &OpenOptions::default()) {
            Err(SequenceError::UnusablePoses { path, reason }) => {
                assert!(path.ends_with("groundtruth.txt"), "{}", path.display());
                reason
            }
            other => panic!("{other:?}"),
        }
    };
    // Another clock: where both begin and end is said.
    let reason = unusable(&|root| rewrite_stamps(root, |time| format!("{:.6}", time - 1e9)));
    assert!(reason.contains("305031102.171100"), "{reason}");
    assert!(reason.contains("1305031102.175304 to"), "{reason}");
    let reason = unusable(&|root| {
        edit(&root.join("groundtruth.txt"), |text| {
            let scaled = |line: &str| {
                let mut fields: Vec<String> = line.split(' ').map(str::to_owned).collect();
                fields[7] = "5".to_owned();
                fields.join(" ") + "\n"
            };
            text.lines()
                .filter(|line| !line.starts_with('#'))
                .map(scaled)
                .collect()
        });
    });
    assert!(reason.contains("not rigid transforms"), "{reason}");
    let reason =
        unusable(&|root| std::fs::write(root.join("groundtruth.txt"), "# none\n").unwrap());
    assert!(reason.contains("has no poses"), "{reason}");
}

#[test]
fn pose_files_of_any_kind_are_not_passed_over() {
    for name in [
        "poses.npy",
        "poses.npz",
        "camera_poses.yaml",
        "Trajectory.json",
        "odom.pkl",
        "extrinsics.h5",
    ] {
        let folder = folder_with(|root| {
            write_plain(root);
            std::fs::remove_file(root.join("poses.txt")).unwrap();
            let begins = if name.ends_with(".npz") {
                "PK\u{3}\u{4}"
            } else {
                ""
            };
            std::fs::write(root.join(name), begins.to_owned() + "anything").unwrap();
        });
        let sequence =
            Sequence::open_without_poses(folder.path(), &OpenOptions::default()).unwrap();
        let [unread] = sequence.unread_files() else {
            panic!("{name}: {:?}", sequence.unread_files());
        };
        assert_eq!((unread.name.as_str(), unread.role), (name, FileRole::Poses));
        assert!(unread.is_missed);
        let problem = unread.problem(folder.path());
        assert!(problem.contains("--poses FILE"), "{problem}");
    }
}

#[test]
fn words_that_only_contain_pose_are_no_poses() {
    let folder = folder_with(|root| {
        write_plain(root);
        std::fs::remove_file(root.join("poses.txt")).unwrap();
        for name in ["docker-compose.yml", "purpose.txt", "exposure.csv"] {
            std::fs::write(root.join(name), "a: b").unwrap();
        }
    });
    let sequence = Sequence::open_without_poses(folder.path(), &OpenOptions::default()).unwrap();
    assert_eq!(sequence.unread_files(), []);
}

#[test]
fn tables_join_by_name_whatever_the_order_of_their_columns() {
    for (head, end) in [("name", ".png"), ("frame", ".png"), ("frame", "")] {
        let folder = folder_with(|root| {
            write_plain(root);
            std::fs::remove_file(root.join("poses.txt")).unwrap();
            let mut lines = format!("{head},qw,qx,qy,qz,tx,ty,tz\n");
            for (at, pose) in poses(FRAMES).iter().enumerate().rev() {
                let (t, q) = (pose.translation.vector, pose.rotation.coords);
                lines += &format!(
                    "{at}{end},{},{},{},{},{},{},{}\n",
                    q.w, q.x, q.y, q.z, t.x, t.y, t.z
                );
            }
            std::fs::write(root.join("poses.csv"), lines).unwrap();
        });
        let sequence = open(folder.path()).unwrap();
        for (frame, pose) in sequence.frames().iter().zip(poses(FRAMES)) {
            let off = frame.world_from_camera.inverse() * pose;
            assert!(off.translation.vector.norm() < 1e-6, "{}", frame.name);
        }
    }
}

#[test]
fn files_that_macos_leaves_beside_images_are_no_images() {
    let folder = folder_with(|root| {
        write_plain(root);
        for at in 0..FRAMES {
            for name in ["rgb", "depth"] {
                let path = root.join(format!("{name}/._{at}.png"));
                std::fs::write(path, b"\x00\x05\x16\x07 Mac OS X").unwrap();
            }
        }
        std::fs::write(root.join("._poses.txt"), b"\x00\x05\x16\x07").unwrap();
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES);
    assert_eq!(warnings(&sequence), "");
}

#[test]
fn a_focal_length_that_is_not_in_pixels_is_refused() {
    let folder = folder_with(|root| {
        write_plain(root);
        let text = "[color]\nfx = 0.94\nfy = 1.25\ncx = 0.5\ncy = 0.5\n";
        std::fs::write(root.join("linecarve.toml"), text).unwrap();
    });
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("1.095 pixels") && error.contains("normalised"),
        "{error}"
    );
}

#[test]
fn a_colmap_model_takes_depth_images_beside_its_images() {
    let folder = folder_with(|root| {
        write_colmap_text(root);
        std::fs::create_dir(root.join("depth")).unwrap();
        let mut names: Vec<_> = std::fs::read_dir(root.join("images"))
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        names.sort();
        // One image has none.
        for (name, pose) in names.iter().skip(1).zip(&poses(names.len())[1..]) {
            let depth = crate::support::depth_image(pose, 1000.0);
            depth.save(root.join("depth").join(name)).unwrap();
        }
    });
    let sequence = open(folder.path()).unwrap();
    let with_depth = sequence
        .frames()
        .iter()
        .filter(|frame| frame.depth.is_some());
    assert_eq!(with_depth.count() + 1, sequence.frames().len());
    assert!(sequence.depth_calibration().is_some());
    assert!(sequence.sparse_model().is_some());
    let said = warnings(&sequence);
    assert!(said.contains("no depth image"), "{said}");
}

#[test]
fn poses_of_folders_of_matrices_must_be_some() {
    let folder = folder_with(|root| {
        crate::folder_writers::write_pose_folder(root);
        for at in 0..FRAMES {
            let lines = matrix_lines(&Isometry3::identity()).replace('1', "3");
            std::fs::write(root.join(format!("pose/{at}.txt")), lines).unwrap();
        }
    });
    let error = Sequence::open(folder.path(), &OpenOptions::default()).unwrap_err();
    assert!(
        matches!(error, SequenceError::UnusablePoses { .. }),
        "{error:?}"
    );
}
