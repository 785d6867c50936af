//! Folders without a layout of their own: names of images, values of depth, cameras and trajectories as they come.

use std::path::Path;

use image::{ImageBuffer, Luma};
use linecarve_sequence::{DepthValues, FileRole, OpenOptions, Sequence, check_images};
use nalgebra::Isometry3;

use crate::folder_writers::{FRAMES, intrinsics_text, matrix_lines, write_icl, write_images};
use crate::support::{FOCAL, SIZE, color_image, depth_image, poses, sidecar, write_seven_scenes};
use crate::{edit, folder_with, open, warnings};

pub(crate) fn one_line(pose: &Isometry3<f64>) -> String {
    matrix_lines(pose).replace('\n', " ") + "\n"
}

/// Images under names given by their number, poses in order, and the camera.
fn write_loose(root: &Path, color: impl Fn(usize) -> String, depth: impl Fn(usize) -> String) {
    write_images(root, 1000.0, color, depth);
    let lines: String = poses(FRAMES).iter().map(one_line).collect();
    std::fs::write(root.join("poses.txt"), lines).unwrap();
    std::fs::write(root.join("linecarve.toml"), sidecar()).unwrap();
}

/// The same in `rgb/` and `depth/`.
pub(crate) fn write_plain(root: &Path) {
    write_loose(
        root,
        |i| format!("rgb/{i}.png"),
        |i| format!("depth/{i}.png"),
    );
}

/// Each frame has the depth of the scene at its pose.
fn assert_right(sequence: &Sequence) {
    assert_eq!(sequence.frames().len(), FRAMES);
    for (at, pose) in poses(FRAMES).iter().enumerate() {
        let off = sequence.frames()[at].world_from_camera.inverse() * pose;
        assert!(off.translation.vector.norm() < 1e-6);
        let depth = sequence.load_depth(at).unwrap().unwrap();
        let truth = depth_image(pose, 1000.0);
        for (found, truth) in depth.samples().iter().zip(truth.pixels()) {
            let truth = f64::from(truth.0[0]) / 1000.0;
            assert!(
                (f64::from(*found) - truth).abs() < 2e-3 * truth,
                "{found} {truth}"
            );
        }
    }
    assert_eq!(check_images(sequence).unwrap().contradiction, None);
}

#[test]
fn colour_and_depth_are_told_apart_by_their_names() {
    type Name = fn(usize) -> String;
    let names: [(Name, Name); 8] = [
        (
            |i| format!("{i:05}-color.png"),
            |i| format!("{i:05}-depth.png"),
        ),
        (|i| format!("rgb_{i}.png"), |i| format!("depth_{i}.png")),
        (
            |i| format!("images/{i}.png"),
            |i| format!("images/{i}_depth.png"),
        ),
        (|i| format!("RGB/{i}.png"), |i| format!("Depth/{i}.png")),
        (
            |i| format!("image_left/{i:06}_left.png"),
            |i| format!("depth_left/{i:06}_left_depth.png"),
        ),
        (
            |i| format!("rgb/{i}.png"),
            |i| format!("depth_image/{i}.png"),
        ),
        (
            |i| format!("color/a{i}_i0.png"),
            |i| format!("depth/a{i}_d0.png"),
        ),
        (|i| format!("rgb/{i}.png"), |i| format!("depth/{i}.png")),
    ];
    for (color, depth) in names {
        let folder = folder_with(|root| write_loose(root, color, depth));
        let sequence = open(folder.path()).unwrap_or_else(|error| panic!("{}: {error}", color(1)));
        assert_right(&sequence);
    }
    // What comes with depth is neither.
    let folder = folder_with(|root| {
        write_loose(
            root,
            |i| format!("{i}_rgb.png"),
            |i| format!("{i}_depth.png"),
        );
        for i in 0..FRAMES {
            let flat = ImageBuffer::<Luma<u8>, _>::from_pixel(SIZE.0, SIZE.1, Luma([2]));
            flat.save(root.join(format!("{i}_conf.png"))).unwrap();
        }
    });
    let sequence = open(folder.path()).unwrap();
    assert_right(&sequence);
    let said = warnings(&sequence);
    assert!(said.contains("0_conf"), "{said}");
    // A folder of depth images alone is one of images.
    let folder = folder_with(|root| {
        write_loose(
            root,
            |i| format!("depthcam_{i}.png"),
            |i| format!("depth/{i}.png"),
        );
    });
    assert_right(&open(folder.path()).unwrap());
}

