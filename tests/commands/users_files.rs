//! Nothing that others wrote is replaced or removed, and runs do not get in each other's way.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use crate::program::{
    contents, expect_status, linecarve, reconstruct_mesh, small_sequence, stderr, text,
};

/// Demands that a command is refused for a reason, with a remedy, and that no file in a folder has changed.
fn refuses(folder: &Path, arguments: &[&str], reason: &str) {
    let before: BTreeMap<PathBuf, Vec<u8>> = contents(folder);
    let said = stderr(&expect_status(2, arguments));
    assert!(said.contains(reason) && said.contains("--out"), "{said}");
    assert_eq!(contents(folder), before);
}

#[test]
fn the_folder_of_a_recording_is_no_output_folder() {
    let folder = small_sequence(4, "tum");
    let sequence = folder.path().join("sequence");
    let sequence = text(&sequence);
    let images = format!("{sequence}/rgb");
    let inside = format!("{sequence}/rgb/out");
    for command in ["reconstruct", "track", "lines", "compare"] {
        for (out, reason) in [
            (sequence, "is the input"),
            (text(folder.path()), "holds the input"),
            (&images, "lies among the images of"),
            (&inside, "lies among the images of"),
        ] {
            refuses(folder.path(), &[command, sequence, "--out", out], reason);
        }
    }
    refuses(
        folder.path(),
        &["reconstruct", sequence, "--track", "--out", sequence],
        "is the input",
    );
    let to = ["convert", sequence, "--to", "colmap", "--out", sequence];
    refuses(folder.path(), &to, "is the input");
    refuses(
        folder.path(),
        &["tiles", "plan", sequence, sequence],
        "is the input",
    );
    // Without an input.
    refuses(
        folder.path(),
        &["stream", "--out", sequence],
        "holds files that linecarve did not write (README.md)",
    );
}

#[test]
fn the_users_files_stay_beside_those_of_a_video() {
    let folder = tempfile::tempdir().unwrap();
    let video = Path::new(env!("CARGO_MANIFEST_DIR")).join("engine/tests/videos/h264.mp4");
    let mine = folder.path().join("mine");
    std::fs::create_dir_all(mine.join("images")).unwrap();
    std::fs::write(mine.join("images/000999.jpg"), "photo").unwrap();
    std::fs::write(mine.join("linecarve.toml"), "# mine").unwrap();
    refuses(
        &mine,
        &["track", text(&video), "--out", text(&mine)],
        "holds files that linecarve did not write (images)",
    );

    // What an earlier video left goes, what the user put beside it stays.
    let out = folder.path().join("out");
    let track = ["track", text(&video), "--out", text(&out), "-q"];
    let first = linecarve(track);
    assert!(
        first.status.code().is_some_and(|code| code < 2),
        "{}",
        stderr(&first)
    );
    let images = out.join("images");
    std::fs::copy(images.join("000000.jpg"), images.join("999999.jpg")).unwrap();
    std::fs::write(out.join("notes.txt"), "mine").unwrap();
    let second = linecarve(track);
    assert_eq!(
        second.status.code(),
        first.status.code(),
        "{}",
        stderr(&second)
    );
    assert!(!images.join("999999.jpg").exists() && images.join("000000.jpg").exists());
    assert_eq!(std::fs::read(out.join("notes.txt")).unwrap(), b"mine");
}

#[test]
fn a_second_run_into_the_same_folder_is_refused_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    // A session waits for its first message.
    let mut first = Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
        .args(["stream", "--quiet", "--out", text(&out)])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    while !out.join(".linecarve-files").exists() {
        assert!(first.try_wait().unwrap().is_none(), "it waits for messages");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    // The list is made before it is locked.
    let second = (0..100)
        .map(|_| linecarve(["lines", "nowhere", "--out", text(&out)]))
        .find(|output| stderr(output).contains("another run of linecarve writes to"));
    assert_eq!(second.and_then(|output| output.status.code()), Some(2));
    drop(first.stdin.take());
    assert_eq!(first.wait().unwrap().code(), Some(1));
    let free = stderr(&expect_status(2, ["lines", "nowhere", "--out", text(&out)]));
    assert!(!free.contains("another run"), "{free}");
}

/// Demands exit status 2 and these words, and that no file in a folder has changed.
fn keeps(folder: &Path, arguments: &[&str], words: &[&str]) {
    let before: BTreeMap<PathBuf, Vec<u8>> = contents(folder);
    let said = stderr(&expect_status(2, arguments));
    assert!(words.iter().all(|word| said.contains(word)), "{said}");
    assert_eq!(contents(folder), before);
}

