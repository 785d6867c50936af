//! `track`, `evaluate --trajectory`, and `reconstruct` without poses, on the rendered sample and on bad input.

use std::path::{Path, PathBuf};

use crate::program::{data, expect_status, stderr};

/// The sample of the project: 36 frames, 0.1 s apart, with exact poses and depth.
fn room() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room")
}

/// The sample without its poses.
pub(crate) fn room_without_poses(frames: usize) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["rgb", "depth"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
        let list = std::fs::read_to_string(room().join(format!("{name}.txt"))).unwrap();
        let lines: Vec<&str> = list.lines().take(frames + 1).collect();
        for file in lines[1..].iter().filter_map(|line| line.split(' ').nth(1)) {
            std::fs::copy(room().join(file), folder.path().join(file)).unwrap();
        }
        std::fs::write(folder.path().join(format!("{name}.txt")), lines.join("\n")).unwrap();
    }
    std::fs::copy(
        room().join("linecarve.toml"),
        folder.path().join("linecarve.toml"),
    )
    .unwrap();
    folder
}

fn json(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn text(path: impl AsRef<Path>) -> String {
    path.as_ref().to_str().unwrap().to_owned()
}

#[test]
fn the_sample_is_tracked_and_every_frame_has_a_pose() {
    let out = tempfile::tempdir().unwrap();
    let mut outputs = Vec::new();
    for threads in ["1", "2"] {
        let folder = out.path().join(threads);
        expect_status(
            0,
            [
                "track",
                &text(room()),
                "--out",
                &text(&folder),
                "--threads",
                threads,
                "--quiet",
            ],
        );
        let read = |name: &str| std::fs::read(folder.join(name)).unwrap();
        outputs.push((read("poses.txt"), read("points.ply")));
    }
    assert!(
        outputs[0] == outputs[1],
        "the number of threads changes poses or points"
    );
    let folder = out.path().join("1");
    let report = json(&folder.join("track.json"));
    assert_eq!(report["frames"], report["tracked"], "{report}");
    assert_eq!(report["submaps"].as_array().unwrap().len(), 1);
    let output = expect_status(
        0,
        [
            "evaluate",
            "--trajectory",
            &text(folder.join("poses.txt")),
            "--reference",
            &text(room().join("groundtruth.txt")),
            "--json",
        ],
    );
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let (rmse, path) = (
        found["position"]["rmse"].as_f64().unwrap(),
        found["path"].as_f64().unwrap(),
    );
    assert!(rmse < 0.005 * path && rmse < 0.02, "{found}");
    assert_eq!(found["coverage"], 1.0);
}

#[test]
fn what_a_recording_lacks_is_refused() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().join("out");
    let (input, output) = (text(room()), text(&folder));
    let output = expect_status(2, ["track", &input, "--out", &output, "--mode", "stereo"]);
    let error = stderr(&output);
    assert!(error.contains("calibrated right camera"), "{error}");
    assert!(!folder.exists());
}

#[test]
fn causal_poses_of_one_camera_begin_with_its_map() {
    let out = tempfile::tempdir().unwrap();
    let (input, output) = (text(room()), text(out.path()));
    let arguments = ["--mode", "mono", "--causal", "--quiet"];
    let arguments = ["track", &input, "--out", &output]
        .into_iter()
        .chain(arguments);
    expect_status(0, arguments);
    let report = json(&out.path().join("track.json"));
    let without = report["without_pose"].as_array().unwrap();
    assert!((6..30).contains(&without.len()), "{}", without.len());
    let reason = without[0]["reason"].as_str().unwrap();
    assert!(reason.contains("no map yet"), "{reason}");
    let poses = std::fs::read_to_string(out.path().join("poses.txt")).unwrap();
    let rows = poses.lines().filter(|line| !line.starts_with('#')).count();
    assert_eq!(rows, 36 - without.len());
}

