//! A model in tiles: the bytes of one process, damage, refusals.

use std::path::Path;

use crate::program::{colmap_relief, expect_status, stderr, text};

/// `mesh.ply` of one process.
fn whole(model: &Path, out: &Path, labels: &str) -> Vec<u8> {
    let from = [
        "reconstruct",
        text(model),
        "--from",
        "map-points",
        "--final-only",
    ];
    let how = ["--format", "ply", "--labels", labels, "--no-page"];
    let to = ["--no-picture", "--quiet", "--out", text(out)];
    expect_status(0, from.iter().chain(&how).chain(&to));
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
    // One image too few, and a cloud without its visibility.
    let visibility = city.join("fused.ply.vis");
    let mut bytes = std::fs::read(&visibility).unwrap();
    bytes[12..16].copy_from_slice(&u32::MAX.to_le_bytes());
    std::fs::write(&visibility, bytes).unwrap();
    let work = folder.path().join("refused");
    let refused = stderr(&expect_status(2, plan(&cloud, &work, "2", "cut")));
    assert!(refused.contains("fused.ply.vis"), "{refused}");
    std::fs::remove_file(visibility).unwrap();
    let refused = stderr(&expect_status(2, plan(&cloud, &work, "2", "cut")));
    assert!(refused.contains("fused.ply.vis"), "{refused}");
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn recorded_models_in_tiles_leave_the_mesh_of_one_process() {
    let data = std::env::var("LINECARVE_DATA").expect("the folder of recorded sequences");
    for model in ["sceaux-castle/scene.mvs", "euroc-v101/colmap"] {
        let folder = tempfile::tempdir().unwrap();
        for labels in ["votes", "cut"] {
            let model = Path::new(&data).join(model);
            assert_same(&model, folder.path(), labels, &["1", "7", "64"]);
        }
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
