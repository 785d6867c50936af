//! What a configuration file sets, and how it is refused.

use std::path::Path;

use linecarve_mesh::diff::Tolerance;

use super::read::parse;
use super::{Configuration, ConfigurationError, Table};
use crate::options::Options;
use crate::options::{HoleFilling, LabelKind};

fn read(text: &str) -> Result<Configuration, ConfigurationError> {
    parse(text, Path::new("room.toml"))
}

fn message(text: &str) -> String {
    read(text).unwrap_err().to_string()
}

/// A file that sets one key.
fn setting(path: &str, value: &str) -> String {
    format!("{path} = {value}\n")
}

#[test]
fn the_defaults_are_those_of_the_options() {
    let configuration = Configuration::default();
    assert_eq!(configuration.options(), Options::default());
    assert_eq!(read("").unwrap(), configuration);
    assert!(configuration.check().is_ok());
}

#[test]
fn every_key_has_a_description_and_a_range_that_the_stages_accept() {
    let keys: Vec<_> = Configuration::tables()
        .iter()
        .flat_map(|Table { keys, .. }| *keys)
        .collect();
    assert!((20..=30).contains(&keys.len()), "{} keys", keys.len());
    for key in keys {
        assert!(
            key.doc.contains("Set it") || key.doc.contains("overrides it"),
            "{}: when to change it",
            key.path
        );
        for bound in [key.values.least, key.values.most] {
            // All numbers have two bounds, and what is no number has none.
            if key.values.least == f64::NEG_INFINITY && key.values.most == f64::INFINITY {
                assert!(!key.values.text.contains("number"), "{}", key.path);
                continue;
            }
            assert!(bound.abs() <= 1e9, "{}", key.path);
            let text = match bound {
                whole if whole.fract() == 0.0 => setting(key.path, &format!("{whole}")),
                other => setting(key.path, &format!("{other:e}")),
            };
            let options = read(&text).expect(&text).options();
            options.validate().expect(&text);
            options.keyframes.validate().expect(&text);
        }
    }
}

#[test]
fn a_configuration_survives_its_file_and_the_report() {
    let text = r#"
[keyframes]
translation = 0.15
sharpness_window = 1
[images]
longest_side_px = 0
[semi_dense]
future = 5
match.least_agreeing = 3
between_edges = false
[pose_correction]
enabled = false
[map_points]
min_views = 2
min_model_views = 4
[carving]
labels = "votes"
cut.quality_weight = 0.2
[surface]
holes = "all"
longest_edge_share = 0
[simplify]
tolerance = "0.07%"
boundary_tolerance = 0.01
"#;
    let configuration = read(text).unwrap();
    let options = configuration.options();
    assert_eq!(options.keyframes.translation, Some(0.15));
    assert_eq!(options.semi_dense.matching.least_agreeing, 3);
    assert!(!options.semi_dense.is_dense);
    assert!(!options.pose_correction.enabled);
    assert_eq!(options.map_points.min_views, 2);
    assert_eq!(options.point_model.min_views, 4);
    assert_eq!(options.carving.labels, LabelKind::Votes);
    assert_eq!(options.carving.cut.quality_weight, 0.2);
    assert_eq!(options.surface.holes, HoleFilling::All);
    assert_eq!(options.surface.longest_edge_share, None);
    assert_eq!(
        options.simplify.tolerance,
        Some(Tolerance::ShareOfDiagonal(0.07 / 100.0))
    );
    assert_eq!(
        options.simplify.boundary_tolerance,
        Some(Tolerance::Length(0.01))
    );
    assert_eq!(Configuration::of(&options), configuration);

    let written = toml::to_string(&configuration).unwrap();
    assert!(written.contains("tolerance = \"0.07%\""), "{written}");
    assert_eq!(read(&written).unwrap(), configuration);
    let json = serde_json::to_value(configuration).unwrap();
    let report: Configuration = serde_json::from_value(json.clone()).unwrap();
    assert_eq!(report, configuration);
    let toml_of_report = toml::to_string(&json).unwrap();
    assert_eq!(read(&toml_of_report).unwrap(), configuration);
}

#[test]
fn unknown_keys_are_refused_with_the_nearest() {
    let path = "room.toml, line 3: unknown key ";
    for (text, expected) in [
        (
            "\n[carving]\nlabel = \"cut\"\n",
            "`carving.label`; did you mean `carving.labels`?",
        ),
        (
            "\n[carvin]\nlabels = \"cut\"\n",
            "`carvin.labels`; did you mean `carving.labels`?",
        ),
        (
            "\n[carving.cut]\nquality = 1\nlabels = 3\n",
            "`carving.cut.quality`; the keys of this table are behind_sigmas, matter_weight, quality_weight",
        ),
        (
            "\n\nvoxels = 3\n",
            "`voxels`; docs/configuration.md lists the keys",
        ),
        (
            "\n\n[voxels]\n",
            "`voxels`; docs/configuration.md lists the keys",
        ),
    ] {
        assert_eq!(message(text), format!("{path}{expected}"));
    }
}

#[test]
fn values_are_refused_with_line_and_range() {
    for (text, expected) in [
        (
            "[carving]\nfree_threshold = 0 # all\n",
            "line 2: carving.free_threshold = 0: a whole number from 1 to 1000000 is needed",
        ),
        (
            "[carving]\nlabels = \"cuts\"\n",
            "line 2: carving.labels = \"cuts\": \"votes\" or \"cut\" is needed",
        ),
        (
            "[keyframes]\n\nsharpness_window = \"3\"\n",
            "line 3: keyframes.sharpness_window = \"3\": a whole number from 1 to 1000 is needed",
        ),
        (
            "surface.least_measured_share = 1.5",
            "line 1: surface.least_measured_share = 1.5: a number from 0 to 1 is needed",
        ),
        (
            "carving.cut.behind_sigmas = nan",
            "line 1: carving.cut.behind_sigmas = nan: a number from 0 to 100 is needed",
        ),
        (
            "[sensor]\nrelative_noise = inf\n",
            "line 2: sensor.relative_noise = inf: a number from 0.000001 to 1 is needed",
        ),
        (
            "[simplify]\ntolerance = \"2 mm\"\n",
            "line 2: simplify.tolerance = \"2 mm\": a length above 0",
        ),
        (
            "[simplify]\ntolerance = 0\n",
            "line 2: simplify.tolerance = 0: a length above 0",
        ),
        ("carving = 3\n", "line 1: carving = 3: a table is needed"),
        (
            "[carving.labels]\ncut = 1\n",
            "\"votes\" or \"cut\" is needed",
        ),
        ("[pose_correction]\nlens = 1\n", "true or false is needed"),
        ("\n[carving\n", "line 2: not TOML"),
    ] {
        let message = message(text);
        assert!(
            message.starts_with("room.toml, ") && message.contains(expected),
            "{message}"
        );
    }
    let missing = Configuration::read(Path::new("/nowhere/room.toml")).unwrap_err();
    assert!(missing.to_string().contains("/nowhere/room.toml"));
}
