//! What a configuration file sets, and how it is refused.

use std::path::Path;

use linecarve_mesh::diff::Tolerance;

use super::read::parse;
use super::{Configuration, ConfigurationError, Table};
use crate::options::Options;
use crate::options::{LabelKind, SurfaceMethod};

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
[carving]
labels = "votes"
cut.quality_weight = 0.2
[surface]
method = "fused"
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
    assert_eq!(options.point_model.min_views, 2);
    assert_eq!(options.carving.labels, LabelKind::Votes);
    assert_eq!(options.carving.cut.quality_weight, 0.2);
    assert_eq!(options.surface.method, SurfaceMethod::Fused);
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

/// All keys of version 0.1.0 before this table was made, by table.
const EARLIER: &str = "
keyframes: translation_share translation rotation_degrees min_overlap sharpness_window
images: longest_side_px
sensor: relative_noise
semi_dense: past future first_neighbours relative_noise edge_point_spacing_px
semi_dense.neighbours: count least_overlap least_parallax_rad largest_parallax_rad precision match_sigma_px
semi_dense.match: least_gradient largest_epipolar_angle_rad largest_gradient_turn_rad largest_parallax truncation_sigmas \
largest_residual fusion_chi2 least_agreeing least_agreeing_share largest_rival_share largest_relative_sigma epipolar_sigma_px \
least_epipolar_sigma_px chain_reach_px least_confirming smooth_along_chain longest_gap_px seed_spacing_px hidden_pose_error align_neighbours
semi_dense.confirm: chi2 radius_px least_agreeing refine
semi_dense.sweep: spacing_px neighbours reach least_correlation agreeing_share least_margin least_texture largest_relative_sigma
edges: gradient_threshold anchor_threshold minimum_length_px
edge_depth: radius_px smoothing_radius_px jump_sigmas jump_relative least_support
fit: window_share image_tolerance_share depth_tolerance_share depth_gate_sigmas depth_model subpixel refit_while_growing \
minimum_inlier_share minimum_view_angle_rad pixel_sigma_px end_sigma_px depth_correlation_px
cluster: maximum_angle_rad distance_share offset_share minimum_size merge
line_detection: line_error_px outliers_in_a_row join_gap_px join_error_px validate alignment_rad false_alarms subpixel
decoupled: minimum_length_px depth_model depth_tolerance minimum_inlier_share minimum_view_angle_rad seed
matched: minimum_length_share maximum_segments neighbours minimum_baseline_share maximum_axis_angle_rad minimum_overlap matches_per_view \
position_sigma_px angle_sigma_rad minimum_similarity minimum_score minimum_affinity minimum_views minimum_view_angle_rad refine_iterations huber_px
points: minimum_gradient
segment_points: spacing_px conforming
surface_points: enabled agreement_sigmas correction_sigmas
surface_points.samples: step_px window_radius_px gate_sigmas minimum_share
surface_points.refine: bound_sigmas minimum_distance_px largest_gap_px
landmarks: join lateral_px depth_sigmas settling_share
pose_correction: enabled lens sigma_px window min_points move_px
map_points: features levels scale_factor corner_threshold feature_sigma_px pose_sigma_px neighbors new_descriptor_distance \
known_descriptor_distance ratio rotation_degrees parallax_degrees min_views probation max_relative_sigma move_sigmas
point_model: min_views parallax_degrees max_reprojection_px
carving: labels free_threshold segment_weight triangulation_weight least_ray_angle_deg least_segment_angle_deg
carving.cut: sigma_factor behind_sigmas matter_weight quality_weight
surface: longest_edge_share least_measured_share minimum_component keep_hull manifold
";

#[test]
fn removed_keys_are_answered_with_what_became_of_them() {
    let tables = Configuration::tables();
    let is_key = |path: &str| {
        let mut keys = tables.iter().flat_map(|table| table.keys);
        keys.any(|key| key.path == path)
    };
    let (mut count, mut kept) = (0, 0);
    for line in EARLIER.trim().lines() {
        let (table, names) = line.split_once(": ").expect("a table and its keys");
        for name in names.split_whitespace() {
            count += 1;
            let path = format!("{table}.{name}");
            if is_key(&path) {
                kept += 1;
                continue;
            }
            let error = read(&format!("# earlier\n{}", setting(&path, "1"))).unwrap_err();
            assert!(
                matches!(&error, ConfigurationError::Removed { key, line: 2, .. } if *key == path),
                "{error}"
            );
        }
    }
    assert_eq!((count, kept), (162, 23));
    assert_eq!(
        message("[point_model]\nmin_views = 2\n"),
        "room.toml, line 2: `point_model.min_views` is no longer a key: `map_points.min_views` sets it as well"
    );
    let fit = message("fit.minimum_inlier_share = 0.4");
    assert!(
        fit.contains("FitOptions") && fit.contains("lab/notes/ablation.md"),
        "{fit}"
    );
    // A key that there never was in a table that there is.
    assert!(matches!(
        read("map_points.feature = 1"),
        Err(ConfigurationError::Unknown {
            nearest: Some("map_points.features"),
            ..
        })
    ));
}
