//! Folders as other programs leave them: each is read right, or what is not read is named.

use std::fmt::Write;
use std::path::Path;

use linecarve_sequence::{FileRole, OpenOptions, Sequence, check_images};
use nalgebra::Isometry3;

use crate::folder_writers::{
    FRAMES, intrinsics_text, write_icl, write_images, write_pose_folder, write_replica,
};
use crate::support::{FOCAL, SIZE, color_image, poses, write_open3d, write_tum};
use crate::writers::write_colmap_text;
use crate::{edit, folder_with, open, replace, warnings};

/// The poses and the depth of a sequence are those of the scene.
fn assert_right(sequence: &Sequence, layout: &str, scale: f64) {
    assert_eq!(sequence.layout(), layout);
    assert_eq!(sequence.frames().len(), FRAMES);
    assert!(sequence.has_poses());
    let depth = sequence.depth_calibration().unwrap();
    assert!((depth.scale / scale - 1.0).abs() < 1e-9, "{}", depth.scale);
    assert!((sequence.color_camera().fx() - FOCAL).abs() < 1e-9);
    for (frame, pose) in sequence.frames().iter().zip(poses(FRAMES)) {
        let off = frame.world_from_camera.inverse() * pose;
        assert!(off.translation.vector.norm() < 1e-5, "{}", frame.name);
        assert!(frame.depth.is_some(), "{}", frame.name);
    }
    assert_eq!(check_images(sequence).unwrap().contradiction, None);
    assert!(
        sequence.unread_files().iter().all(|file| !file.is_missed),
        "{:?}",
        sequence.unread_files()
    );
}

#[test]
fn a_pose_file_for_each_image_is_read() {
    let folder = folder_with(write_pose_folder);
    assert_right(&open(folder.path()).unwrap(), "scannet", 1000.0);
    std::fs::write(
        folder.path().join("pose/2.txt"),
        "-inf -inf -inf -inf\n-inf -inf -inf -inf\n-inf -inf -inf -inf\n0 0 0 1\n",
    )
    .unwrap();
    let sequence = open(folder.path()).unwrap();
    assert_eq!(sequence.frames().len(), FRAMES - 1);
    assert!(
        warnings(&sequence).contains("tracking was lost"),
        "{}",
        warnings(&sequence)
    );
}

#[test]
fn depth_of_scannet_has_its_own_camera() {
    let folder = folder_with(write_pose_folder);
    let root = folder.path();
    std::fs::remove_file(root.join("intrinsics.txt")).unwrap();
    std::fs::create_dir(root.join("intrinsic")).unwrap();
    std::fs::write(
        root.join("intrinsic/intrinsic_color.txt"),
        intrinsics_text(2.0),
    )
    .unwrap();
    std::fs::write(
        root.join("intrinsic/intrinsic_depth.txt"),
        intrinsics_text(1.0),
    )
    .unwrap();
    for i in 0..FRAMES {
        let path = root.join(format!("color/{i}.png"));
        let image = image::open(&path).unwrap();
        let twice =
            image.resize_exact(2 * SIZE.0, 2 * SIZE.1, image::imageops::FilterType::Nearest);
        twice.save(path).unwrap();
    }
    let sequence = open(root).unwrap();
    let depth = sequence.depth_calibration().unwrap();
    assert!(!depth.registered);
    assert_eq!(depth.camera.fx(), FOCAL);
    assert_eq!(sequence.color_camera().fx(), 2.0 * FOCAL);
    assert_eq!(check_images(&sequence).unwrap().contradiction, None);
}

#[test]
fn replica_is_read_with_the_camera_above_it() {
    let folder = folder_with(write_replica);
    assert_right(
        &open(&folder.path().join("room0")).unwrap(),
        "replica",
        6553.5,
    );
}

#[test]
fn images_of_redwood_are_joined_by_their_first_number() {
    let folder = folder_with(|root| {
        write_open3d(root, FRAMES, 1);
        for i in 0..FRAMES {
            for (part, time) in [("image", 33_367 * i), ("depth", 33_367 * i + 7_000)] {
                let from = root.join(format!("{part}/{i:05}.png"));
                std::fs::rename(from, root.join(format!("{part}/{i:07}-{time:012}.png"))).unwrap();
            }
        }
    });
    assert_right(&open(folder.path()).unwrap(), "open3d-log", 1000.0);
}