/// Rewrites the depth images: the value of a depth in metres at a pixel.
fn rewrite_depth(root: &Path, value: impl Fn(f64, f64) -> f64) {
    for (at, pose) in poses(FRAMES).iter().enumerate() {
        let depth = depth_image(pose, 10_000.0);
        let image = ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
            let [x_at, y_at] = [(x, SIZE.0), (y, SIZE.1)]
                .map(|(at, side)| (f64::from(at) - f64::from(side - 1) / 2.0) / FOCAL);
            let ray = (1.0 + x_at * x_at + y_at * y_at).sqrt();
            let depth = f64::from(depth.get_pixel(x, y).0[0]) / 10_000.0;
            Luma([value(depth, ray).round() as u16])
        });
        image.save(root.join(format!("depth/{at}.png"))).unwrap();
    }
}

#[test]
fn inverse_depth_and_distance_are_named_and_read() {
    type Value = fn(f64, f64) -> f64;
    let kinds: [(Value, DepthValues, &[&str]); 2] = [
        (
            |depth, _| 20_000.0 / depth,
            DepthValues::InverseDepth,
            &["values = \"inverse-depth\"", "scale = 20"],
        ),
        (
            |depth, ray| 1000.0 * depth * ray,
            DepthValues::Distance,
            &["values = \"distance\""],
        ),
    ];
    for (value, values, words) in kinds {
        let folder = folder_with(|root| {
            write_plain(root);
            rewrite_depth(root, value);
        });
        let text = check_images(&open(folder.path()).unwrap())
            .unwrap()
            .contradiction;
        let text = text.unwrap_or_else(|| panic!("{values:?} is not noticed"));
        assert!(words.iter().all(|word| text.contains(word)), "{text}");
        let lines = text.split_once("linecarve.toml:\n").unwrap().1;
        let lines: String = lines
            .lines()
            .map(|line| line.trim().to_owned() + "\n")
            .collect();
        let lines = match values {
            // The search gives three digits of a scale that is not common.
            DepthValues::InverseDepth => "[depth]\nvalues = \"inverse-depth\"\nscale = 20000.0\n",
            _ => &lines,
        };
        edit(&folder.path().join("linecarve.toml"), |text| text + lines);
        let sequence = open(folder.path()).unwrap();
        assert_eq!(sequence.depth_calibration().unwrap().values, values);
        assert_right(&sequence);
        // Told wrongly, the other way round.
        rewrite_depth(folder.path(), |depth, _| 1000.0 * depth);
        let text = check_images(&open(folder.path()).unwrap())
            .unwrap()
            .contradiction;
        let text = text.unwrap_or_else(|| panic!("{values:?} is not noticed"));
        assert!(text.contains("values = \"depth\""), "{text}");
    }
}

#[test]
fn standard_deviations_need_depth_along_the_axis() {
    let folder = folder_with(|root| {
        write_plain(root);
        edit(&root.join("linecarve.toml"), |text| {
            text + "[depth]\nvalues = \"distance\"\nsigma = \"sigma\"\n"
        });
    });
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("sigma") && error.contains("values = \"distance\""),
        "{error}"
    );
}

#[test]
fn depth_that_nothing_explains_is_refused() {
    let folder = folder_with(|root| {
        write_plain(root);
        // Each image has a depth of its own, which has nothing to do with the scene.
        for at in 0..FRAMES {
            let flat = ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, y| {
                let mixed = (x / 8 + 3 * (y / 8)) as usize * 7 + at * 5;
                Luma([600 + 900 * (mixed % 6) as u16])
            });
            flat.save(root.join(format!("depth/{at}.png"))).unwrap();
        }
    });
    let text = check_images(&open(folder.path()).unwrap())
        .unwrap()
        .contradiction;
    let text = text.expect("noticed");
    assert!(text.contains("disagree by"), "{text}");
}