#[test]
fn one_camera_tracks_the_sample_without_its_depth() {
    let folder = room_without_poses(15);
    std::fs::remove_file(folder.path().join("depth.txt")).unwrap();
    std::fs::remove_dir_all(folder.path().join("depth")).unwrap();
    let out = tempfile::tempdir().unwrap();
    let poses = ["1", "2"].map(|threads| {
        let folder_out = out.path().join(threads);
        expect_status(
            0,
            [
                "track",
                &text(folder.path()),
                "--out",
                &text(&folder_out),
                "--threads",
                threads,
                "--quiet",
            ],
        );
        std::fs::read(folder_out.join("poses.txt")).unwrap()
    });
    assert!(
        poses[0] == poses[1],
        "the number of threads changes the poses"
    );
    let report = json(&out.path().join("1").join("track.json"));
    assert_eq!(report["mode"], "mono");
    assert!(report["coverage"].as_f64().unwrap() > 0.9, "{report}");
    let output = expect_status(
        0,
        [
            "evaluate",
            "--trajectory",
            &text(out.path().join("1/poses.txt")),
            "--reference",
            &text(room().join("groundtruth.txt")),
            "--align",
            "sim3",
            "--json",
        ],
    );
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let rmse = found["position"]["rmse"].as_f64().unwrap();
    assert!(rmse < 0.05, "{found}");
    // The surface without being asked to track.
    let surface = out.path().join("surface");
    let output = expect_status(
        0,
        [
            "reconstruct",
            &text(folder.path()),
            "--final-only",
            "--no-picture",
            "--out",
            &text(&surface),
        ],
    );
    let warned = stderr(&output);
    assert!(
        warned.contains("they are found from the images"),
        "{warned}"
    );
    assert!(warned.contains("the unit of all lengths"), "{warned}");
    assert!(surface.join("mesh.ply").exists() && surface.join("trajectory.txt").exists());
}

/// Grey values of the first images of the sample as an uncompressed video.
fn video_of_the_room(frames: usize) -> Vec<u8> {
    let list = std::fs::read_to_string(room().join("rgb.txt")).unwrap();
    let mut bytes = b"YUV4MPEG2 W640 H480 F10:1 Cmono XCOLORRANGE=FULL\n".to_vec();
    for file in list
        .lines()
        .skip(1)
        .filter_map(|line| line.split(' ').nth(1))
        .take(frames)
    {
        bytes.extend(b"FRAME\n");
        bytes.extend(
            image::open(room().join(file))
                .unwrap()
                .into_luma8()
                .into_raw(),
        );
    }
    bytes
}

#[test]
fn a_video_without_calibration_is_tracked_and_leaves_a_sequence() {
    let out = tempfile::tempdir().unwrap();
    let video = out.path().join("room.y4m");
    std::fs::write(&video, video_of_the_room(18)).unwrap();
    let folder = out.path().join("out");
    let output = expect_status(0, ["track", &text(&video), "--out", &text(&folder)]);
    assert!(
        stderr(&output).contains("px is estimated"),
        "{}",
        stderr(&output)
    );
    let report = json(&folder.join("track.json"));
    let focal = report["calibration"]["fx"].as_f64().unwrap();
    assert!((focal / 525.0 - 1.0).abs() < 0.06, "{focal}");
    assert!(report["coverage"].as_f64().unwrap() > 0.9, "{report}");
    // Images, times, poses and calibration are a sequence.
    let output = expect_status(0, ["info", &text(&folder)]);
    let shown = String::from_utf8_lossy(&output.stdout);
    assert!(shown.contains("images-and-poses"), "{shown}");
    // From a pipe, with a calibration.
    let piped = out.path().join("piped");
    let mut program = assert_cmd::Command::cargo_bin("linecarve").unwrap();
    program
        .args(["track", "-", "--quiet", "--out", &text(&piped)])
        .args(["--calibration", &text(room().join("linecarve.toml"))])
        .write_stdin(video_of_the_room(10))
        .assert()
        .success();
    let report = json(&piped.join("track.json"));
    assert_eq!(report["calibration"]["fx"], 525.0);
    assert!(report["coverage"].as_f64().unwrap() > 0.9, "{report}");
}