#[test]
fn depth_scale_of_instant_ngp_is_read() {
    let folder = folder_with(crate::writers::write_transforms);
    replace(
        &folder.path().join("transforms.json"),
        "{",
        "{\"enable_depth_loading\": true, \"integer_depth_scale\": 0.0002, ",
    );
    let root = folder.path();
    let file: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(root.join("transforms.json")).unwrap())
            .unwrap();
    let mut file = file;
    file.as_object_mut()
        .unwrap()
        .remove("depth_unit_scale_factor");
    for (i, frame) in file["frames"]
        .as_array_mut()
        .unwrap()
        .iter_mut()
        .enumerate()
    {
        frame.as_object_mut().unwrap().remove("depth_file_path");
        frame["depth_path"] = format!("depth/{i}.png").into();
    }
    std::fs::create_dir_all(root.join("depth")).unwrap();
    let size = image::image_dimensions(open(root).unwrap().frames()[0].color.as_path()).unwrap();
    for i in 0..file["frames"].as_array().unwrap().len() {
        image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(size.0, size.1, image::Luma([5000]))
            .save(root.join(format!("depth/{i}.png")))
            .unwrap();
    }
    std::fs::write(root.join("transforms.json"), file.to_string()).unwrap();
    let scale = open(root).unwrap().depth_calibration().unwrap().scale;
    assert!((scale - 5000.0).abs() < 1e-6, "{scale}");
}

#[test]
fn of_several_models_the_largest_is_read() {
    let folder = folder_with(|root| {
        write_colmap_text(root);
        std::fs::create_dir_all(root.join("sparse/1")).unwrap();
        for name in ["cameras.txt", "images.txt", "points3D.txt"] {
            let [small, large] =
                ["0", "1"].map(|number| root.join("sparse").join(number).join(name));
            std::fs::copy(&small, large).unwrap();
            if name == "images.txt" {
                edit(&small, |text| {
                    let data = text.lines().filter(|line| !line.starts_with('#'));
                    data.take(2)
                        .fold(String::new(), |all, line| all + line + "\n")
                });
            }
        }
    });
    let sequence = open(folder.path()).unwrap();
    assert!(sequence.frames().len() > 1, "{}", sequence.frames().len());
    let said = warnings(&sequence);
    assert!(
        said.contains("sparse/1") && said.contains("sparse/0 with 1"),
        "{said}"
    );
    let small = open(&folder.path().join("sparse/0")).unwrap();
    assert_eq!(small.frames().len(), 1);
    let open_model = |model: &str, layout: Option<&str>| {
        let mut options = OpenOptions::default();
        options.model = Some(model.to_owned());
        options.layout = layout.map(str::to_owned);
        Sequence::open(folder.path(), &options)
    };
    for model in ["0", "sparse/0"] {
        let small = open_model(model, None).unwrap();
        assert_eq!(small.frames().len(), 1, "{model}");
        assert!(!warnings(&small).contains("models"), "{}", warnings(&small));
    }
    let unknown = open_model("7", None).unwrap_err().to_string();
    assert!(
        unknown.contains("--model 7") && unknown.contains("sparse/1, sparse/0"),
        "{unknown}"
    );
    let other_layout = open_model("0", Some("tum")).unwrap_err().to_string();
    assert!(other_layout.contains("--layout tum"), "{other_layout}");
}

/// ICL-NUIM: numbered images, a list with depth first, and a trajectory of an unusual name.
#[test]
fn a_freiburg_trajectory_beside_a_list_with_depth_first_is_read() {
    let folder = folder_with(|root| write_icl(root, 0));
    let sequence = open(folder.path()).unwrap();
    assert_right(&sequence, "images-and-poses", 5000.0);
    assert!(!warnings(&sequence).contains("joined"));
}

