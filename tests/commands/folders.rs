//! Folders as people have them: a wrong convention, a file that is not read or a file of another program ends in an error that names it and
//! the remedy, never in a wrong surface with exit status 0.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use linecarve_sequence::{OpenOptions, Sequence};

use crate::program::{expect_status, linecarve, stderr, text};
use crate::room_folders::{
    Axes, LAYOUTS, RIGHT, Room, Values, Writing, matrix_lines, sidecar, write, write_scannet,
    write_tum,
};

/// What is broken, how, and what the error must say.
const FAULTS: [(&str, Writing, &str); 16] = [
    (
        "scale",
        Writing {
            depth: 0.2,
            ..RIGHT
        },
        "[depth]",
    ),
    (
        "inverse depth",
        Writing {
            values: Values::Inverse,
            ..RIGHT
        },
        "values = \"inverse-depth\"",
    ),
    (
        "distance",
        Writing {
            values: Values::Distance,
            ..RIGHT
        },
        "values = \"distance\"",
    ),
    (
        "unit",
        Writing {
            unit: 1000.0,
            ..RIGHT
        },
        "[depth]",
    ),
    (
        "inverse",
        Writing {
            is_inverse: true,
            ..RIGHT
        },
        "direction = \"inverse\"",
    ),
    (
        "axes",
        Writing {
            axes: Axes::OpenGl,
            ..RIGHT
        },
        "axes = \"y-and-z-flipped\"",
    ),
    (
        "body",
        Writing {
            axes: Axes::Body,
            ..RIGHT
        },
        "axes = \"",
    ),
    (
        "left-handed",
        Writing {
            axes: Axes::Unity,
            ..RIGHT
        },
        "axes = \"",
    ),
    (
        "still",
        Writing {
            is_still: true,
            ..RIGHT
        },
        "poses are the same",
    ),
    (
        "mirrored depth",
        Writing {
            has_mirrored_depth: true,
            ..RIGHT
        },
        "turned or mirrored against the images",
    ),
    (
        "quaternion",
        Writing {
            is_w_first: true,
            ..RIGHT
        },
        "quaternion = \"w-first\"",
    ),
    (
        "scrambled",
        Writing {
            is_scrambled: true,
            ..RIGHT
        },
        "check that",
    ),
    (
        "moved depth",
        Writing {
            moved_depth: 12,
            ..RIGHT
        },
        "not registered to colour",
    ),
    (
        "focal length",
        Writing {
            focal: 1.5,
            ..RIGHT
        },
        "fx =",
    ),
    (
        "aspect",
        Writing {
            aspect: 0.75,
            ..RIGHT
        },
        "fx =",
    ),
    ("join", Writing { shift: 1, ..RIGHT }, "the next image"),
];

/// Reconstructs every frame; the output of the program and the mesh.
fn reconstruct(sequence: &Path, more: &[&str]) -> (std::process::Output, PathBuf) {
    let out = sequence.with_extension("out");
    let mut arguments = vec![
        "reconstruct",
        text(sequence),
        "--every",
        "1",
        "--final-only",
        "--no-picture",
        "--no-page",
        "--out",
        text(&out),
    ];
    arguments.extend(more);
    let output = linecarve(arguments);
    (output, out.join("mesh.ply"))
}

/// F at 5 cm against the surface that the frames see.
fn f_score(mesh: &Path, truth: &Path) -> f64 {
    let output = expect_status(
        0,
        [
            "evaluate",
            text(mesh),
            "--ground-truth",
            text(truth),
            "--thresholds",
            "0.05",
            "--samples",
            "20000",
            "--json",
        ],
    );
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let score = found.pointer("/at/0/f").and_then(serde_json::Value::as_f64);
    score.unwrap_or_else(|| panic!("{found}"))
}

#[test]
fn a_broken_convention_is_never_a_wrong_surface_in_silence() {
    let room = Room::new(10);
    let folder = tempfile::tempdir().unwrap();
    let mut table = String::new();
    let mut is_wrong = false;
    for (layout, write, has_quaternions) in LAYOUTS {
        let right = folder.path().join(format!("{layout}-right"));
        write(&room, &RIGHT, &right);
        let (output, mesh) = reconstruct(&right, &[]);
        assert!(output.status.success(), "{layout}: {}", stderr(&output));
        let whole = f_score(&mesh, &room.truth());
        assert!(whole > 0.3, "{layout}: F {whole}");
        for (fault, how, words) in FAULTS {
            if fault == "quaternion" && !has_quaternions {
                continue;
            }
            let broken = folder.path().join(format!("{layout}-{fault}"));
            write(&room, &how, &broken);
            let (output, mesh) = reconstruct(&broken, &[]);
            let said = stderr(&output);
            let is_right = match output.status.code() {
                Some(2) => said.contains(words) && said.contains("--accept-as-is"),
                Some(0) => f_score(&mesh, &room.truth()) > 0.9 * whole,
                _ => false,
            };
            is_wrong |= !is_right;
            writeln!(
                table,
                "{layout:<12} {fault:<12} {:?} {is_right} {said}",
                output.status.code()
            )
            .unwrap();
            std::fs::remove_dir_all(broken).unwrap();
        }
    }
    assert!(!is_wrong, "{table}");
}

