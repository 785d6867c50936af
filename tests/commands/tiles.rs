//! Models and sequences in tiles: the bytes of one process, damage, refusals.

use std::path::Path;

use crate::program::{colmap_relief, expect_status, stderr, text};

/// Few keyframes of the sample.
const CHOICE: [&str; 2] = ["--every", "3"];

/// `mesh.ply` of one process.
fn whole(model: &Path, out: &Path, labels: &str) -> Vec<u8> {
    whole_of(model, out, labels, &[])
}

fn whole_of(model: &Path, out: &Path, labels: &str, more: &[&str]) -> Vec<u8> {
    let from = ["--from", "map-points"];
    let from = if more.contains(&"--from") {
        &[][..]
    } else {
        &from
    };
    let what = ["reconstruct", text(model), "--final-only"];
    let how = ["--format", "ply", "--labels", labels, "--no-page"];
    let to = ["--no-picture", "--quiet", "--out", text(out)];
    expect_status(
        0,
        what.iter().chain(from).chain(&how).chain(&to).chain(more),
    );
    std::fs::read(out.join("mesh.ply")).unwrap()
}

fn plan<'a>(model: &'a Path, work: &'a Path, tiles: &'a str, labels: &'a str) -> Vec<&'a str> {
    let (model, work) = (text(model), text(work));
    let options = ["--tiles", tiles, "--labels", labels, "--halo", "2", "-q"];
    [&["tiles", "plan", model, work][..], &options].concat()
}

/// Shifted far from zero, so that the origin of computation is another.
fn models(folder: &Path) -> [std::path::PathBuf; 2] {
    let models = ["near", "far"].map(|name| folder.join(name));
    colmap_relief(&models[0], [0.0; 3]);
    colmap_relief(&models[1], [450_000.0, 5_400_000.0, 0.0]);
    models
}

#[test]
fn tiles_leave_the_mesh_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    for model in models(folder.path()) {
        for labels in ["votes", "cut"] {
            let name = format!("{}-{labels}", model.display());
            let expected = whole(&model, Path::new(&format!("{name}-whole")), labels);
            for tiles in ["1", "5"] {
                let work = format!("{name}-{tiles}");
                let work = Path::new(&work);
                expect_status(0, plan(&model, work, tiles, labels));
                let run = ["tiles", "run", text(work), "--jobs", "2", "-q"];
                expect_status(0, run);
                let mesh = std::fs::read(work.join("mesh.ply")).unwrap();
                assert!(mesh == expected, "{name} in {tiles} tiles");
            }
        }
    }
}

/// Plans and runs a model in tiles, and compares the meshes.
fn assert_same(model: &Path, folder: &Path, labels: &str, counts: &[&str]) {
    let expected = whole(model, &folder.join(format!("whole-{labels}")), labels);
    for tiles in counts {
        let work = folder.join(format!("{labels}-{tiles}"));
        expect_status(0, plan(model, &work, tiles, labels));
        expect_status(0, ["tiles", "run", text(&work), "-q"]);
        let mesh = std::fs::read(work.join("mesh.ply")).unwrap();
        assert!(mesh == expected, "{labels}, {tiles} tiles");
    }
}

