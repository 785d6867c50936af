//! Splits of the sample and of recorded models: the mesh of one process.
//!
//! Seeds of splits are options of the library alone.

use std::path::{Path, PathBuf};

use linecarve_tiles::{PlanOptions, merged_mesh, run, run_item};

use crate::front_end::Keyframe;
use crate::map::Map;
use crate::options::{LabelKind, Options};
use crate::reconstruction::{Reconstruction, RunOptions};
use crate::recording::{Input, Recording, SourceChoice};
use crate::run::CancelToken;

/// Seeds whose splits differ, also those into two tiles.
const SEEDS: [u64; 2] = [0, 2];

fn input(path: PathBuf, source: SourceChoice) -> Input {
    Input {
        source,
        ..Input::from(path)
    }
}

fn options(labels: LabelKind) -> Options {
    let mut options = Options::default();
    options.carving.labels = labels;
    options
}

/// Carves the points of a map in tiles, and compares the mesh with that of one process.
fn assert_splits_agree(map: &Map, name: &str, counts: &[usize]) {
    let carver = map.carver();
    let export = map.export_options();
    let mut whole = carver.clone();
    whole.carve();
    let whole = whole.mesh(&export);
    assert!(whole.triangles.len() > 1000, "{name}");
    for &tiles in counts {
        let mut splits = Vec::new();
        for seed in SEEDS {
            let mut options = PlanOptions::default();
            options.tiles = tiles;
            options.seed = seed;
            let folder = tempfile::tempdir().unwrap();
            let work =
                linecarve_tiles::plan(folder.path(), carver, &export, &options, String::new())
                    .unwrap();
            run(&work, 2, |item| run_item(&work, item, || None)).unwrap();
            let mesh = merged_mesh(&work).unwrap();
            assert!(mesh == whole, "{name}, {tiles} tiles, seed {seed}");
            let sizes: Vec<usize> = work.plan().tiles.iter().map(|tile| tile.rays).collect();
            splits.push(sizes);
        }
        splits.sort_unstable();
        splits.dedup();
        assert_eq!(splits.len(), if tiles == 1 { 1 } else { SEEDS.len() });
    }
}

/// The points of the sample's ORB features.
#[test]
fn splits_of_the_sample_leave_the_mesh_of_one_process() {
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/room");
    for (labels, counts) in [(LabelKind::Votes, [2, 7]), (LabelKind::Cut, [1, 64])] {
        let mut input = input(room.clone(), SourceChoice::MapPoints);
        input.selection.every = Some(2);
        let recording = Recording::open(&input, options(labels)).unwrap();
        let mut run = Reconstruction::new(recording, RunOptions::default()).unwrap();
        assert!(run.leave_carving());
        run.run(CancelToken::default(), &mut []).unwrap();
        assert_splits_agree(run.map(), "room", &counts);
    }
}

#[test]
#[ignore = "needs LINECARVE_DATA"]
fn splits_of_recorded_models_leave_the_mesh_of_one_process() {
    let data = std::env::var("LINECARVE_DATA").expect("the folder of recorded sequences");
    for (model, labels, count) in [
        ("sceaux-castle/scene.mvs", LabelKind::Votes, 7),
        ("sceaux-castle/scene.mvs", LabelKind::Cut, 64),
        ("euroc-v101/colmap", LabelKind::Cut, 7),
    ] {
        let path = Path::new(&data).join(model);
        let input = input(path, SourceChoice::MapPoints);
        let mut recording = Recording::open(&input, options(labels)).unwrap();
        let model_points = recording.take_model().unwrap();
        let mut map = Map::of_model(&recording.options, model_points).unwrap();
        map.defer_carving();
        let views = 0..recording.keyframes.len();
        map.push(&Keyframe::Views(views)).unwrap();
        assert_splits_agree(&map, model, &[count]);
    }
}
