//! Each key of the tables `carving`, `surface` and `simplify` changes the mesh that is written.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::program::{reconstruct_mesh, small_sequence, text};

/// What a case runs on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Recording {
    Boxes,
    /// Three keyframes of the sample.
    Room,
    /// The map points of some keyframes of the sample, which have no depth images.
    RoomPoints,
}

use Recording::{Boxes, Room, RoomPoints};

/// A key, where it matters, and two settings of which only the value of this key differs.
const CASES: [(&str, Recording, [&str; 2]); 12] = [
    ("carving.labels", Boxes, ["", "carving.labels = 'votes'"]),
    (
        "carving.free_threshold",
        Boxes,
        [
            "carving.labels = 'votes'",
            "carving.labels = 'votes'\ncarving.free_threshold = 3",
        ],
    ),
    (
        "carving.cut.behind_sigmas",
        Boxes,
        ["", "carving.cut.behind_sigmas = 6"],
    ),
    (
        "carving.cut.matter_weight",
        Boxes,
        ["", "carving.cut.matter_weight = 4"],
    ),
    (
        "carving.cut.quality_weight",
        Boxes,
        ["", "carving.cut.quality_weight = 4"],
    ),
    (
        "surface.longest_edge_share",
        RoomPoints,
        ["", "surface.longest_edge_share = 0.05"],
    ),
    (
        "surface.least_measured_share",
        Boxes,
        ["", "surface.least_measured_share = 0.9"],
    ),
    (
        "surface.minimum_component",
        Room,
        ["", "surface.minimum_component = 60"],
    ),
    ("surface.holes", Room, ["", "surface.holes = 'all'"]),
    ("surface.holes", Room, ["", "surface.holes = 'none'"]),
    (
        "simplify.tolerance",
        Boxes,
        ["", "simplify.tolerance = 0.01"],
    ),
    (
        "simplify.boundary_tolerance",
        Boxes,
        [
            "simplify.tolerance = 0.01",
            "simplify.tolerance = 0.01\nsimplify.boundary_tolerance = 0.05",
        ],
    ),
];

/// The keys of these tables that `docs/configuration.md` lists.
fn documented() -> BTreeSet<String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/configuration.md");
    let document = std::fs::read_to_string(path).unwrap();
    let mut table = "";
    let mut keys = BTreeSet::new();
    for line in document.lines() {
        if let Some(name) = line.strip_prefix("## ") {
            table = name.trim_matches(['`', '[', ']']);
        } else if let Some((key, _)) = line
            .strip_prefix("- **`")
            .and_then(|rest| rest.split_once('`'))
            && ["carving", "carving.cut", "surface", "simplify"].contains(&table)
        {
            keys.insert(format!("{table}.{key}"));
        }
    }
    keys
}

#[test]
fn each_key_changes_the_mesh() {
    let cases: BTreeSet<String> = CASES.iter().map(|(key, ..)| (*key).to_owned()).collect();
    assert_eq!(cases, documented());

    let folder = small_sequence(6, "tum");
    let boxes = folder.path().join("sequence");
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let mut meshes: BTreeMap<(Recording, &str), Vec<u8>> = BTreeMap::new();
    for (key, recording, settings) in CASES {
        for settings in settings {
            let number = meshes.len();
            meshes.entry((recording, settings)).or_insert_with(|| {
                let (sequence, selection) = match recording {
                    Boxes => (&boxes, ["--every", "1", "--from", "lines"]),
                    Room => (&room, ["--every", "18", "--from", "lines"]),
                    RoomPoints => (&room, ["--every", "4", "--from", "map-points"]),
                };
                let file = |end: &str| folder.path().join(format!("{number}.{end}"));
                let [out, config] = ["out", "toml"].map(file);
                std::fs::write(&config, settings).unwrap();
                let more = [&selection[..], &["--config", text(&config)]].concat();
                reconstruct_mesh(0, sequence, &more, &out);
                std::fs::read(out.join("mesh.ply")).unwrap()
            });
        }
        let [one, other] = settings.map(|settings| &meshes[&(recording, settings)]);
        assert!(one != other, "{key} changes nothing");
    }
}
