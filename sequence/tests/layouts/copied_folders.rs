//! Folders that were copied from another machine, renamed or cut: files are found by what is left of their names, and what is missing is named.

use std::path::Path;

use linecarve_sequence::{FileRole, OpenOptions, Sequence, TimedPoses, TrajectoryAlignment};
use serde_json::{Value, json};

use crate::folder_writers::{FRAMES, write_images};
use crate::loose_folders::write_plain;
use crate::support::{FOCAL, SIZE, color_image, poses, write_tum};
use crate::{edit, folder_with, open, warnings};

/// `transforms.json` of images below `images/` and depth below `depth/`, which it names as given.
fn write_named(root: &Path, names: impl Fn(usize) -> [String; 2]) {
    write_images(
        root,
        1000.0,
        |i| format!("images/{i}.png"),
        |i| format!("depth/{i}.png"),
    );
    let frames: Vec<Value> = poses(FRAMES)
        .iter()
        .enumerate()
        .map(|(i, pose)| {
            let m = pose.to_homogeneous();
            let row = |r: usize| json!([m[(r, 0)], -m[(r, 1)], -m[(r, 2)], m[(r, 3)]]);
            let [color, depth] = names(i);
            json!({
                "file_path": color,
                "depth_file_path": depth,
                "transform_matrix": [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
            })
        })
        .collect();
    let file = json!({
        "fl_x": FOCAL, "fl_y": FOCAL, "cx": 0.5 * f64::from(SIZE.0), "cy": 0.5 * f64::from(SIZE.1),
        "w": SIZE.0, "h": SIZE.1, "frames": frames,
    });
    std::fs::write(root.join("transforms.json"), file.to_string()).unwrap();
}

#[test]
fn files_are_found_by_the_names_that_they_had_on_another_machine() {
    type Names = fn(usize) -> [String; 2];
    let names: [Names; 4] = [
        |i| [format!("images/{i}.png"), format!("depth/{i}.png")],
        |i| {
            let root = "/scans/room";
            [
                format!("{root}/images/{i}.png"),
                format!("{root}/depth/{i}.png"),
            ]
        },
        |i| [format!(".\\images\\{i}.png"), format!("depth\\{i}")],
        |i| [format!("../Images/{i}.PNG"), format!("Depth/{i}.PNG")],
    ];
    for names in names {
        let folder = folder_with(|root| write_named(root, names));
        let sequence = open(folder.path()).unwrap();
        assert_eq!(sequence.frames().len(), FRAMES, "{:?}", names(0));
        assert!(sequence.load_depth(0).unwrap().is_some(), "{:?}", names(0));
        assert_eq!(warnings(&sequence), "", "{:?}", names(0));
    }
}

#[test]
fn a_file_that_may_be_that_of_two_frames_is_refused() {
    let folder = folder_with(|root| {
        write_named(root, |i| {
            [
                format!("/scan{}/images/{}.png", i % 2, i / 2),
                String::new(),
            ]
        });
    });
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("frames 0 and 1") && error.contains("images"),
        "{error}"
    );
}

#[test]
fn depth_that_a_file_names_and_that_is_missing_is_counted() {
    let folder = folder_with(|root| {
        write_named(root, |i| {
            [format!("images/{i}.png"), format!("depth/{i}.png")]
        });
        std::fs::remove_dir_all(root.join("depth")).unwrap();
    });
    let said = warnings(&open(folder.path()).unwrap());
    let words = format!("{FRAMES} of {FRAMES} images have no depth");
    assert!(
        said.contains(&words) && said.contains("depth/0.png"),
        "{said}"
    );
}

#[test]
fn a_fisheye_lens_of_instant_ngp_is_one() {
    let image = |keys: &[(&str, Value)]| {
        let folder = folder_with(|root| {
            write_named(root, |i| [format!("images/{i}.png"), String::new()]);
            edit(&root.join("transforms.json"), |text| {
                let mut file: Value = serde_json::from_str(&text).unwrap();
                file["k1"] = json!(0.3);
                for (key, value) in keys {
                    file[*key] = value.clone();
                }
                file.to_string()
            });
        });
        open(folder.path())
            .unwrap()
            .load_gray(0)
            .unwrap()
            .samples()
            .to_vec()
    };
    let fisheye = image(&[("is_fisheye", json!(true))]);
    assert!(fisheye == image(&[("camera_model", json!("OPENCV_FISHEYE"))]));
    assert!(fisheye != image(&[("is_fisheye", json!(false))]));
}

#[test]
fn heads_name_the_columns() {
    let of = |i: usize| {
        let pose = poses(FRAMES)[i];
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        ([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])
    };
    type Row = fn(usize, [f64; 3], [f64; 4]) -> String;
    let files: [(&str, Row); 4] = [
        (
            "timestamp qw qx qy qz x y z",
            |i, [x, y, z], [a, b, c, w]| format!("{i} {w} {a} {b} {c} {x} {y} {z}"),
        ),
        (
            "__time,/odom/pose/orientation/w,/odom/pose/orientation/x,/odom/pose/orientation/y,/odom/pose/orientation/z,\
             /odom/pose/position/x,/odom/pose/position/y,/odom/pose/position/z",
            |i, [x, y, z], [a, b, c, w]| format!("{i},{w},{a},{b},{c},{x},{y},{z}"),
        ),
        (
            "%time,field.transform.translation.x,field.transform.translation.y,field.transform.translation.z,\
             field.transform.rotation.x,field.transform.rotation.y,field.transform.rotation.z,field.transform.rotation.w",
            |i, [x, y, z], [a, b, c, w]| format!("{i},{x},{y},{z},{a},{b},{c},{w}"),
        ),
        (
            "\"time\",\"x\",\"y\",\"z\",\"qx\",\"qy\",\"qz\",\"qw\"",
            |i, [x, y, z], [a, b, c, w]| {
                format!("\"{i}\",\"{x}\",\"{y}\",\"{z}\",\"{a}\",\"{b}\",\"{c}\",\"{w}\"")
            },
        ),
    ];
    for (head, row) in files {
        let folder = folder_with(|root| {
            write_plain(root);
            let rows: String = (0..FRAMES)
                .map(|i| {
                    let (position, rotation) = of(i);
                    row(i, position, rotation) + "\n"
                })
                .collect();
            std::fs::write(root.join("poses.txt"), format!("{head}\n{rows}")).unwrap();
        });
        let sequence = open(folder.path()).unwrap_or_else(|error| panic!("{head}: {error}"));
        for (frame, pose) in sequence.frames().iter().zip(poses(FRAMES)) {
            let off = frame.world_from_camera.inverse() * pose;
            assert!(off.translation.vector.norm() < 1e-9, "{head}");
        }
    }
}

