//! Options that would have no effect are refused by name.

use crate::program::{expect_status, small_sequence, stderr, text};

#[test]
fn options_without_effect_are_refused_by_name() {
    let folder = small_sequence(3, "tum");
    let path = |name: &str| text(&folder.path().join(name)).to_owned();
    let (mesh, sequence, out) = (path("m.obj"), path("sequence"), path("out.ply"));
    std::fs::write(&mesh, "v 0 0 1\nv 1 0 0\nv 0 1 0.5\nf 1 2 3\n").unwrap();
    let config = path("c.toml");
    std::fs::write(&config, "[simplify]\ntolerance = 0.5\n").unwrap();
    let images = path("images.toml");
    std::fs::write(&images, "[images]\nlongest_side_px = 100\n").unwrap();
    let truth = path("sequence/groundtruth.txt");
    let evaluate = ["evaluate", "--trajectory", &truth, "--reference", &sequence];
    let measure = ["evaluate", &mesh, "--ground-truth", &mesh];
    let structure = ["structure", &mesh, "--out", &out];
    let convert = ["convert", &mesh, "--out", &out];
    let poses = ["convert", &sequence, "--to", "tum", "--out", &out];
    let render = ["render", &mesh, "--out", &out];
    let mesher = ["mesh", &sequence, "--out", &out, "--config"];
    let stream = ["stream", "--config"];
    for (command, option, name) in [
        (&structure[..], vec!["--poses", "none.txt"], "--poses"),
        (&structure, vec!["--config", &config], "--config"),
        (&structure, vec!["--depth", "semi-dense"], "--depth"),
        (&structure, vec!["--every", "2"], "--every"),
        (&convert, vec!["--layout", "tum"], "--layout"),
        (&convert, vec!["--error-scale", "0.3"], "--error-scale"),
        (&poses, vec!["--error-position", "0.5"], "--error-position"),
        (&poses, vec!["--error-marks", "unknown"], "--error-pixels"),
        (&evaluate, vec!["--heat-map", "x.glb"], "--heat-map"),
        (&evaluate, vec!["--thresholds", "0.1"], "--thresholds"),
        (&evaluate, vec!["--every", "2"], "--every"),
        (&measure, vec!["--every", "2"], "--every"),
        (
            &render,
            vec!["--sequence", &sequence, "--size", "64x64"],
            "--size",
        ),
        (&render, vec!["--field-of-view", "50"], "--eye"),
        (&mesher, vec![&config], "[simplify]"),
        (&mesher, vec![&images], "[images]"),
        (&stream, vec![&config], "[simplify]"),
    ] {
        let arguments = command.iter().copied().chain(option.iter().copied());
        let said = stderr(&expect_status(2, arguments));
        assert!(said.contains(name), "{name}: {said}");
    }
    // What is the default needs no refusal.
    expect_status(0, evaluate);
    expect_status(0, convert.into_iter().chain(["--error-scale", "0"]));
}