#[test]
fn info_tells_what_a_recording_without_poses_holds() {
    let folder = room_without_poses(3);
    let input = text(folder.path());
    let output = expect_status(0, ["info", &input]);
    let shown = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(shown.contains("motion     unknown"), "{shown}");
    assert!(shown.contains("depth      3 frames"), "{shown}");
    assert!(!shown.contains("agreement"), "{shown}");
    let warned = stderr(&output);
    assert!(
        warned.contains("find them from images with depth"),
        "{warned}"
    );
    let output = expect_status(0, ["info", &input, "--json"]);
    let facts: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(
        facts["motion"].is_null() && facts["epipolar"].is_null(),
        "{facts}"
    );
    // Images alone, without calibration.
    std::fs::remove_file(folder.path().join("linecarve.toml")).unwrap();
    let output = expect_status(0, ["info", &text(folder.path().join("rgb"))]);
    let warned = stderr(&output);
    assert!(
        warned.contains("find them from images of one camera"),
        "{warned}"
    );
    assert!(!warned.contains("layout"), "{warned}");
    // Poses that were asked for must be there.
    let output = expect_status(2, ["info", &input, "--poses", "none.txt"]);
    assert!(stderr(&output).contains("none.txt"));
    let video = folder.path().join("room.y4m");
    std::fs::write(&video, video_of_the_room(36)).unwrap();
    let output = expect_status(0, ["info", &text(&video)]);
    let shown = String::from_utf8(output.stdout).unwrap();
    assert!(
        shown.contains("Y4M") && shown.contains("linecarve track"),
        "{shown}"
    );
}

#[test]
fn the_pair_that_starts_the_map_and_further_formats_can_be_given() {
    let folder = room_without_poses(12);
    let out = tempfile::tempdir().unwrap();
    let (input, output) = (text(folder.path()), text(out.path()));
    let run = |status: i32, extra: &[&str]| {
        let mut arguments = vec!["track", &input, "--mode", "mono", "--out", &output];
        arguments.extend(extra);
        stderr(&expect_status(status, arguments))
    };
    run(
        0,
        &["--start-pair", "2,3", "--format", "kitti,euroc,open3d-log"],
    );
    let report = json(&out.path().join("track.json"));
    assert!(report["coverage"].as_f64().unwrap() > 0.8, "{report}");
    let count = |name: &str| {
        let file = std::fs::read_to_string(out.path().join(name)).unwrap();
        file.lines().filter(|line| !line.starts_with('#')).count() as u64
    };
    let tracked = report["tracked"].as_u64().unwrap();
    assert_eq!(
        ["poses.txt", "poses-kitti.txt", "poses.csv"].map(count),
        [tracked; 3]
    );
    assert_eq!(count("poses.log"), 5 * tracked);
    let picture = image::open(out.path().join("path.png"))
        .unwrap()
        .into_rgb8();
    let blue = picture
        .pixels()
        .filter(|pixel| pixel.0[2] > pixel.0[0].saturating_add(60))
        .count();
    assert!(blue > 50, "{blue}");
    for (pair, reason) in [
        ("2", "two frames"),
        ("2,2", "the same"),
        ("2,nowhere", "neither a name"),
        ("2,12", "below 12"),
    ] {
        let message = run(2, &["--start-pair", pair]);
        assert!(message.contains(reason), "{message}");
    }
}

#[test]
fn damaged_videos_are_refused_with_a_remedy() {
    let out = tempfile::tempdir().unwrap();
    for (bytes, reason) in [
        (&b"YUV4MPEG2 W640 H480 C420p16\nFRAME\n"[..], "-pix_fmt"),
        (b"YUV4MPEG2 W640 H480\nFRAME\nxyz", "cut off"),
        (b"\0\0\0\x10ftypisom\0\0\0\0", "moov"),
    ] {
        let video = out.path().join("video");
        std::fs::write(&video, bytes).unwrap();
        let poses = out.path().join("out");
        let output = expect_status(2, ["track", &text(&video), "--out", &text(&poses)]);
        let message = stderr(&output);
        assert!(
            message.contains(reason) && message.contains("byte"),
            "{message}"
        );
    }
}

