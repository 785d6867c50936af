//! What became of keys of earlier versions.

/// Keys of one table that are keys no longer.
struct Removed {
    table: &'static str,
    /// Their names; empty for the whole table. A name may be that of a table.
    names: &'static [&'static str],
    became: &'static str,
}

const fn all(table: &'static str, became: &'static str) -> Removed {
    some(table, &[], became)
}

const fn some(
    table: &'static str,
    names: &'static [&'static str],
    became: &'static str,
) -> Removed {
    Removed {
        table,
        names,
        became,
    }
}

const EXPERIMENT: &str =
    "it was an experiment, off by default; lab/notes/ablation.md has what it gave, remove the key";

const REMOVED: &[Removed] = &[
    all(
        "edges",
        "it is a field of EdgeOptions in the library crate linecarve-lines, tuned; remove the key",
    ),
    all(
        "edge_depth",
        "it is a field of EdgeDepthOptions in the library crate linecarve-lines, tuned; remove the key",
    ),
    all(
        "fit",
        "it is a field of FitOptions in the library crate linecarve-lines, tuned; see lab/notes/ablation.md, remove the key",
    ),
    all(
        "cluster",
        "it is a field of ClusterOptions in the library crate linecarve-lines, tuned; remove the key",
    ),
    all(
        "line_detection",
        "the methods that the program is compared with are in the crate linecarve-lab, with their parameters; remove the key",
    ),
    all(
        "decoupled",
        "this method is in the crate linecarve-lab, with its parameters; remove the key",
    ),
    all(
        "matched",
        "this method is in the crate linecarve-lab, with its parameters; remove the key",
    ),
    all(
        "points",
        "this method is in the crate linecarve-lab, with its parameters; remove the key",
    ),
    some("segment_points", &["conforming"], EXPERIMENT),
    all(
        "segment_points",
        "it is a field of Options in the library crate linecarve, tuned; see lab/notes/ablation.md, remove the key",
    ),
    all(
        "surface_points",
        "it is a field of Options in the library crate linecarve, tuned; see lab/notes/ablation.md, remove the key",
    ),
    all(
        "landmarks",
        "it is a field of Options in the library crate linecarve, tuned; see lab/notes/ablation.md, remove the key",
    ),
    some(
        "point_model",
        &["min_views"],
        "`map_points.min_views` sets it as well",
    ),
    all(
        "point_model",
        "it is a field of Options in the library crate linecarve, tuned; remove the key",
    ),
    some(
        "keyframes",
        &["translation_share", "min_overlap"],
        "it is a field of KeyframeOptions in the library crate linecarve-sequence; set `keyframes.translation` in the unit of the poses",
    ),
    some("carving", &["triangulation_weight"], EXPERIMENT),
    some(
        "carving",
        &["least_ray_angle_deg", "least_segment_angle_deg"],
        "it is a field of Options in the library crate linecarve, tuned; remove the key",
    ),
    some(
        "carving.cut",
        &["sigma_factor"],
        "standard deviations are taken as measured; `sensor.relative_noise` sets that of a depth camera",
    ),
    some(
        "surface",
        &["keep_hull", "manifold"],
        "it is a field of Options in the library crate linecarve; remove the key",
    ),
    some(
        "pose_correction",
        &["window", "min_points", "move_px"],
        "it is a field of PoseCorrectionOptions in the library crate linecarve-points, tuned; remove the key",
    ),
    some(
        "map_points",
        &[
            "levels",
            "scale_factor",
            "corner_threshold",
            "feature_sigma_px",
            "pose_sigma_px",
            "neighbors",
            "new_descriptor_distance",
            "known_descriptor_distance",
            "ratio",
            "rotation_degrees",
            "parallax_degrees",
            "probation",
            "move_sigmas",
        ],
        "it is a field of MapPointOptions in the library crate linecarve-points, tuned; remove the key",
    ),
    some(
        "semi_dense",
        &[
            "first_neighbours",
            "relative_noise",
            "edge_point_spacing_px",
            "neighbours",
            "confirm",
        ],
        "it is a field of Options in the library crate linecarve, tuned; see lab/notes/semi-dense.md, remove the key",
    ),
    some(
        "semi_dense.match",
        &[
            "least_gradient",
            "largest_epipolar_angle_rad",
            "largest_gradient_turn_rad",
            "largest_parallax",
            "truncation_sigmas",
            "largest_residual",
            "fusion_chi2",
            "least_agreeing_share",
            "largest_rival_share",
            "largest_relative_sigma",
            "epipolar_sigma_px",
            "least_epipolar_sigma_px",
            "chain_reach_px",
            "least_confirming",
            "smooth_along_chain",
            "longest_gap_px",
            "seed_spacing_px",
            "hidden_pose_error",
            "align_neighbours",
        ],
        "it is a field of SemiDenseOptions in the library crate linecarve-lines, tuned; see lab/notes/semi-dense.md, remove the key",
    ),
    all(
        "semi_dense.sweep",
        "depth between edges is measured otherwise; semi_dense.between_edges = false leaves it out, remove the key",
    ),
];

/// What became of a key of an earlier version; `None` for a key that there never was.
pub(super) fn became(path: &str) -> Option<&'static str> {
    REMOVED
        .iter()
        .find(|removed| {
            let Some(rest) = path.strip_prefix(removed.table) else {
                return false;
            };
            match rest.strip_prefix('.') {
                None => rest.is_empty() && removed.names.is_empty(),
                Some(name) => {
                    let first = name.split('.').next().unwrap_or_default();
                    removed.names.is_empty() || removed.names.contains(&first)
                }
            }
        })
        .map(|removed| removed.became)
}