#[test]
fn a_city_is_written_read_and_carved_in_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let city = folder.path().join("city");
    let synth = ["synth", "city", "--points", "4000", "-q", "--out"];
    expect_status(0, synth.into_iter().chain([text(&city)]));
    let cloud = city.join("fused.ply");
    for labels in ["votes", "cut"] {
        assert_same(&cloud, folder.path(), labels, &["6"]);
    }
    // One process under a limit names the remedy.
    let limited = ["--final-only", "--memory-limit", "2M", "--quiet"];
    let out = folder.path().join("limited");
    let from = [
        "reconstruct",
        text(&cloud),
        "--from",
        "map-points",
        "--out",
        text(&out),
    ];
    if cfg!(target_os = "linux") {
        let refused = stderr(&expect_status(2, from.into_iter().chain(limited)));
        assert!(refused.contains("linecarve tiles plan"), "{refused}");
    }
    // One image too few, and a cloud without its visibility.
    let visibility = city.join("fused.ply.vis");
    let mut bytes = std::fs::read(&visibility).unwrap();
    bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&visibility, bytes).unwrap();
    let work = folder.path().join("refused");
    let refused = stderr(&expect_status(2, plan(&cloud, &work, "2", "cut")));
    assert!(refused.contains("fused.ply.vis"), "{refused}");
    assert!(!work.exists());
    std::fs::remove_file(visibility).unwrap();
    let refused = stderr(&expect_status(2, plan(&cloud, &work, "2", "cut")));
    assert!(refused.contains("fused.ply.vis"), "{refused}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn recorded_models_in_tiles_leave_the_mesh_of_one_process() {
    let data = std::env::var("LINECARVE_DATA").expect("the folder of recorded sequences");
    for (model, labels, tiles) in [
        ("sceaux-castle/scene.mvs", "votes", "7"),
        ("euroc-v101/colmap", "cut", "64"),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let model = Path::new(&data).join(model);
        assert_same(&model, folder.path(), labels, &[tiles]);
    }
}

#[test]
fn stages_are_listed_and_damage_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let [model, _] = models(folder.path());
    let work = folder.path().join("work");
    expect_status(0, plan(&model, &work, "3", "votes"));
    let early = ["tiles", "item", text(&work), "surface", "1"];
    let refused = stderr(&expect_status(2, early));
    assert!(refused.contains("frame 1"), "{refused}");
    let too_small = ["tiles", "run", text(&work), "--memory-limit", "1M"];
    if cfg!(target_os = "linux") {
        let refused = stderr(&expect_status(2, too_small));
        assert!(refused.contains("frame 0"), "{refused}");
    }
    expect_status(0, ["tiles", "run", text(&work), "-q"]);
    let json = expect_status(0, ["tiles", "stages", text(&work), "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let items = json["items"].as_array().unwrap();
    assert_eq!(items.len(), 3 + 3 + 1 + 3 + 1);
    assert!(items.iter().all(|item| item["done"] == true));
    expect_status(0, ["tiles", "check", text(&work)]);
    let damaged = work.join("carve/000001.tile");
    let bytes = std::fs::read(&damaged).unwrap();
    std::fs::write(&damaged, &bytes[..bytes.len() / 2]).unwrap();
    let said = stderr(&expect_status(1, ["tiles", "check", text(&work)]));
    assert!(said.contains("carve 1"), "{said}");
    let said = stderr(&expect_status(0, ["tiles", "run", text(&work)]));
    assert!(said.contains("1 tasks"), "{said}");
    let other = plan(&model, &work, "4", "votes");
    let refused = stderr(&expect_status(2, other));
    assert!(refused.contains("another folder"), "{refused}");
    let no_model = folder.path().join("nothing");
    std::fs::create_dir(&no_model).unwrap();
    expect_status(2, plan(&no_model, &work, "4", "votes"));
}

#[test]
fn a_damaged_plan_is_named_and_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let city = folder.path().join("city");
    let synth = ["synth", "city", "--points", "3000", "-q", "--out"];
    expect_status(0, synth.into_iter().chain([text(&city)]));
    let (cloud, work) = (city.join("fused.ply"), folder.path().join("work"));
    let make = || expect_status(0, plan(&cloud, &work, "2", "cut"));
    make();
    expect_status(0, ["tiles", "run", text(&work), "-q"]);
    let mesh = std::fs::read(work.join("mesh.ply")).unwrap();
    for name in ["plan/sample", "plan/rays/000001.tile", "plan.json"] {
        let path = work.join(name);
        let whole = std::fs::read(&path).unwrap();
        let cut = whole[..whole.len() / 2].to_vec();
        let damages = [Some(cut), None]
            .into_iter()
            .filter(|it| it.is_some() || name != "plan.json");
        for damage in damages {
            match damage {
                Some(cut) => std::fs::write(&path, cut).unwrap(),
                None => std::fs::remove_file(&path).unwrap(),
            }
            for (status, command) in [(1, "check"), (2, "run")] {
                let said = stderr(&expect_status(status, ["tiles", command, text(&work)]));
                let is_told = said.contains(name) && said.contains("`linecarve tiles plan` again");
                assert!(is_told, "{command}: {said}");
            }
            make();
            assert!(std::fs::read(&path).unwrap() == whole, "{name}");
            expect_status(0, ["tiles", "check", text(&work)]);
        }
    }
    let said = stderr(&expect_status(0, ["tiles", "run", text(&work)]));
    assert!(said.contains("0 tasks"), "{said}");
    assert!(std::fs::read(work.join("mesh.ply")).unwrap() == mesh);
}

