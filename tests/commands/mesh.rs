//! `linecarve mesh`: dense clouds and sparse models in one command.

use std::path::{Path, PathBuf};

use crate::program::{colmap_relief, expect_status, stderr, text};

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
    let second = path("second.ply");
    let output = expect_status(2, other.into_iter().chain(["--out", text(&second)]));
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("nx, ny, nz"), "{said}");
}

/// Overwrites bytes of each of some points of a cloud, from this place of a row.
fn spoil(cloud: &Path, points: std::ops::Range<usize>, at: usize, bytes: &[u8]) {
    /// Single-precision position and normal, and a colour.
    const ROW: usize = 27;
    let mut file = std::fs::read(cloud).unwrap();
    let end = b"end_header\n";
    let start = file.windows(end.len()).position(|it| it == end).unwrap() + end.len();
    for point in points {
        let place = start + ROW * point + at;
        file[place..place + bytes.len()].copy_from_slice(bytes);
    }
    std::fs::write(cloud, file).unwrap();
}

#[test]
fn points_without_position_or_normal_are_counted_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let city = city_in(folder.path());
    let (cloud, mesh) = (city.join("fused.ply"), folder.path().join("mesh.ply"));
    spoil(&cloud, 0..10, 4, &f32::NAN.to_le_bytes());
    spoil(&cloud, 100..120, 12, &[0; 12]);
    spoil(&cloud, 200..205, 16, &f32::INFINITY.to_le_bytes());
    let command = ["mesh", text(&city), "--out", text(&mesh)];
    let said = stderr(&expect_status(0, command));
    assert!(said.contains("10 not finite"), "{said}");
    let sparse = city.join("sparse");
    let by_normals = ["mesh", text(&cloud), "--out", text(&mesh), "--cameras"];
    let said = stderr(&expect_status(
        0,
        by_normals.into_iter().chain([text(&sparse)]),
    ));
    assert!(
        said.contains("10 not finite, 25 without a usable normal"),
        "{said}"
    );
    let work = folder.path().join("work");
    let said = stderr(&expect_status(
        0,
        ["tiles", "plan", text(&cloud), text(&work)],
    ));
    assert!(said.contains("10 not finite"), "{said}");
}

#[test]
fn a_cloud_without_its_views_names_the_file_and_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let city = city_in(folder.path());
    let views = city.join("fused.ply.vis");
    let mesh = folder.path().join("mesh.ply");
    let command = ["mesh", text(&city), "--out", text(&mesh)];
    let file = std::fs::read(&views).unwrap();
    for (bytes, words) in [
        (
            Some(&file[..0]),
            "fused.ply.vis, byte 0: the file ends too early",
        ),
        (Some(&file[..100]), "too early"),
        (None, "fused.ply.vis: is missing"),
    ] {
        match bytes {
            Some(bytes) => std::fs::write(&views, bytes).unwrap(),
            None => std::fs::remove_file(&views).unwrap(),
        }
        let said = stderr(&expect_status(2, command));
        assert!(said.contains(words), "{said}");
    }
    // Before anything is read.
    std::fs::create_dir(&mesh).unwrap();
    let said = stderr(&expect_status(2, command));
    assert!(said.contains("mesh.ply is a folder"), "{said}");
}

/// A cloud that is too large for the memory that is free, of which the files hold nothing but zeros.
#[cfg(target_os = "linux")]
fn endless_cloud(folder: &Path) -> PathBuf {
    let city = city_in(folder);
    let memory = std::fs::read_to_string("/proc/meminfo").unwrap();
    let free = memory.lines().find(|line| line.starts_with("MemAvailable"));
    let free = free.unwrap().split_whitespace().nth(1).unwrap();
    let points = 2 * free.parse::<u64>().unwrap();
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {points}\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
    );
    let (cloud, views) = (city.join("fused.ply"), city.join("fused.ply.vis"));
    std::fs::write(&cloud, &header).unwrap();
    std::fs::write(&views, points.to_le_bytes()).unwrap();
    for (file, length) in [
        (cloud, header.len() as u64 + 12 * points),
        (views, 8 + 4 * points),
    ] {
        let file = std::fs::OpenOptions::new().write(true).open(file).unwrap();
        file.set_len(length).unwrap();
    }
    city
}

#[test]
#[cfg(target_os = "linux")]
fn the_folder_of_tiles_goes_with_a_signal_or_with_the_next_run() {
    let folder = tempfile::tempdir().unwrap();
    let city = endless_cloud(folder.path());
    let out = folder.path().join("out");
    std::fs::create_dir(&out).unwrap();
    let mesh = out.join("mesh.ply");
    let entries = || -> Vec<PathBuf> {
        let entries = std::fs::read_dir(&out).unwrap();
        entries.map(|entry| entry.unwrap().path()).collect()
    };
    let mut killed = Vec::new();
    for (signal, status) in [("KILL", None), ("TERM", Some(130)), ("INT", Some(130))] {
        let mut run = std::process::Command::new(assert_cmd::cargo::cargo_bin("linecarve"))
            .args(["mesh", text(&city), "--out", text(&mesh), "-q"])
            .spawn()
            .unwrap();
        // The plan begins in it.
        let is_at_work =
            |path: &PathBuf| !killed.contains(path) && path.join(".linecarve-files").exists();
        while !entries().iter().any(is_at_work) {
            assert!(run.try_wait().unwrap().is_none(), "the cloud is too large");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        std::thread::sleep(std::time::Duration::from_millis(200));
        let number = run.id().to_string();
        let sent = std::process::Command::new("kill")
            .args(["-s", signal, &number])
            .status();
        assert!(sent.unwrap().success());
        assert_eq!(run.wait().unwrap().code(), status, "{signal}");
        killed = entries();
        // What a killed run left is removed by the next one.
        assert_eq!(
            killed.len(),
            usize::from(signal == "KILL"),
            "{signal}: {killed:?}"
        );
    }
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
