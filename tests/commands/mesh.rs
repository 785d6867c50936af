//! `linecarve mesh`: dense clouds and sparse models in one command.

use std::path::{Path, PathBuf};

use crate::program::{colmap_relief, expect_status, text};

/// A small city, as a workspace of COLMAP.
fn city_in(folder: &Path) -> PathBuf {
    let city = folder.join("city");
    let synth = ["synth", "city", "--points", "3000", "-q", "--out"];
    expect_status(0, synth.into_iter().chain([text(&city)]));
    city
}

#[test]
fn a_workspace_gives_the_mesh_of_its_cloud() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let city = city_in(folder.path());
    let mesh = path("mesh.ply");
    let output = expect_status(
        0,
        [
            "mesh",
            text(&city),
            "--out",
            text(&mesh),
            "--thickness-factor",
            "1",
        ],
    );
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        said.contains("--thickness-factor: standard deviations"),
        "{said}"
    );
    let cloud = city.join("fused.ply");
    let whole = path("whole");
    let reconstruct = ["reconstruct", text(&cloud), "--from", "map-points"];
    let how = [
        "--final-only",
        "--format",
        "ply",
        "--no-page",
        "--no-picture",
        "-q",
    ];
    let to = ["--out", text(&whole)];
    expect_status(0, reconstruct.into_iter().chain(how).chain(to));
    let bytes = std::fs::read(&mesh).unwrap();
    assert!(bytes == std::fs::read(whole.join("mesh.ply")).unwrap());
}

#[test]
fn a_sparse_model_gives_a_mesh_and_other_names_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let model = path("model");
    colmap_relief(&model, [0.0; 3]);
    let mesh = path("mesh.glb");
    expect_status(0, ["mesh", text(&model), "--out", text(&mesh), "-q"]);
    assert!(std::fs::read(&mesh).unwrap().starts_with(b"glTF"));
    let other = path("mesh.stl");
    expect_status(2, ["mesh", text(&model), "--out", text(&other)]);
    let missing = path("missing");
    expect_status(2, ["mesh", text(&missing), "--out", text(&mesh)]);
}

#[test]
fn points_with_normals_need_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let city = city_in(folder.path());
    let cloud = path("cloud.ply");
    std::fs::rename(city.join("fused.ply"), &cloud).unwrap();
    let (mesh, sparse) = (path("mesh.ply"), city.join("sparse"));
    let arguments = ["mesh", text(&cloud), "--out", text(&mesh)];
    let output = expect_status(2, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("--cameras"), "{said}");
    let with = |cameras| arguments.into_iter().chain(["--cameras", cameras]);
    expect_status(0, with(text(&sparse)));
    assert!(std::fs::metadata(&mesh).unwrap().len() > 10_000);
    // A list of cameras that has a wrong line, and a mesh, which has no normals.
    let list = path("cameras.txt");
    std::fs::write(&list, "# one\n1 2 3\n").unwrap();
    let output = expect_status(2, with(text(&list)));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("line 2: a camera is 13 numbers"), "{said}");
    let other = ["mesh", text(&mesh), "--cameras", text(&sparse)];
    let output = expect_status(2, other.into_iter().chain(["--out", text(&mesh)]));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("nx, ny, nz"), "{said}");
}

#[test]
#[cfg(unix)]
fn a_full_disk_is_told_with_the_folder_of_the_temporary_files() {
    let folder = tempfile::tempdir().unwrap();
    let cloud = city_in(folder.path()).join("fused.ply");
    let (mesh, work) = (folder.path().join("mesh.ply"), folder.path().join("work"));
    let program = assert_cmd::cargo::cargo_bin("linecarve");
    for (arguments, written) in [
        (["mesh", text(&cloud), "--out", text(&mesh)], folder.path()),
        (["tiles", "plan", text(&cloud), text(&work)], &work),
    ] {
        // Files of more than 4 kB are refused, as by a disk that is full.
        let script = "trap '' XFSZ; ulimit -f 8; exec \"$@\"";
        let mut shell = std::process::Command::new("sh");
        shell
            .args(["-c", script, "sh"])
            .arg(&program)
            .args(arguments);
        let output = shell.output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{said}");
        let named = format!("a temporary file in {}: ", text(written));
        assert!(said.contains(&named), "{said}");
    }
}