#[test]
fn a_folder_without_a_plan_is_told_how_to_make_one() {
    let folder = tempfile::tempdir().unwrap();
    let work = text(folder.path());
    let slurm = ["tiles", "script", work];
    let others = ["run", "stages", "check"].map(|it| ["tiles", it, work]);
    for command in others.into_iter().chain([slurm]) {
        let said = stderr(&expect_status(2, command));
        assert!(said.contains("it holds no plan"), "{said}");
        assert!(
            said.contains(&format!("`linecarve tiles plan INPUT {work}`")),
            "{said}"
        );
    }
}

/// Plans the sample.
fn plan_room<'a>(room: &'a Path, work: &'a Path, tiles: &'a str, labels: &'a str) -> Vec<&'a str> {
    let groups = ["--keyframes-per-task", "5"];
    [&plan(room, work, tiles, labels)[..], &CHOICE, &groups].concat()
}

#[test]
fn a_sequence_in_tiles_leaves_the_mesh_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    for (labels, counts) in [("votes", &["2"][..]), ("cut", &["1", "7"])] {
        let out = folder.path().join(format!("whole-{labels}"));
        let expected = whole_of(&room, &out, labels, &CHOICE);
        for tiles in counts {
            let work = folder.path().join(format!("{labels}-{tiles}"));
            expect_status(0, plan_room(&room, &work, tiles, labels));
            expect_status(0, ["tiles", "run", text(&work), "--jobs", "2", "-q"]);
            let mesh = std::fs::read(work.join("mesh.ply")).unwrap();
            assert!(mesh == expected, "{labels}, {tiles} tiles");
        }
    }
}

#[test]
fn lines_in_tiles_leave_the_mesh_of_one_process() {
    let folder = tempfile::tempdir().unwrap();
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let how = ["--from", "lines", "--depth", "semi-dense", "--every", "2"];
    let how = [&how[..], &["--max-keyframes", "9"]].concat();
    let expected = whole_of(&room, &folder.path().join("whole"), "cut", &how);
    let work = folder.path().join("work");
    let groups = ["--keyframes-per-task", "2"];
    let plan = [&plan(&room, &work, "3", "cut")[..], &how, &groups].concat();
    expect_status(0, plan);
    expect_status(0, ["tiles", "run", text(&work), "--jobs", "2", "-q"]);
    assert!(std::fs::read(work.join("mesh.ply")).unwrap() == expected);
    // Depth images are compared with every surface.
    let sensor = ["tiles", "plan", text(&room), "elsewhere", "--from", "lines"];
    let refused = stderr(&expect_status(2, sensor));
    assert!(refused.contains("--depth semi-dense"), "{refused}");
}