#[test]
fn no_command_overwrites_its_input_or_another_output() {
    let folder = small_sequence(3, "tum");
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    let (a, b) = (path("a.obj"), path("b.obj"));
    let mesh = "mtllib a.mtl\nusemtl a\nv 0 0 1\nv 1 0 0\nv 0 1 0.5\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
    for file in [&a, &b] {
        std::fs::write(file, mesh).unwrap();
    }
    std::fs::write(path("a.mtl"), "newmtl a\nmap_Kd a.png\n").unwrap();
    let image = image::RgbImage::from_pixel(2, 2, image::Rgb([90; 3]));
    image.save(path("a.png")).unwrap();
    // The same file by another name.
    let around = path("sequence/../a.obj");
    let (heat, picture, edges) = (path("heat.glb"), path("a.png"), path("edges.obj"));
    let sequence = path("sequence");
    let lists = ["groundtruth.txt", "rgb.txt"].map(|name| path(&format!("sequence/{name}")));
    let frame = std::fs::read_dir(path("sequence/rgb"))
        .unwrap()
        .next()
        .unwrap();
    let frame = frame.unwrap().path();
    std::fs::rename(&frame, frame.with_extension("png")).ok();
    let input = "would overwrite the input";
    let other = "would overwrite the file of";
    for (arguments, words) in [
        (vec!["simplify", &a, "--out", &around], [input, "--out"]),
        (
            vec!["simplify", &a, "--out", &b, "--lines", &b],
            [input, "--out"],
        ),
        (
            vec!["simplify", &a, "--out", &edges, "--feature-edges", &edges],
            [other, "--feature-edges"],
        ),
        (vec!["convert", &a, "--out", &a], [input, "--out"]),
        (
            vec!["convert", &sequence, "--out", &lists[0]],
            [input, "--out"],
        ),
        (
            vec!["convert", &sequence, "--to", "tum", "--out", &lists[1]],
            [input, "--out"],
        ),
        (vec!["diff", &a, &b, "--junit", &b], [input, "--junit"]),
        (
            vec!["diff", &a, &b, "--heat-map", &heat, "--junit", &heat],
            [other, "--junit"],
        ),
        (
            vec!["diff", &a, &b, "--heat-map", &picture],
            ["ends with .glb", "--heat-map"],
        ),
        (
            vec!["evaluate", &a, "--ground-truth", &b, "--heat-map", &b],
            [input, "--heat-map"],
        ),
        (vec!["render", &a, "--out", &a], ["ends with .png", "--out"]),
        (vec!["render", &a, "--out", &picture], [input, "--out"]),
        (vec!["mesh", &a, "--out", &a], [input, "--out"]),
        (
            vec!["mesh", &a, "--out", &path("missing/a.ply")],
            ["missing", "--out"],
        ),
    ] {
        keeps(folder.path(), &arguments, &words);
    }

    // An older result is replaced, also inside the recording.
    let poses = path("sequence/mine.txt");
    for _ in 0..2 {
        expect_status(0, ["convert", &sequence, "--out", &poses]);
    }
    std::fs::write(&heat, "older").unwrap();
    let evaluate = ["evaluate", &a, "--ground-truth", &b, "--heat-map", &heat];
    expect_status(0, evaluate.into_iter().chain(["--samples", "100"]));
    assert!(std::fs::read(&heat).unwrap().starts_with(b"glTF"));
}

#[test]
fn a_second_run_leaves_no_results_of_the_first() {
    let folder = small_sequence(4, "tum");
    let [sequence, out] = ["sequence", "out"].map(|name| folder.path().join(name));
    let first = [
        "reconstruct",
        text(&sequence),
        "--out",
        text(&out),
        "--every",
        "1",
    ];
    expect_status(
        0,
        first.into_iter().chain(["-q", "--structure", "--texture"]),
    );
    for name in [
        "mesh.glb",
        "report.html",
        "structure.json",
        "keyframes/000000.glb",
    ] {
        assert!(out.join(name).exists(), "{name}");
    }
    std::fs::write(out.join("keyframes/notes.txt"), "mine").unwrap();
    reconstruct_mesh(0, &sequence, &["--every", "1"], &out);
    let report = std::fs::read(out.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_slice(&report).unwrap();
    let files = report["result"]["files"].as_array().unwrap();
    let mut expected: Vec<PathBuf> = files
        .iter()
        .map(|name| PathBuf::from(name.as_str().unwrap()))
        .collect();
    expected.push("keyframes/notes.txt".into());
    expected.sort();
    let left: Vec<PathBuf> = contents(&out).into_keys().collect();
    assert_eq!(left, expected);

    // The planes of the run go into its folder, beside its files.
    let structure = ["structure", text(&out), "--out", text(&out), "-q"];
    let done = linecarve(structure);
    assert!(
        done.status.code().is_some_and(|code| code < 2),
        "{}",
        stderr(&done)
    );
    assert!(out.join("mesh.ply").exists() && out.join("structure.json").exists());
    let obj = out.join("structure.obj");
    let own = ["structure", text(&obj), "--out", text(&out)];
    keeps(folder.path(), &own, &["would overwrite the input"]);
    // A file of the run that the next one would remove.
    let poses = out.join("mesh.ply");
    let again = [
        "reconstruct",
        text(&sequence),
        "--out",
        text(&out),
        "--poses",
        text(&poses),
    ];
    keeps(folder.path(), &again, &["holds the input"]);
}