#[test]
fn a_camera_in_json_is_read() {
    let write = |root: &Path| {
        write_plain(root);
        std::fs::remove_file(root.join("linecarve.toml")).unwrap();
    };
    let folder = folder_with(write);
    let path = folder.path().join("intrinsics.json");
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("no file gives the camera"), "{error}");
    let [cx, cy] = [SIZE.0, SIZE.1].map(|side| f64::from(side - 1) / 2.0);
    for text in [
        format!(
            "{{\"w\": {}, \"h\": {}, \"fx\": {FOCAL}, \"fy\": {FOCAL}, \"cx\": {cx}, \"cy\": {cy}}}",
            SIZE.0, SIZE.1
        ),
        format!("{{\"fx\": {FOCAL}, \"fy\": {FOCAL}, \"cx\": {cx}, \"cy\": {cy}}}"),
    ] {
        std::fs::write(&path, text).unwrap();
        assert_right(&open(folder.path()).unwrap());
    }
    // What is none is named, with the reason.
    std::fs::write(&path, "{\"focal\": 60}").unwrap();
    let error = open(folder.path()).unwrap_err();
    assert!(error.contains("intrinsics.json looks like them"), "{error}");
}

#[test]
fn cameras_of_scan_info_are_read() {
    let k = |scale: f64| {
        let text = intrinsics_text(scale);
        let rows: Vec<&str> = text.lines().collect();
        format!("{} 0 {} 0 {} 0 0 0 0 1", rows[0], rows[1], rows[2])
    };
    let identity = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
    let info = |depth_size: u32, depth_scale: f64, extrinsic: &str| {
        format!(
            "m_versionNumber = 4\nm_sensorName = a sensor\nm_colorWidth = {}\nm_colorHeight = {}\nm_depthWidth = {}\nm_depthHeight = {}\n\
             m_depthShift = 1000\nm_calibrationColorIntrinsic = {}\nm_calibrationDepthIntrinsic = {}\nm_calibrationDepthExtrinsic = {extrinsic}\n",
            SIZE.0,
            SIZE.1,
            SIZE.0 / depth_size,
            SIZE.1 / depth_size,
            k(1.0),
            k(depth_scale)
        )
    };
    for name in ["info.txt", "_info.txt"] {
        let folder = folder_with(|root| {
            write_seven_scenes(root, FRAMES);
            std::fs::remove_file(root.join("camera-intrinsics.txt")).unwrap();
            std::fs::write(root.join(name), info(1, 1.0, identity)).unwrap();
        });
        let sequence = open(folder.path()).unwrap();
        assert!(sequence.depth_calibration().unwrap().registered);
        assert_right(&sequence);
        let path = folder.path().join(name);
        for (text, words) in [
            (
                info(1, 1.0, &identity.replace("1 0 0 0 0 1", "1 0 0 0.1 0 1")),
                "line 10",
            ),
            (
                info(1, 1.0, identity).replace("Shift = 1000", "Shift = -1"),
                "line 7",
            ),
            (
                info(1, 1.0, identity).replace("Shift = 1000", "Shift = x"),
                "line 7",
            ),
            (
                info(1, 1.0, identity).replace("DepthIntrinsic", "DepthIntrinsics"),
                "has no m_calibrationDepthIntrinsic",
            ),
        ] {
            std::fs::write(&path, text).unwrap();
            let error = open(folder.path()).unwrap_err();
            assert!(error.contains(name) && error.contains(words), "{error}");
        }
        // Depth of half the size.
        for at in 0..FRAMES {
            let path = folder.path().join(format!("frame-{at:06}.depth.png"));
            let image = image::open(&path).unwrap();
            let half =
                image.resize_exact(SIZE.0 / 2, SIZE.1 / 2, image::imageops::FilterType::Nearest);
            half.save(path).unwrap();
        }
        std::fs::write(&path, info(2, 0.5, identity)).unwrap();
        let sequence = open(folder.path()).unwrap();
        let depth = sequence.depth_calibration().unwrap();
        assert!(!depth.registered && (depth.camera.fx() - 0.5 * FOCAL).abs() < 1e-9);
        assert_eq!(check_images(&sequence).unwrap().contradiction, None);
    }
}

