//! Depth values that no camera measured change nothing but what they stand for.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use crate::program::live_recording::LiveRecording;
use crate::program::{expect_status, small_sequence, stderr, stream, text};

const FRAMES: usize = 4;
const WIDTH: usize = 320;

fn depth_image(sequence: &Path, frame: usize) -> PathBuf {
    sequence.join(format!("frame-{frame:06}.depth.png"))
}

/// Depth images of floating-point values in the same unit, of which `change` changes pixels by their index, as NPY files in place of PNG files.
fn write_floats(sequence: &Path, change: impl Fn(usize) -> Option<f32>) {
    for frame in 0..FRAMES {
        let path = depth_image(sequence, frame);
        let npy = path.with_extension("npy");
        let integers = image::open(&path).unwrap().into_luma16();
        let (width, height) = integers.dimensions();
        let header =
            format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}), }}\n");
        let mut bytes = b"\x93NUMPY\x01\0".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        for (index, value) in integers.as_raw().iter().enumerate() {
            let value = change(index).unwrap_or(f32::from(*value));
            bytes.extend(value.to_le_bytes());
        }
        std::fs::write(npy, bytes).unwrap();
        std::fs::remove_file(path).unwrap();
    }
}

/// The mesh of a sequence, and what was said.
fn mesh_of(sequence: &Path) -> (Vec<u8>, String) {
    let out = tempfile::tempdir().unwrap();
    let arguments = [
        "reconstruct",
        text(sequence),
        "--every",
        "1",
        "--final-only",
        "--no-picture",
        "--no-page",
        "--format",
        "ply",
        "--out",
        text(out.path()),
    ];
    let output = expect_status(0, arguments);
    let mesh = std::fs::read(out.path().join("mesh.ply")).unwrap();
    (mesh, stderr(&output))
}

fn with_floats(change: impl Fn(usize) -> Option<f32>) -> tempfile::TempDir {
    let folder = small_sequence(FRAMES, "7-scenes");
    write_floats(&folder.path().join("sequence"), change);
    folder
}

#[test]
fn a_number_for_nothing_measured_is_no_depth() {
    let is_half = |index: usize| index % WIDTH < WIDTH / 2;
    let is_one = |index: usize| index == 100 * WIDTH + 77;
    type Kind<'a> = (&'a dyn Fn(usize) -> bool, usize, &'a [f32]);
    let kinds: [Kind<'_>; 2] = [
        (&is_one, 1, &[1e10, 1e-9, f32::NAN, -5.0, 1e-42]),
        (&is_half, WIDTH * 240 / 2, &[1e10, f32::INFINITY]),
    ];
    for (is_wrong, count, values) in kinds {
        let without = with_floats(|index| is_wrong(index).then_some(0.0));
        let (expected, said) = mesh_of(&without.path().join("sequence"));
        assert!(!said.contains("depth value"), "{said}");
        for value in values {
            let folder = with_floats(|index| is_wrong(index).then_some(*value));
            let sequence = folder.path().join("sequence");
            let (mesh, said) = mesh_of(&sequence);
            assert!(mesh == expected, "{value} changes the mesh");
            let warning = format!("warning: {} depth value(s)", count * FRAMES);
            let is_counted = *value > 0.0 && value.is_normal();
            assert_eq!(said.contains(&warning), is_counted, "{value}: {said}");
            let facts = expect_status(0, ["info", text(&sequence), "--json"]).stdout;
            let facts: Value = serde_json::from_slice(&facts).unwrap();
            let found = facts["depth"]["unmeasurable"].as_u64().unwrap_or(0);
            assert_eq!(found > 0, is_counted, "{value}: {}", facts["depth"]);
        }
    }
}

#[test]
fn a_wrong_integer_is_no_depth() {
    let mesh_with = |value: u16| {
        let folder = small_sequence(FRAMES, "7-scenes");
        let sequence = folder.path().join("sequence");
        for frame in 0..FRAMES {
            let path = depth_image(&sequence, frame);
            let mut image = image::open(&path).unwrap().into_luma16();
            image.put_pixel(77, 100, image::Luma([value]));
            image.save(&path).unwrap();
        }
        mesh_of(&sequence)
    };
    let (expected, _) = mesh_with(0);
    let (mesh, said) = mesh_with(u16::MAX);
    assert!(mesh == expected, "the mesh changes");
    assert!(!said.contains("depth value(s)"), "{said}");
}

#[test]
fn comparisons_and_sessions_say_how_many_depths_are_wrong() {
    let folder = with_floats(|index| (index == 5000).then_some(1e10));
    let sequence = folder.path().join("sequence");
    let out = folder.path().join("compared");
    let arguments = [
        "compare",
        text(&sequence),
        "--every",
        "1",
        "--out",
        text(&out),
    ];
    let said = stderr(&expect_status(0, arguments));
    assert!(said.contains("warning: 4 depth value(s)"), "{said}");

    let recording = LiveRecording::new(FRAMES);
    write_floats(&recording.folder.path().join("sequence"), |index| {
        (index == 5000).then_some(1e10)
    });
    let mut messages = vec![recording.start.clone()];
    for frame in 0..FRAMES {
        let mut keyframe = recording.keyframe(
            frame as u64,
            frame,
            &json!({ "matrix": recording.poses[frame] }),
        );
        let depth = depth_image(&recording.folder.path().join("sequence"), frame);
        keyframe["depth"] = json!({ "path": depth.with_extension("npy") });
        messages.push(keyframe);
    }
    let lines: Vec<String> = messages.iter().map(Value::to_string).collect();
    let (status, replies) = stream(&[], &lines);
    assert_eq!(status, Some(0), "{replies:?}");
    let warnings = replies.last().unwrap()["warnings"][0].as_str().unwrap();
    assert!(warnings.starts_with("4 depth value(s)"), "{warnings}");
}