/// Poses of five images before are named, those of ten images before are refused.
#[test]
fn poses_of_other_times_are_refused_or_named() {
    let late = Writing { shift: 5, ..RIGHT };
    let room = Room::new(10);
    let small = tempfile::tempdir().unwrap();
    write_tum(&room, &late, small.path());
    let (output, _) = reconstruct(small.path(), &[]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("poses (clock, order, number)"), "{said}");
    let folder = tempfile::tempdir().unwrap();
    let large = folder.path().join("room");
    expect_status(
        0,
        [
            "synth",
            "room",
            "--frames",
            "24",
            "--size",
            "320x240",
            "--out",
            text(&large),
        ],
    );
    let file = large.join("groundtruth.txt");
    let lines = std::fs::read_to_string(&file).unwrap();
    let rows: Vec<(&str, &str)> = lines
        .lines()
        .filter_map(|line| line.split_once(' '))
        .filter(|row| row.0.parse::<f64>().is_ok())
        .collect();
    let late: String = rows
        .iter()
        .skip(10)
        .zip(&rows)
        .map(|((stamp, _), (_, pose))| format!("{stamp} {pose}\n"))
        .collect();
    std::fs::write(&file, late).unwrap();
    let (output, _) = reconstruct(&large, &[]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(said.contains("matched corners lie"), "{said}");
}

/// The file of the intrinsics in each layout that has one of its own.
const CALIBRATIONS: [(&str, &str); 6] = [
    ("tum", "linecarve.toml"),
    ("7-scenes", "camera-intrinsics.txt"),
    ("open3d", "camera.json"),
    ("scannet", "intrinsics.txt"),
    ("replica", "cam_params.json"),
    ("poses.txt", "linecarve.toml"),
];

#[test]
fn a_missing_calibration_is_never_a_wrong_surface_in_silence() {
    let room = Room::new(10);
    let folder = tempfile::tempdir().unwrap();
    for (layout, write, _) in LAYOUTS {
        let Some((_, file)) = CALIBRATIONS.iter().find(|(name, _)| *name == layout) else {
            continue;
        };
        let broken = folder.path().join(layout);
        write(&room, &RIGHT, &broken);
        std::fs::remove_file(broken.join(file)).unwrap();
        let (output, _) = reconstruct(&broken, &[]);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "{layout}: {said}");
        assert!(
            said.contains("linecarve.toml") || said.contains("--calibration"),
            "{layout}: {said}"
        );
    }
}

#[test]
fn accept_as_is_goes_on_with_a_warning() {
    let room = Room::new(6);
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("scale");
    write_tum(
        &room,
        &Writing {
            depth: 0.2,
            ..RIGHT
        },
        &broken,
    );
    let (output, _) = reconstruct(&broken, &["--accept-as-is"]);
    let said = stderr(&output);
    assert!(
        output.status.success() && said.contains("scale = 1000.0"),
        "{said}"
    );
}

#[test]
fn poses_that_are_not_read_stop_the_run_before_tracking() {
    let room = Room::new(6);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("recording");
    write_scannet(&room, &RIGHT, &path);
    std::fs::rename(path.join("pose"), path.join("cams")).unwrap();
    let (output, _) = reconstruct(&path, &[]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(2), "{said}");
    assert!(
        said.contains("cams") && said.contains("--accept-as-is"),
        "{said}"
    );
    // `track` needs no poses, but depth.
    let depth = path.join("sparse_depth");
    std::fs::rename(path.join("depth"), &depth).unwrap();
    let output = expect_status(
        2,
        [
            "track",
            text(&path),
            "--out",
            text(&folder.path().join("out")),
        ],
    );
    let said = stderr(&output);
    assert!(
        said.contains("sparse_depth") && !said.contains("cams"),
        "{said}"
    );
}