#[test]
fn numbered_poses_of_a_part_of_the_images_are_joined_by_number() {
    let folder = folder_with(|root| {
        write_plain(root);
        let rows: String = poses(FRAMES)
            .iter()
            .enumerate()
            .skip(1)
            .step_by(2)
            .map(|(i, pose)| {
                let (t, q) = (pose.translation.vector, pose.rotation.coords);
                format!(
                    "{i} {} {} {} {} {} {} {}\n",
                    t.x, t.y, t.z, q.x, q.y, q.z, q.w
                )
            })
            .collect();
        std::fs::write(root.join("poses.txt"), rows).unwrap();
    });
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES / 2);
    for (frame, pose) in sequence
        .frames()
        .iter()
        .zip(poses(FRAMES).iter().skip(1).step_by(2))
    {
        let off = frame.world_from_camera.inverse() * pose;
        assert!(off.translation.vector.norm() < 1e-9, "{}", frame.name);
    }
}

#[test]
fn trajectories_are_compared_in_any_unit_of_time() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let write = |name: &str, first: f64, factor: f64| {
        let rows: String = (0..30)
            .map(|k| {
                let t = f64::from(k);
                let stamp = ((first + 0.1 * t) * factor * 1e6).round() / 1e6;
                format!("{stamp} {t} {} 0 0 0 0 1\n", t.sin())
            })
            .collect();
        std::fs::write(path(name), rows).unwrap();
    };
    for first in [0.0, 1_700_000_000.0] {
        write("seconds.txt", first, 1.0);
        let seconds = TimedPoses::read(&path("seconds.txt")).unwrap();
        for factor in [1e3, 1e6, 1e9] {
            write("other.txt", first, factor);
            let other = TimedPoses::read(&path("other.txt")).unwrap();
            for (from, to) in [(&other, &seconds), (&seconds, &other)] {
                let found = from.compare_with(to, TrajectoryAlignment::None).unwrap();
                assert_eq!((found.pairs, found.frames), (30, 30), "{first} {factor}");
                assert!(found.position.max < 1e-9, "{first} {factor}");
            }
        }
        // Another recording stays one.
        write("later.txt", first + 1000.0, 1.0);
        let later = TimedPoses::read(&path("later.txt")).unwrap();
        assert!(
            later
                .compare_with(&seconds, TrajectoryAlignment::None)
                .is_err()
        );
    }
}

#[test]
fn poses_in_other_files_and_depth_beside_images_are_not_passed_over() {
    let unread = |put: &dyn Fn(&Path)| {
        let folder = folder_with(|root| {
            std::fs::create_dir(root.join("rgb")).unwrap();
            for (i, pose) in poses(3).iter().enumerate() {
                color_image(pose)
                    .save(root.join(format!("rgb/{i}.png")))
                    .unwrap();
            }
            put(root);
        });
        let mut options = OpenOptions::default();
        options.assumed_focal = Some(0.8);
        let sequence = Sequence::open_without_poses(folder.path(), &options).unwrap();
        let files = sequence.unread_files();
        let [file] = files else {
            panic!("{files:?}");
        };
        assert!(file.is_missed);
        (file.name.clone(), file.role)
    };
    let of_json = unread(&|root| {
        std::fs::write(
            root.join("views.json"),
            r#"{"views": [{"c2w": [1, 0, 0, 0]}]}"#,
        )
        .unwrap();
    });
    assert_eq!(of_json, ("views.json".to_owned(), FileRole::Poses));
    let below = unread(&|root| {
        write_tum(&root.join("slam"), 4);
        std::fs::remove_dir_all(root.join("slam/rgb")).unwrap();
        std::fs::remove_dir_all(root.join("slam/depth")).unwrap();
    });
    assert_eq!(below, ("slam/groundtruth.txt".to_owned(), FileRole::Poses));
    // Results of an earlier run are no input.
    let folder = folder_with(|root| {
        write_plain(root);
        std::fs::remove_file(root.join("poses.txt")).unwrap();
        write_tum(&root.join("out"), 4);
        std::fs::write(root.join("out/.linecarve-files"), "trajectory.txt\n").unwrap();
    });
    let sequence = Sequence::open_without_poses(folder.path(), &OpenOptions::default()).unwrap();
    assert_eq!(sequence.unread_files(), []);
    let beside = unread(&|root| {
        for i in 0..3 {
            let (from, to) = (format!("rgb/{i}.png"), format!("rgb/{i}.jpg"));
            let image = image::open(root.join(&from)).unwrap();
            image.save(root.join(to)).unwrap();
            image.to_luma16().save(root.join(from)).unwrap();
        }
    });
    assert!(
        beside.0.starts_with("rgb/0.") && beside.1 == FileRole::Depth,
        "{beside:?}"
    );
}
