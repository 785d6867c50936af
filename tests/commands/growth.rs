//! The files of keyframes: the whole surface, or its changes.

use std::path::Path;
use std::process::Command;

use linecarve_mesh::read_geometry;

use crate::program::delta_reader::{Corners, DeltaReader, sorted};
use crate::program::{data, expect_status, small_sequence, text, with_open_holes};

fn reconstruct(sequence: &Path, out: &Path, more: &[&str]) {
    let fixed = ["reconstruct", text(sequence), "--quiet", "--out", text(out)];
    let lean = ["--no-picture", "--no-page", "--format", "ply"];
    expect_status(0, [&fixed[..], &lean, more].concat());
}

/// The triangles of a mesh file, sorted. Coordinates of files of keyframes are single precision.
fn triangles_of(path: &Path) -> Vec<Corners> {
    let shape = read_geometry(path).unwrap();
    let corner = |index: u32| {
        let position = shape.positions[index as usize];
        [position.x, position.y, position.z].map(|value| (value as f32 + 0.0).to_bits())
    };
    let triangles = shape.triangles.iter();
    sorted(triangles.map(|t| t.map(corner)))
}

/// Reconstructs a sequence with files of both kinds and compares them keyframe by keyframe; returns their number.
fn compare_growth(sequence: &Path, root: &Path, more: &[&str]) -> usize {
    let [whole, delta, last] = ["whole", "delta", "last"].map(|name| root.join(name));
    std::fs::create_dir_all(root).unwrap();
    let open = with_open_holes(root);
    let more = &[more, &["--config", text(&open)]].concat();
    reconstruct(sequence, &whole, more);
    reconstruct(
        sequence,
        &delta,
        &[&["--growth", "delta"], &more[..]].concat(),
    );
    reconstruct(sequence, &last, &[&["--final-only"], &more[..]].concat());
    let mesh = |out: &Path| std::fs::read(out.join("mesh.ply")).unwrap();
    assert!(mesh(&whole) == mesh(&last), "followed and made anew");
    assert!(mesh(&whole) == mesh(&delta));
    assert!(!last.join("keyframes").exists());
    let file =
        |out: &Path, number: usize, end: &str| out.join(format!("keyframes/{number:06}.{end}"));
    let files = |out: &Path| std::fs::read_dir(out.join("keyframes")).unwrap().count();
    let count = files(&whole);
    // The end of the run changes the surface of the last keyframe: its file is that of the end, its change has a file of its own.
    assert_eq!(files(&delta), count + 1);
    let mut reader = DeltaReader::default();
    for number in 0..=count {
        reader.apply(&std::fs::read(file(&delta, number, "delta")).unwrap());
        if number + 1 == count {
            continue;
        }
        let expected = triangles_of(&file(&whole, number.min(count - 1), "glb"));
        assert!(
            reader.triangles() == expected,
            "keyframe {number} of {sequence:?}"
        );
    }
    count
}

#[test]
fn changes_add_up_to_the_whole_surfaces() {
    let folder = small_sequence(6, "tum");
    let sequence = folder.path().join("sequence");
    for (name, more) in [
        ("cut", &["--every", "1"][..]),
        ("votes", &["--every", "1", "--labels", "votes"]),
        ("points", &["--every", "1", "--from", "map-points"]),
    ] {
        let count = compare_growth(&sequence, &folder.path().join(name), more);
        assert_eq!(count, 6, "{name}");
    }
}

#[test]
fn changes_of_provisional_keyframes_add_up() {
    let folder = small_sequence(9, "tum");
    let sequence = folder.path().join("sequence");
    let more = ["--every", "1", "--depth", "semi-dense"];
    let out = folder.path().join("out");
    assert_eq!(compare_growth(&sequence, &out, &more), 9);
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn changes_of_recorded_sequences_add_up() {
    for (name, every) in [("seven-scenes", "24"), ("livingroom-synthetic", "6")] {
        let out = tempfile::tempdir().unwrap();
        let count = compare_growth(&data(name), out.path(), &["--every", every]);
        assert!(count > 8, "{name}: {count}");
    }
}

#[test]
#[ignore = "needs python3"]
fn the_client_rebuilds_the_surfaces() {
    let folder = small_sequence(5, "tum");
    let [whole, delta, rebuilt] =
        ["whole", "delta", "rebuilt"].map(|name| folder.path().join(name));
    let sequence = folder.path().join("sequence");
    reconstruct(&sequence, &whole, &["--every", "1"]);
    reconstruct(&sequence, &delta, &["--every", "1", "--growth", "delta"]);
    let client = Path::new(env!("CARGO_MANIFEST_DIR")).join("clients/read_growth.py");
    let run = |keyframes: &Path, more: &[&str]| {
        let mut command = Command::new("python3");
        command
            .arg(&client)
            .arg(keyframes)
            .arg("--out")
            .arg(&rebuilt);
        command.args(more).output().unwrap()
    };
    let done = run(&delta.join("keyframes"), &["--every", "2"]);
    assert!(done.status.success(), "{done:?}");
    // Every second one, and the last: the end of the run.
    assert_eq!(std::fs::read_dir(&rebuilt).unwrap().count(), 4);
    for number in [0, 2] {
        let found = triangles_of(&rebuilt.join(format!("{number:06}.ply")));
        let expected = triangles_of(&whole.join(format!("keyframes/{number:06}.glb")));
        assert!(found == expected, "keyframe {number}");
    }
    // One file is missing.
    std::fs::remove_file(delta.join("keyframes/000002.delta")).unwrap();
    let done = run(&delta.join("keyframes"), &[]);
    let message = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(
        !done.status.success() && message.contains("000003.delta"),
        "{message}"
    );
    let done = run(&whole, &[]);
    let message = String::from_utf8_lossy(&done.stderr).into_owned();
    assert!(
        !done.status.success() && message.contains("--growth delta"),
        "{message}"
    );
}
