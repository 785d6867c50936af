//! Bad input ends in an error that names file and remedy, or in a warning and a result.

use std::path::{Path, PathBuf};

use crate::program::{expect_status, small_sequence, stderr, text};
use linecarve::{Options, Reconstruction};

/// Reconstructs every frame of a sequence and gives the exit status demanded and what was said.
fn reconstruct(status: i32, sequence: &Path, out: &Path) -> String {
    let output = expect_status(
        status,
        [
            "reconstruct",
            text(sequence),
            "--every",
            "1",
            "--final-only",
            "--no-picture",
            "--out",
            text(out),
        ],
    );
    let said = stderr(&output);
    assert!(!said.contains("panicked"), "{said}");
    said
}

fn depth_images(sequence: &Path) -> Vec<PathBuf> {
    let mut images: Vec<_> = std::fs::read_dir(sequence.join("depth"))
        .expect("the layout has a depth folder")
        .map(|entry| entry.expect("a readable entry").path())
        .collect();
    images.sort();
    images
}

fn color_images(sequence: &Path) -> Vec<PathBuf> {
    let mut images: Vec<_> = std::fs::read_dir(sequence.join("rgb"))
        .expect("the layout has a colour folder")
        .map(|entry| entry.expect("a readable entry").path())
        .collect();
    images.sort();
    images
}

fn truncate(path: &Path) {
    let bytes = std::fs::read(path).expect("a readable image");
    std::fs::write(path, &bytes[..bytes.len() / 3]).expect("a writable image");
}

#[test]
fn a_missing_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("nowhere");
    let said = reconstruct(2, &missing, &folder.path().join("out"));
    assert!(said.contains("nowhere"), "{said}");
}

#[test]
fn an_empty_folder_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let empty = folder.path().join("hollow");
    std::fs::create_dir(&empty).unwrap();
    let said = reconstruct(2, &empty, &folder.path().join("out"));
    assert!(said.contains("hollow") && said.contains("empty"), "{said}");
}

#[test]
fn an_unknown_layout_lists_what_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let odd = folder.path().join("odd");
    std::fs::create_dir(&odd).unwrap();
    std::fs::write(odd.join("notes.txt"), "hello").unwrap();
    let said = reconstruct(2, &odd, &folder.path().join("out"));
    assert!(said.contains("odd") && said.contains("tum-rgbd"), "{said}");
}

#[test]
fn a_file_in_place_of_a_folder_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("video.mp4");
    std::fs::write(&file, "not a folder").unwrap();
    let said = reconstruct(2, &file, &folder.path().join("out"));
    assert!(
        said.contains("video.mp4") && said.contains("folder"),
        "{said}"
    );
}

#[test]
fn truncated_images_are_left_out_with_a_count() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    truncate(&depth_images(&sequence)[1]);
    truncate(&color_images(&sequence)[3]);
    let said = reconstruct(0, &sequence, &folder.path().join("out"));
    assert!(said.contains("2 of 6"), "{said}");
    assert!(folder.path().join("out/mesh.ply").exists());
}

#[test]
fn a_sequence_of_truncated_images_alone_is_an_error() {
    let folder = small_sequence(2, "tum");
    let sequence = folder.path().join("sequence");
    for image in color_images(&sequence) {
        truncate(&image);
    }
    let out = folder.path().join("out");
    let said = reconstruct(2, &sequence, &out);
    assert!(said.contains("rgb"), "{said}");
    assert!(!out.join("mesh.ply").exists());
}

#[test]
fn poses_that_are_not_numbers_are_left_out_with_a_count() {
    let folder = small_sequence(6, "7-scenes");
    let sequence = folder.path().join("sequence");
    let mut poses: Vec<_> = std::fs::read_dir(&sequence)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| text(path).ends_with(".pose.txt"))
        .collect();
    poses.sort();
    let pose = std::fs::read_to_string(&poses[2]).unwrap();
    let first = pose.split_ascii_whitespace().next().unwrap();
    std::fs::write(&poses[2], pose.replacen(first, "nan", 1)).unwrap();
    let said = reconstruct(0, &sequence, &folder.path().join("out"));
    assert!(said.contains("1 of 6"), "{said}");
}

#[test]
fn depth_of_another_size_is_refused_with_both_sizes() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    for path in depth_images(&sequence) {
        let image =
            image::ImageBuffer::<image::Luma<u16>, _>::from_pixel(100, 80, image::Luma([5000u16]));
        image.save(&path).unwrap();
    }
    let said = reconstruct(2, &sequence, &folder.path().join("out"));
    assert!(
        said.contains("100") && said.contains("320") && said.contains("depth"),
        "{said}"
    );
}