#[test]
fn an_unreadable_image_is_named_and_left_out() {
    let folder = room_without_poses(6);
    let list = std::fs::read_to_string(folder.path().join("rgb.txt")).unwrap();
    let file = list.lines().nth(4).unwrap().split(' ').nth(1).unwrap();
    std::fs::write(folder.path().join(file), "no image").unwrap();
    let out = tempfile::tempdir().unwrap();
    let output = expect_status(
        0,
        ["track", &text(folder.path()), "--out", &text(out.path())],
    );
    let name = Path::new(file).file_name().unwrap().to_str().unwrap();
    assert!(stderr(&output).contains(name), "{}", stderr(&output));
    let report = json(&out.path().join("track.json"));
    assert_eq!(
        (&report["tracked"], &report["frames"]),
        (&5.into(), &6.into())
    );
    let reason = report["without_pose"][0]["reason"].as_str().unwrap();
    assert!(reason.contains(name), "{reason}");
}

/// Names of the colour images of a recording.
fn color_files(folder: &Path) -> Vec<String> {
    let list = std::fs::read_to_string(folder.join("rgb.txt")).unwrap();
    let name = |line: &str| line.split(' ').nth(1).map(str::to_owned);
    list.lines().skip(1).filter_map(name).collect()
}

#[test]
fn black_frames_are_posed_by_their_depth_or_said() {
    let folder = room_without_poses(12);
    let files = color_files(folder.path());
    for file in &files[5..7] {
        let path = folder.path().join(file);
        image::RgbImage::new(640, 480).save(path).unwrap();
    }
    let out = tempfile::tempdir().unwrap();
    expect_status(
        0,
        ["track", &text(folder.path()), "--out", &text(out.path())],
    );
    let report = json(&out.path().join("track.json"));
    assert_eq!(report["tracked"], 12, "{report}");
    assert_eq!(report["tracked_by_depth"], 2, "{report}");

    // Without their depth they have none.
    let list = std::fs::read_to_string(folder.path().join("depth.txt")).unwrap();
    let rest: Vec<&str> = list
        .lines()
        .enumerate()
        .filter(|(at, _)| !(6..8).contains(at))
        .map(|(_, line)| line)
        .collect();
    std::fs::write(folder.path().join("depth.txt"), rest.join("\n")).unwrap();
    let output = expect_status(
        0,
        ["track", &text(folder.path()), "--out", &text(out.path())],
    );
    assert!(stderr(&output).contains("dark"), "{}", stderr(&output));
    let report = json(&out.path().join("track.json"));
    let without = report["without_pose"].as_array().unwrap().len();
    assert_eq!(
        (&report["tracked"], &report["frames"], without),
        (&10.into(), &12.into(), 2)
    );

    for file in &files {
        image::RgbImage::new(640, 480)
            .save(folder.path().join(file))
            .unwrap();
    }
    let output = expect_status(
        1,
        ["track", &text(folder.path()), "--out", &text(out.path())],
    );
    assert!(
        stderr(&output).contains("no frame has a pose"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn images_of_another_size_are_named_and_left_out() {
    let folder = room_without_poses(8);
    let files = color_files(folder.path());
    for file in &files[3..5] {
        let path = folder.path().join(file);
        image::RgbImage::new(320, 200).save(path).unwrap();
    }
    let out = tempfile::tempdir().unwrap();
    let output = expect_status(
        0,
        ["track", &text(folder.path()), "--out", &text(out.path())],
    );
    assert!(stderr(&output).contains("320 x 200"), "{}", stderr(&output));
    let report = json(&out.path().join("track.json"));
    assert_eq!(
        (&report["tracked"], &report["frames"]),
        (&6.into(), &8.into())
    );
    let reason = report["without_pose"][0]["reason"].as_str().unwrap();
    assert!(reason.contains("expected 640 x 480"), "{reason}");
}

#[test]
fn without_depth_its_mode_has_a_clear_error() {
    let folder = room_without_poses(3);
    std::fs::remove_file(folder.path().join("depth.txt")).unwrap();
    std::fs::remove_dir_all(folder.path().join("depth")).unwrap();
    let out = tempfile::tempdir().unwrap();
    let output = expect_status(
        2,
        [
            "track",
            &text(folder.path()),
            "--out",
            &text(out.path()),
            "--mode",
            "rgbd",
        ],
    );
    assert!(
        stderr(&output).contains("no depth images"),
        "{}",
        stderr(&output)
    );
}

#[test]
fn a_recording_without_poses_is_reconstructed() {
    let folder = room_without_poses(8);
    let out = tempfile::tempdir().unwrap();
    let output = expect_status(
        0,
        [
            "reconstruct",
            &text(folder.path()),
            "--out",
            &text(out.path()),
            "--final-only",
            "--no-page",
            "--no-picture",
        ],
    );
    assert!(
        stderr(&output).contains("found from the images"),
        "{}",
        stderr(&output)
    );
    let trajectory = std::fs::read_to_string(out.path().join("trajectory.txt")).unwrap();
    assert_eq!(
        trajectory
            .lines()
            .filter(|line| !line.starts_with('#'))
            .count(),
        8
    );
    assert!(out.path().join("poses.txt").exists());
}

/// Position error in metres and coverage of a recording that is tracked.
fn tracked(recording: &Path, reference: &str) -> (f64, f64) {
    let out = tempfile::tempdir().unwrap();
    expect_status(
        0,
        [
            "track",
            &text(recording),
            "--out",
            &text(out.path()),
            "--quiet",
        ],
    );
    let output = expect_status(
        0,
        [
            "evaluate",
            "--trajectory",
            &text(out.path().join("poses.txt")),
            "--reference",
            &text(recording.join(reference)),
            "--json",
        ],
    );
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let rmse = found["position"]["rmse"].as_f64().unwrap();
    (rmse, found["coverage"].as_f64().unwrap())
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn a_hand_held_camera_that_turns_fast_is_tracked() {
    // A quarter of it.
    let recording = tempfile::tempdir().unwrap();
    let at = |file: &str| (data("tum-fr1-rpy").join(file), recording.path().join(file));
    let lines = |list: &str| std::fs::read_to_string(at(list).0).unwrap();
    let time = |line: &str| line.split(' ').next().unwrap().parse::<f64>();
    let images = lines("rgb.txt");
    let end = time(images.lines().nth(images.lines().count() / 4).unwrap()).unwrap();
    for list in ["rgb.txt", "depth.txt", "groundtruth.txt"] {
        let all = lines(list);
        let is_before = |line: &&str| time(line).is_ok_and(|time| time <= end);
        let first: Vec<&str> = all.lines().filter(is_before).collect();
        std::fs::write(at(list).1, first.join("\n")).unwrap();
        let files = first.iter().filter_map(|line| line.split(' ').nth(1));
        for (from, to) in files.map(at).filter(|(from, _)| from.is_file()) {
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::fs::copy(from, to).unwrap();
        }
    }
    let (rmse, coverage) = tracked(recording.path(), "groundtruth.txt");
    assert!(rmse < 0.02 && coverage > 0.98, "{rmse} m, {coverage}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn stereo_pairs_of_a_flight_are_tracked() {
    let (rmse, coverage) = tracked(&data("euroc-v101"), "cam0_trajectory_tum.txt");
    assert!(rmse < 0.05 && coverage > 0.95, "{rmse} m, {coverage}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn a_rendered_living_room_is_tracked() {
    let (rmse, coverage) = tracked(&data("livingroom-synthetic"), "");
    assert!(rmse < 0.014 && coverage == 1.0, "{rmse} m, {coverage}");
}