#[test]
fn stray_scanner_is_refused_until_its_video_is_unpacked() {
    let folder = folder_with(|root| {
        write_images(
            root,
            1000.0,
            |i| format!("rgb/{i:06}.png"),
            |i| format!("depth/{i:06}.png"),
        );
        std::fs::create_dir(root.join("confidence")).unwrap();
        for i in 0..FRAMES {
            color_image(&Isometry3::identity())
                .save(root.join(format!("confidence/{i:06}.png")))
                .unwrap();
        }
        let mut odometry = "timestamp, frame, x, y, z, qx, qy, qz, qw\n".to_owned();
        for (i, pose) in poses(FRAMES).iter().enumerate() {
            let (t, q) = (pose.translation.vector, pose.rotation.coords);
            writeln!(
                odometry,
                "{}.5, {i:06}, {}, {}, {}, {}, {}, {}, {}",
                100 + i,
                t.x,
                t.y,
                t.z,
                q.x,
                q.y,
                q.z,
                q.w
            )
            .unwrap();
        }
        std::fs::write(root.join("odometry.csv"), odometry).unwrap();
        std::fs::write(
            root.join("camera_matrix.csv"),
            intrinsics_text(1.0).replace(' ', ", "),
        )
        .unwrap();
        std::fs::write(root.join("rgb.mp4"), "").unwrap();
    });
    let root = folder.path();
    assert_right(&open(root).unwrap(), "stray-scanner", 1000.0);
    std::fs::remove_dir_all(root.join("rgb")).unwrap();
    let error = open(root).unwrap_err();
    assert!(
        error.contains("rgb.mp4") && error.contains("ffmpeg"),
        "{error}"
    );
    // Nor is confidence taken for colour where there are no poses.
    let mut without = OpenOptions::default();
    without.assumed_focal = Some(0.8);
    assert!(Sequence::open_without_poses(root, &without).is_err());
}