#[test]
fn a_sequence_without_depth_says_what_is_missing() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    std::fs::remove_dir_all(sequence.join("depth")).unwrap();
    std::fs::remove_file(sequence.join("depth.txt")).unwrap();
    let said = reconstruct(2, &sequence, &folder.path().join("out"));
    assert!(said.contains("depth"), "{said}");
}

#[test]
fn one_keyframe_gives_a_surface() {
    let folder = small_sequence(1, "tum");
    let out = folder.path().join("out");
    reconstruct(0, &folder.path().join("sequence"), &out);
    assert!(out.join("mesh.ply").exists());
}

#[test]
fn an_output_folder_that_cannot_be_made_is_named_before_any_work() {
    let folder = small_sequence(2, "tum");
    let file = folder.path().join("occupied");
    std::fs::write(&file, "a file").unwrap();
    let said = reconstruct(2, &folder.path().join("sequence"), &file.join("out"));
    assert!(
        said.contains("occupied") && said.contains("--out"),
        "{said}"
    );
}

#[test]
fn images_without_edges_give_the_planes_that_depth_shows_or_status_one_and_a_reason() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    for path in color_images(&sequence) {
        image::GrayImage::from_pixel(320, 240, image::Luma([90]))
            .save(&path)
            .unwrap();
    }
    let said = reconstruct(0, &sequence, &folder.path().join("planes"));
    assert!(said.contains(" 0 segments"), "{said}");
    // Without points from planes nothing is left.
    let mut options = Options::default();
    options.surface_points.enabled = false;
    let mut run = Reconstruction::open(&sequence, options).expect("images can be read");
    while run.advance().expect("images can be read").is_some() {}
    assert!(run.surface().is_empty());
    let out = folder.path().join("out");
    let output = expect_status(1, ["lines", text(&sequence), "--out", text(&out)]);
    assert!(stderr(&output).contains("have no edges"), "{output:?}");
}

#[test]
fn an_unknown_key_in_the_configuration_is_named() {
    let folder = small_sequence(1, "tum");
    let config = folder.path().join("linecarve-config.toml");
    std::fs::write(&config, "[carving]\nfree_treshold = 3\n").unwrap();
    let output = expect_status(
        2,
        [
            "reconstruct",
            text(&folder.path().join("sequence")),
            "--config",
            text(&config),
            "--out",
            text(&folder.path().join("out")),
        ],
    );
    let said = stderr(&output);
    assert!(
        said.contains("linecarve-config.toml, line 2: unknown key `carving.free_treshold`")
            && said.contains("did you mean `carving.free_threshold`?"),
        "{said}"
    );
}

#[test]
#[cfg(target_os = "linux")]
fn a_run_goes_on_where_standard_error_cannot_be_written() {
    use std::process::{Command, Stdio};

    let folder = small_sequence(4, "tum");
    let sequence = folder.path().join("sequence");
    let run = |name: &str, stderr: Stdio| {
        let out = folder.path().join(name);
        let mut child = Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
            .args(["reconstruct", "--every", "1", "--no-picture"])
            .arg(&sequence)
            .arg("--out")
            .arg(&out)
            .stderr(stderr)
            .spawn()
            .unwrap();
        // Nobody reads it.
        drop(child.stderr.take());
        assert_eq!(child.wait().unwrap().code(), Some(0), "{name}");
        assert!(out.join("mesh.ply").is_file());
    };
    let full = std::fs::File::options().write(true).open("/dev/full");
    run("full", full.unwrap().into());
    run("closed", Stdio::piped());
}

#[test]
#[cfg(unix)]
fn what_has_no_end_is_not_read() {
    let folder = small_sequence(3, "tum");
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("out");
    for name in ["groundtruth.txt", "linecarve.toml", "rgb.txt"] {
        let path = sequence.join(name);
        let kept = std::fs::read(&path).unwrap();
        for make in ["mkfifo \"$1\"", "ln -s /dev/zero \"$1\""] {
            std::fs::remove_file(&path).unwrap();
            let made = std::process::Command::new("sh")
                .args(["-c", make, "sh"])
                .arg(&path)
                .status();
            assert!(made.unwrap().success());
            let said = reconstruct(2, &sequence, &out);
            assert!(
                said.contains(name) && said.contains("pipe or a device"),
                "{said}"
            );
        }
        std::fs::remove_file(&path).unwrap();
        std::fs::write(&path, kept).unwrap();
    }
    let configured = [
        "reconstruct",
        text(&sequence),
        "--out",
        text(&out),
        "--config",
        "/dev/zero",
    ];
    let said = stderr(&expect_status(2, configured));
    assert!(said.contains("pipe or a device"), "{said}");
}
