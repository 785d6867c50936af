//! Why a run ends without a surface.

use crate::report::KeyframeReport;
use linecarve_engine::map::Map;
use linecarve_engine::{Reconstruction, Source};

/// The step at which everything was lost, for a run that ends with nothing. `keyframes` is what the report says of each.
pub(crate) fn reason_for_nothing(run: &Reconstruction, keyframes: &[KeyframeReport]) -> String {
    match &run.recording().source {
        Source::Sensor { .. } | Source::SemiDense(_) => without_lines(run, keyframes),
        Source::MapPoints { .. } => without_points(run),
        Source::Model(_) => without_model(run),
    }
}

fn without_lines(run: &Reconstruction, reports: &[KeyframeReport]) -> String {
    let sum = |count: fn(&KeyframeReport) -> usize| -> usize { reports.iter().map(count).sum() };
    let keyframes = reports.len();
    if keyframes == 0 {
        let chosen = run.recording().keyframes.len();
        return format!("none of the {chosen} keyframes could be read");
    }
    let pixels = sum(|keyframe| keyframe.edge_pixels);
    if pixels == 0 {
        return format!(
            "the images of {keyframes} keyframe(s) have no edges: black, blurred or overexposed?"
        );
    }
    let with_depth: f64 = reports
        .iter()
        .map(|keyframe| keyframe.edge_depth_share * keyframe.edge_pixels as f64)
        .sum();
    if with_depth < 1.0 {
        let remedy = if run.recording().source.sensor().is_some() {
            "do depth and colour belong together?"
        } else {
            "too few keyframes, no parallax between them, or wrong poses?"
        };
        return format!(
            "none of {pixels} edge pixels in {keyframes} keyframe(s) has a depth: {remedy}"
        );
    }
    let segments = sum(|keyframe| keyframe.segments);
    if segments == 0 {
        return format!(
            "no straight segment on {pixels} edge pixels in {keyframes} keyframe(s): is the depth scale right?"
        );
    }
    if run.map().carver().triangle_count() > 0 {
        return format!(
            "no keyframe of {keyframes} measured depth along the surface that was carved: depth may cover too little of the images; \
             `least_measured_share = 0` in the table [surface] exports the surface all the same"
        );
    }
    format!(
        "{segments} segments of {keyframes} keyframe(s) enclose no occupied space that another ray has left; more \
         keyframes from other places would help"
    )
}

fn without_points(run: &Reconstruction) -> String {
    let keyframes = run.numbers().len();
    let Some(map) = run.map().feature_points() else {
        return String::new();
    };
    let features: usize = map
        .keyframes()
        .iter()
        .map(|keyframe| keyframe.features.len())
        .sum();
    let points = run.map().carver().point_count();
    let needed = map.options().min_views;
    if features == 0 {
        format!(
            "the images of {keyframes} keyframe(s) have no corners: black, blurred or overexposed?"
        )
    } else if keyframes < needed {
        format!("{keyframes} keyframe(s) are too few: a point must be seen by {needed}")
    } else if points == 0 {
        format!(
            "no point could be triangulated from {features} features of {keyframes} keyframe(s): the camera only turns, the \
             poses are wrong (linecarve info tests them), or nothing is seen by {needed} keyframes"
        )
    } else {
        format!(
            "{points} points of {keyframes} keyframe(s) enclose no occupied space that a ray has left; more keyframes from \
             other places would help"
        )
    }
}

fn without_model(run: &Reconstruction) -> String {
    let Some((model, counts)) = run.map().model() else {
        return String::new();
    };
    if model.points.is_empty() {
        return "the model has no points".to_owned();
    }
    if counts.carved == 0 {
        let seen: usize = model.points.iter().map(|p| p.observations.len()).sum();
        if seen == 0 {
            return "the model does not say who sees its points".to_owned();
        }
        return model_left_out(run.map()).unwrap_or_default();
    }
    format!(
        "{} points enclose no occupied space that a ray has left; more views from other places would help",
        counts.carved
    )
}

/// Says which points of a model are not carved, `None` when all are, or when there is no model.
pub(crate) fn model_left_out(map: &Map) -> Option<String> {
    map.model()?.1.left_out()
}