#[test]
fn nothing_that_looks_like_poses_depth_or_calibration_is_passed_over() {
    let without_poses = |root: &Path| {
        let mut options = OpenOptions::default();
        options.assumed_focal = Some(0.8);
        Sequence::open_without_poses(root, &options).unwrap()
    };
    let put = |root: &Path, name: &str, text: &str| {
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let trajectory = "0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n2 1 1 0 0 0 0 1\n";
    for (name, entry, text, role) in [
        (
            "cams/00000000_cam.txt",
            "cams",
            "extrinsic\n",
            FileRole::Poses,
        ),
        ("odometry.csv", "odometry.csv", "a,b\n", FileRole::Poses),
        ("estimate.txt", "estimate.txt", trajectory, FileRole::Poses),
        (
            "reconstruction.json",
            "reconstruction.json",
            "[]",
            FileRole::Poses,
        ),
        ("sparse_depth/0.exr", "sparse_depth", "", FileRole::Depth),
        ("results.npz", "results.npz", "", FileRole::Depth),
        (
            "_info.txt",
            "_info.txt",
            "m_calibrationColorIntrinsic = 1\n",
            FileRole::Calibration,
        ),
        (
            "calibration.yaml",
            "calibration.yaml",
            "fx: 1\n",
            FileRole::Calibration,
        ),
        (
            "lowres_wide_intrinsics/0.pincam",
            "lowres_wide_intrinsics",
            "",
            FileRole::Calibration,
        ),
    ] {
        let folder = folder_with(|root| {
            for (i, pose) in poses(3).iter().enumerate() {
                std::fs::create_dir_all(root.join("rgb")).unwrap();
                color_image(pose)
                    .save(root.join(format!("rgb/{i}.png")))
                    .unwrap();
            }
            put(root, name, text);
        });
        let sequence = without_poses(folder.path());
        let [unread] = sequence.unread_files() else {
            panic!("{name}: {:?}", sequence.unread_files());
        };
        assert_eq!((unread.name.as_str(), unread.role), (entry, role));
        assert!(unread.is_missed, "{name}");
        let problem = unread.problem(folder.path());
        assert!(problem.contains(entry), "{problem}");
    }
    // What has a part of the layout in its place is only named.
    let folder = folder_with(|root| {
        write_tum(root, 6);
        put(root, "estimate.txt", trajectory);
    });
    let sequence = open(folder.path()).unwrap();
    assert!(!sequence.unread_files()[0].is_missed);
    let said = warnings(&sequence);
    assert!(said.contains("estimate.txt (poses)"), "{said}");
    assert!(!said.contains("groundtruth"), "{said}");
    // What the user gives counts as read.
    let mut options = OpenOptions::default();
    options.poses = Some(folder.path().join("groundtruth.txt"));
    let sequence = Sequence::open(folder.path(), &options).unwrap();
    assert!(
        sequence.unread_files().is_empty(),
        "{:?}",
        sequence.unread_files()
    );
}

#[test]
fn a_convention_that_contradicts_the_depth_is_named_with_its_remedy() {
    type Break = fn(&Path);
    let breaks: [(&str, Break, &str); 3] = [
        (
            "scale",
            |root| {
                edit(&root.join("linecarve.toml"), |text| {
                    text + "[depth]\nscale = 1000.0\n"
                });
            },
            "scale = 5000.0",
        ),
        (
            "millimetres",
            |root| {
                edit_poses(root, |pose| {
                    let mut pose = *pose;
                    pose.translation.vector *= 1000.0;
                    pose
                });
            },
            "scale = 5.0",
        ),
        (
            "inverse",
            |root| edit_poses(root, Isometry3::inverse),
            "direction = \"inverse\"",
        ),
    ];
    for (name, broken, line) in breaks {
        let folder = folder_with(|root| write_tum(root, 12));
        assert_eq!(
            check_images(&open(folder.path()).unwrap())
                .unwrap()
                .contradiction,
            None
        );
        broken(folder.path());
        let text = check_images(&open(folder.path()).unwrap())
            .unwrap()
            .contradiction;
        let text = text.unwrap_or_else(|| panic!("{name} is not noticed"));
        assert!(text.contains(line), "{name}: {text}");
        // The lines of the remedy are those that a sidecar takes.
        let lines = text.split_once("linecarve.toml:\n").unwrap().1.to_owned();
        let lines: String = lines
            .lines()
            .map(|line| line.trim().to_owned() + "\n")
            .collect();
        let section = lines.lines().next().unwrap().to_owned();
        edit(&folder.path().join("linecarve.toml"), |text| {
            // In place of the section that is there.
            let kept = text.split('[').filter(|part| {
                !part.is_empty()
                    && !section
                        .starts_with(&format!("[{}", part.lines().next().unwrap_or_default()))
            });
            kept.map(|part| format!("[{part}")).collect::<String>() + "\n" + &lines
        });
        let sequence = open(folder.path()).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(
            check_images(&sequence).unwrap().contradiction,
            None,
            "{name}"
        );
    }
}

/// Rewrites the poses of a TUM folder.
fn edit_poses(root: &Path, change: impl Fn(&Isometry3<f64>) -> Isometry3<f64>) {
    edit(&root.join("groundtruth.txt"), |text| {
        let stamps = text.lines().filter(|line| !line.starts_with('#'));
        let stamps = stamps.map(|line| line.split(' ').next().unwrap());
        let mut out = String::new();
        for (stamp, pose) in stamps.zip(poses(12)) {
            let pose = change(&pose);
            let (t, q) = (pose.translation.vector, pose.rotation.coords);
            writeln!(
                out,
                "{stamp} {} {} {} {} {} {} {}",
                t.x, t.y, t.z, q.x, q.y, q.z, q.w
            )
            .unwrap();
        }
        out
    });
}

/// A model of COLMAP's `image_undistorter`: each image has a size and a camera of its own.
#[test]
fn images_of_different_sizes_are_resampled_to_one_camera() {
    let folder = folder_with(|root| {
        write_colmap_text(root);
        let mut cameras = String::new();
        let mut numbers = std::collections::BTreeMap::new();
        for (i, pose) in poses(FRAMES).iter().enumerate() {
            // Image i has a border of i pixels around the common part; the last one shows a quarter of it.
            let border = i as u32;
            let whole = color_image(pose);
            let [width, height] = [SIZE.0, SIZE.1].map(|side| side + 2 * border);
            let mut image = image::GrayImage::from_fn(width, height, |x, y| {
                let inside = |at: u32, side: u32| at.saturating_sub(border).min(side - 1);
                *whole.get_pixel(inside(x, SIZE.0), inside(y, SIZE.1))
            });
            let mut center = [width, height].map(|side| f64::from(side) / 2.0);
            if i == FRAMES - 1 {
                image = image::imageops::crop_imm(&image, 0, 0, width / 2, height).to_image();
                center[0] = f64::from(width) / 2.0;
            }
            image
                .save(root.join(format!("images/view{i}.png")))
                .unwrap();
            let [cx, cy] = center;
            writeln!(
                cameras,
                "{} PINHOLE {} {} {FOCAL} {FOCAL} {cx} {cy}",
                i + 1,
                image.width(),
                image.height()
            )
            .unwrap();
            numbers.insert(format!("view{i}.png"), i + 1);
        }
        let model = root.join("sparse/0");
        std::fs::write(model.join("cameras.txt"), cameras).unwrap();
        edit(&model.join("images.txt"), |text| {
            text.lines().fold(String::new(), |all, line| {
                let line = match line.rsplit_once(" 1 ") {
                    Some((pose, name)) if numbers.contains_key(name) => {
                        format!("{pose} {} {name}", numbers[name])
                    }
                    _ => line.to_owned(),
                };
                all + &line + "\n"
            })
        });
    });
    let sequence = open(folder.path()).unwrap();
    let said = warnings(&sequence);
    assert_eq!(sequence.frames().len(), FRAMES - 1, "{said}");
    assert!(
        said.contains("4 of 6 images have another size and are resampled"),
        "{said}"
    );
    assert!(
        said.contains("view5") && said.contains("min_scale"),
        "{said}"
    );
    assert_eq!(sequence.color_size().width, SIZE.0);
    for (i, pose) in poses(FRAMES - 1).iter().enumerate() {
        let loaded = sequence.load_gray(i).unwrap();
        assert_eq!(
            loaded.samples(),
            color_image(pose).as_raw().as_slice(),
            "{i}"
        );
        assert_eq!(sequence.stored_size(i).width, SIZE.0 + 2 * i as u32);
    }
}

/// Images in formats of the web and of old programs.
#[test]
fn bmp_and_webp_are_read() {
    for extension in ["bmp", "webp"] {
        let folder = folder_with(|root| {
            write_pose_folder(root);
            for i in 0..FRAMES {
                let png = root.join(format!("color/{i}.png"));
                let image = image::open(&png).unwrap();
                image.save(png.with_extension(extension)).unwrap();
                std::fs::remove_file(png).unwrap();
            }
        });
        let sequence = open(folder.path()).unwrap();
        assert_right(&sequence, "scannet", 1000.0);
        assert_eq!(
            sequence.load_gray(0).unwrap().samples(),
            color_image(&poses(FRAMES)[0]).as_raw().as_slice()
        );
    }
}

/// A JPEG file whose tag says that its pixels are to be shown turned.
fn tagged(image: &image::DynamicImage, orientation: u8) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    image
        .write_to(&mut bytes, image::ImageFormat::Jpeg)
        .unwrap();
    let bytes = bytes.into_inner();
    let mut tag = b"\xFF\xE1\0\x22Exif\0\0II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0".to_vec();
    tag.extend([orientation, 0, 0, 0, 0, 0, 0, 0]);
    [&bytes[..2], &tag, &bytes[2..]].concat()
}