#[test]
fn depth_that_is_moved_against_the_images_stops_a_run_before_tracking() {
    let room = Room::new(10);
    let folder = tempfile::tempdir().unwrap();
    let moved = Writing {
        moved_depth: 12,
        ..RIGHT
    };
    let path = folder.path().join("recording");
    write_tum(&room, &moved, &path);
    std::fs::remove_file(path.join("groundtruth.txt")).unwrap();
    let out = folder.path().join("out");
    for command in ["track", "reconstruct"] {
        let said = stderr(&expect_status(
            2,
            [command, text(&path), "--out", text(&out)],
        ));
        assert!(said.contains("not registered to colour"), "{said}");
    }
}

#[test]
fn numbered_poses_that_count_from_another_number_are_joined_in_order() {
    let room = Room::new(24);
    let folder = tempfile::tempdir().unwrap();
    // Images count from 1, the log from 0.
    {
        let path = folder.path().join("from-0");
        let mut log = String::new();
        for at in 0..room.poses.len() {
            room.copy_color(at, &path.join(format!("images/{:06}", at + 1)));
            let (number, pose) = (at, room.poses[at]);
            write!(
                log,
                "{number} {number} {}\n{}",
                number + 1,
                matrix_lines(&pose)
            )
            .unwrap();
        }
        write(&path.join("Room_COLMAP_SfM.log"), &log);
        write(&path.join("camera.toml"), &sidecar(RIGHT.camera(&room)));
        let mut options = OpenOptions::default();
        options.poses = Some(path.join("Room_COLMAP_SfM.log"));
        options.calibration = Some(path.join("camera.toml"));
        let sequence = Sequence::open(&path.join("images"), &options).unwrap();
        let said: String = sequence
            .warnings()
            .iter()
            .map(|w| format!("{w}\n"))
            .collect();
        assert!(said.contains("joined in order"), "{said}");
        for frame in sequence.frames() {
            let number: usize = frame.name.parse().unwrap();
            let off = frame.world_from_camera.inverse() * room.poses[number - 1];
            assert!(off.translation.vector.norm() < 1e-6, "{}", frame.name);
        }
    }
}

#[test]
fn files_of_other_programs_are_named_with_the_way_in() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, words) in [
        (
            "clip.mkv",
            b"\x1A\x45\xDF\xA3....matroska".as_slice(),
            ["Matroska", "ffmpeg -i"],
        ),
        ("clip.avi", b"RIFF\0\0\0\0AVI LIST", ["AVI", "ffmpeg -i"]),
        (
            "recording.bag",
            b"#ROSBAG V2.0\n",
            ["ROS 1", "--poses FILE"],
        ),
        (
            "reconstruction.json",
            b"[{\"cameras\": {\"c\": {\"projection_type\": 1}}}]",
            ["OpenSfM", "export_colmap"],
        ),
        (
            "cameras.sfm",
            b"{\"views\": [], \"poses\": []}",
            ["Meshroom", "exportColmap"],
        ),
        ("bundle.out", b"# Bundle file v0.3\n", ["Bundler", "COLMAP"]),
        (
            "sfm_data.json",
            b"{\"sfm_data_version\": \"0.3\"}",
            ["OpenMVG", "Colmap"],
        ),
        (
            "cameras.xml",
            b"<document version=\"2\"><chunk/></document>",
            ["Metashape", "COLMAP"],
        ),
    ] {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        for command in ["info", "reconstruct"] {
            let mut arguments = vec![command, text(&path)];
            let out = folder.path().join("out");
            if command == "reconstruct" {
                arguments.extend(["--out", text(&out)]);
            }
            let said = stderr(&expect_status(2, arguments));
            assert!(
                words.iter().all(|word| said.contains(word)),
                "{command}: {said}"
            );
            assert!(said.contains(name), "{said}");
        }
    }
}

#[test]
fn what_is_wrong_with_images_without_poses_is_said() {
    let room = Room::new(3);
    let folder = tempfile::tempdir().unwrap();
    for frame in 0..3 {
        room.copy_color(frame, &folder.path().join(format!("rgb/{frame}")));
    }
    let camera = r#"{"width": 640, "height": 480, "intrinsic_matrix": [525, 0, 0, 0, 525, 0, 319.5, 239.5, 1]}"#;
    std::fs::write(folder.path().join("camera_intrinsic.json"), camera).unwrap();
    let out = folder.path().join("out");
    let command = ["reconstruct", text(folder.path()), "--out", text(&out)];
    let said = stderr(&expect_status(2, command));
    assert!(
        said.contains("by camera_intrinsic.json") && !said.contains("no known layout"),
        "{said}"
    );
}