#[test]
fn damage_to_a_sequence_is_named_and_mended() {
    let folder = tempfile::tempdir().unwrap();
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let expected = whole_of(&room, &folder.path().join("whole"), "votes", &CHOICE);
    let work = folder.path().join("work");
    expect_status(0, plan_room(&room, &work, "2", "votes"));
    // The same plan changes nothing, others are refused.
    expect_status(0, plan_room(&room, &work, "2", "votes"));
    for other in [
        plan_room(&room, &work, "3", "votes"),
        plan(&room, &work, "2", "cut"),
    ] {
        let refused = stderr(&expect_status(2, other));
        assert!(refused.contains("another folder"), "{refused}");
    }
    let [model, _] = models(folder.path());
    let refused = stderr(&expect_status(2, plan(&model, &work, "2", "votes")));
    assert!(refused.contains("another folder"), "{refused}");
    for (early, needed) in [("intake", "keyframes 0"), ("frame", "intake")] {
        let refused = stderr(&expect_status(
            2,
            ["tiles", "item", text(&work), early, "0"],
        ));
        assert!(refused.contains(needed), "{refused}");
    }
    expect_status(2, ["tiles", "item", text(&work), "keyframes", "3"]);
    let tasks = items(&work);
    assert_eq!(tasks.len(), 3 + 1 + 2 + 2 + 1 + 2 + 1);
    for (moment, item) in (0u64..).zip(&tasks) {
        let mut killed = start_item(&work, item);
        std::thread::sleep(std::time::Duration::from_millis(moment * 53 % 97));
        let _ = killed.kill();
        killed.wait().unwrap();
        for mut one in [start_item(&work, item), start_item(&work, item)] {
            assert!(one.wait().unwrap().success(), "{item:?}");
        }
    }
    let run = |count: &str| {
        let said = stderr(&expect_status(0, ["tiles", "run", text(&work)]));
        assert!(said.contains(count), "{said}");
        assert!(std::fs::read(work.join("mesh.ply")).unwrap() == expected);
    };
    run("0 tasks");
    // A bit of what the front end found, of the plan that the intake made, a file that is gone, and one that is shorter.
    let flip = |path: &Path| {
        let mut bytes = std::fs::read(path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        std::fs::write(path, bytes).unwrap();
    };
    let damage: [(&dyn Fn(), &str); 4] = [
        (
            &|| flip(&work.join(".linecarve/000007.keyframe")),
            "keyframes 1",
        ),
        (&|| flip(&work.join("plan/points/000001.tile")), "intake 0"),
        (
            &|| std::fs::remove_file(work.join(".linecarve/000002.keyframe")).unwrap(),
            "keyframes 0",
        ),
        (
            &|| std::fs::write(work.join("plan.json"), "{").unwrap(),
            "intake 0",
        ),
    ];
    for (damage, task) in damage {
        damage();
        let said = stderr(&expect_status(1, ["tiles", "check", text(&work)]));
        assert!(said.contains(task), "{said}");
        run("1 tasks");
        expect_status(0, ["tiles", "check", text(&work)]);
    }
    // The poses are other ones than those of the plan.
    std::fs::write(work.join(".linecarve/run.txt"), "another").unwrap();
    std::fs::remove_file(work.join("keyframes/000001.json")).unwrap();
    let refused = stderr(&expect_status(2, ["tiles", "run", text(&work)]));
    assert!(refused.contains("no longer what was planned"), "{refused}");
}

/// The commands of a plan's tasks in the order of their stages.
fn items(work: &Path) -> Vec<[String; 2]> {
    let json = expect_status(0, ["tiles", "stages", text(work), "--json"]).stdout;
    let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
    let items = json["items"].as_array().unwrap().iter();
    let name = |item: &serde_json::Value| item["stage"].as_str().unwrap().to_owned();
    items
        .map(|item| [name(item), item["item"].to_string()])
        .collect()
}

fn start_item(work: &Path, [stage, number]: &[String; 2]) -> std::process::Child {
    let program = assert_cmd::cargo::cargo_bin("linecarve");
    std::process::Command::new(program)
        .args(["tiles", "item", text(work), stage, number])
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap()
}

#[test]
fn killed_and_repeated_tasks_change_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let city = folder.path().join("city");
    let synth = ["synth", "city", "--points", "2500", "-q", "--out"];
    expect_status(0, synth.into_iter().chain([text(&city)]));
    let cloud = city.join("fused.ply");
    let expected = whole(&cloud, &folder.path().join("whole"), "cut");
    let work = folder.path().join("work");
    expect_status(0, plan(&cloud, &work, "2", "cut"));
    for (moment, item) in (0u64..).zip(items(&work)) {
        // Killed at a moment that differs from task to task, which may be after its end.
        let mut killed = start_item(&work, &item);
        std::thread::sleep(std::time::Duration::from_millis(moment * 37 % 61));
        let _ = killed.kill();
        killed.wait().unwrap();
        // Two at once, and one more.
        let both = [start_item(&work, &item), start_item(&work, &item)];
        for mut one in both {
            assert!(one.wait().unwrap().success(), "{item:?}");
        }
        assert!(start_item(&work, &item).wait().unwrap().success());
    }
    let said = stderr(&expect_status(0, ["tiles", "run", text(&work)]));
    assert!(said.contains("0 tasks"), "{said}");
    assert!(std::fs::read(work.join("mesh.ply")).unwrap() == expected);
}