#[test]
fn an_exif_orientation_is_named() {
    let with_size = |width: u32, height: u32, orientation: u8| {
        folder_with(|root| {
            write_open3d(root, FRAMES, 1);
            let camera = root.join("camera_primesense.json");
            replace(
                &camera,
                &format!("\"width\": {}", SIZE.0),
                &format!("\"width\": {width}"),
            );
            replace(
                &camera,
                &format!("\"height\": {}", SIZE.1),
                &format!("\"height\": {height}"),
            );
            for entry in std::fs::read_dir(root.join("image")).unwrap() {
                let path = entry.unwrap().path();
                let image = image::open(&path).unwrap();
                std::fs::write(path, tagged(&image, orientation)).unwrap();
            }
        })
    };
    let (width, height) = SIZE;
    // The calibration is of the pixels as they are stored.
    let stored = with_size(width, height, 6);
    assert!(!warnings(&open(stored.path()).unwrap()).contains("EXIF"));
    let shown = with_size(height, width, 6);
    let error = open(shown.path()).unwrap_err();
    assert!(
        error.contains("EXIF orientation") && error.contains("exiftran"),
        "{error}"
    );
    // The size does not tell.
    let upside_down = with_size(width, height, 3);
    let said = warnings(&open(upside_down.path()).unwrap());
    assert!(said.contains("EXIF orientation"), "{said}");
    let upright = with_size(width, height, 1);
    assert!(!warnings(&open(upright.path()).unwrap()).contains("EXIF"));
}