#[test]
fn transposed_matrices_are_refused_with_the_line() {
    let folder = folder_with(|root| {
        write_plain(root);
        let lines: String = poses(FRAMES)
            .iter()
            .map(|pose| {
                let numbers: Vec<String> = pose
                    .to_homogeneous()
                    .iter()
                    .map(ToString::to_string)
                    .collect();
                numbers.join(" ") + "\n"
            })
            .collect();
        std::fs::write(root.join("poses.txt"), lines).unwrap();
    });
    let error = open(folder.path()).unwrap_err();
    assert!(
        error.contains("poses.txt, line 2") && error.contains("transposed"),
        "{error}"
    );
}

#[test]
fn a_trajectory_of_any_name_and_poses_beside_images_are_not_passed_over() {
    let without_poses =
        |root: &Path| Sequence::open_without_poses(root, &OpenOptions::default()).unwrap();
    for name in ["camera_path_v2.dat", "POSES.TXT", "path"] {
        let folder = folder_with(|root| {
            write_plain(root);
            std::fs::rename(root.join("poses.txt"), root.join(name)).unwrap();
        });
        let sequence = without_poses(folder.path());
        let [unread] = sequence.unread_files() else {
            panic!("{name}: {:?}", sequence.unread_files());
        };
        assert_eq!((unread.name.as_str(), unread.role), (name, FileRole::Poses));
        let problem = unread.problem(folder.path());
        assert!(problem.contains("--poses"), "{problem}");
    }
    let folder = folder_with(|root| {
        write_loose(
            root,
            |i| format!("frame_{i:05}.png"),
            |i| format!("depth_{i:05}.png"),
        );
        std::fs::remove_file(root.join("poses.txt")).unwrap();
        for i in 0..FRAMES {
            let text = "{\"cameraPoseARFrame\": [1, 0, 0, 0]}";
            std::fs::write(root.join(format!("frame_{i:05}.json")), text).unwrap();
        }
    });
    let sequence = without_poses(folder.path());
    let [unread] = sequence.unread_files() else {
        panic!("{:?}", sequence.unread_files());
    };
    assert_eq!(
        (unread.name.as_str(), unread.role),
        ("frame_00000.json", FileRole::Poses)
    );
}

#[test]
fn a_sequence_one_folder_down_is_named() {
    let folder = folder_with(|root| {
        std::fs::create_dir(root.join("sequence")).unwrap();
        write_seven_scenes(&root.join("sequence"), FRAMES);
    });
    let without = Sequence::open_without_poses(folder.path(), &OpenOptions::default());
    for error in [
        open(folder.path()).unwrap_err(),
        without.unwrap_err().to_string(),
    ] {
        assert!(error.contains("sequence is a sequence"), "{error}");
    }
}

#[test]
fn counted_poses_from_another_number_are_joined_as_the_images_show() {
    // Poses from 1, images from 0.
    let folder = folder_with(|root| write_icl(root, 1));
    let sequence = open(folder.path()).unwrap();
    assert_right(&sequence);
    let said = warnings(&sequence);
    assert!(said.contains("joined in order"), "{said}");
}

#[test]
fn depth_of_the_frame_beside_is_not_blamed_on_the_poses() {
    // A camera that moves evenly sees the same from one frame to the next.
    let all = poses(12);
    let uneven = [0, 1, 4, 5, 9, 10].map(|at| all[at]);
    let folder = folder_with(|root| {
        for folder in ["rgb", "depth"] {
            std::fs::create_dir(root.join(folder)).unwrap();
        }
        for (at, pose) in uneven.iter().enumerate() {
            color_image(pose)
                .save(root.join(format!("rgb/{at}.png")))
                .unwrap();
            let depth = depth_image(&uneven[at.saturating_sub(1)], 1000.0);
            depth.save(root.join(format!("depth/{at}.png"))).unwrap();
        }
        let lines: String = uneven.iter().map(one_line).collect();
        std::fs::write(root.join("poses.txt"), lines).unwrap();
        std::fs::write(root.join("linecarve.toml"), sidecar()).unwrap();
    });
    let text = check_images(&open(folder.path()).unwrap())
        .unwrap()
        .contradiction;
    let text = text.expect("noticed");
    assert!(text.contains("previous image"), "{text}");
    assert!(text.contains("poses.txt"), "{text}");
}