#[test]
#[cfg(unix)]
fn a_full_disk_is_named_and_the_run_goes_on_later() {
    let folder = tempfile::tempdir().unwrap();
    let [model, _] = models(folder.path());
    let expected = whole(&model, &folder.path().join("whole"), "votes");
    let work = folder.path().join("work");
    expect_status(0, plan(&model, &work, "2", "votes"));
    // Files of more than so many blocks of 512 bytes are refused, as by a disk that is full.
    let program = assert_cmd::cargo::cargo_bin("linecarve");
    let limited = |blocks: u32| {
        let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$@\"");
        let run = ["tiles", "run", text(&work), "-q"];
        let mut shell = std::process::Command::new("sh");
        shell.args(["-c", &script, "sh"]).arg(&program).args(run);
        shell.output().unwrap()
    };
    let mut refusals = 0;
    for blocks in [1, 8, 32, 64] {
        let output = limited(blocks);
        if output.status.success() {
            continue;
        }
        refusals += 1;
        assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
        let said = stderr(&output);
        assert!(said.contains(text(&work)), "{said}");
        assert!(!work.join("mesh.ply").exists());
    }
    assert!(refusals > 1);
    expect_status(0, ["tiles", "run", text(&work), "-q"]);
    assert!(std::fs::read(work.join("mesh.ply")).unwrap() == expected);
}

#[test]
#[cfg(unix)]
fn the_script_for_slurm_carries_out_all_stages() {
    use std::os::unix::fs::PermissionsExt;

    let folder = tempfile::tempdir().unwrap();
    let [model, _] = models(folder.path());
    let expected = whole(&model, &folder.path().join("whole"), "cut");
    let work = folder.path().join("the user's work");
    expect_status(0, plan(&model, &work, "3", "cut"));
    let arguments = ["tiles", "script", text(&work), "--memory-limit", "3G"];
    let script = expect_status(0, arguments).stdout;
    let script = String::from_utf8(script).unwrap();
    for part in [
        "job0=$(array frame 0 2 \"$@\")",
        "after=--dependency=afterok:${job0%%;*}",
        "job0=$(array settle 0 0 \"$@\")",
        "--mem=3000M",
        "--memory-limit=3000M",
        "--kill-on-invalid-dep=yes",
    ] {
        assert!(script.contains(part), "{part} is not in\n{script}");
    }
    let path = folder.path().join("run.sh");
    std::fs::write(&path, script).unwrap();
    // A stand-in that carries out each job at once, and writes down its arguments.
    let stub = folder.path().join("sbatch");
    let stand_in = r#"#!/bin/sh
set -eu
echo "$*" >> "$(dirname "$0")/jobs"
last=
for argument; do
    case $argument in --array=0-*) last=${argument#--array=0-};; esac
    command=$argument
done
number=$(wc -l < "$(dirname "$0")/jobs")
index=0
while [ "$index" -le "${last:-0}" ]; do
    SLURM_ARRAY_TASK_ID=$index sh -c "$command" >&2
    index=$((index + 1))
done
echo "$((number + 100));cluster"
"#;
    std::fs::write(&stub, stand_in).unwrap();
    std::fs::set_permissions(&stub, std::fs::Permissions::from_mode(0o755)).unwrap();
    let paths = format!(
        "{}:{}",
        folder.path().display(),
        std::env::var("PATH").unwrap()
    );
    let output = std::process::Command::new("sh")
        .arg(&path)
        .args(["--partition=long"])
        .env("PATH", paths)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(std::fs::read(work.join("mesh.ply")).unwrap() == expected);
    let jobs = std::fs::read_to_string(folder.path().join("jobs")).unwrap();
    assert_eq!(jobs.lines().count(), 8 + 1);
    assert!(jobs.lines().all(|job| job.contains("--partition=long")));
    let carve = jobs.lines().nth(1).unwrap();
    assert!(carve.contains("--dependency=afterok:101 "), "{carve}");
}
