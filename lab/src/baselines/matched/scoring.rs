//! Scores of matches: agreement with the matches of other views.

use nalgebra::Vector3;

use super::matching::{Match, ViewMatches};
use super::options::MatchedOptions;
use super::view::View;

/// Scores the matches of a view and drops those that no other view supports. Returns the distances of the ends of each
/// segment by its best match; a segment without a good one loses all its matches.
///
/// # Reference
/// Hofer, Maurer, Bischof 2017: each other view adds the largest similarity of its matches, which is the lesser of that in
/// angle and that in depth.
pub(super) fn score(
    views: &[View],
    index: usize,
    all: &mut ViewMatches,
    options: &MatchedOptions,
) -> Vec<Option<[f64; 2]>> {
    let view = &views[index];
    let mut best = vec![None; view.segments.len()];
    let mut kept = Vec::new();
    let mut offsets = vec![0];
    let mut directions: Vec<Vector3<f64>> = Vec::new();
    for (segment, best) in best.iter_mut().enumerate() {
        let matches = all.of(segment);
        directions.clear();
        directions.extend(matches.iter().map(|found| {
            let [a, b] = view.ends_at(segment as u32, found.distances);
            (b - a).normalize()
        }));
        let from = kept.len();
        for (own, found) in matches.iter().enumerate() {
            let score = support(views, view, segment, matches, &directions, own, options);
            if score > 0.0 {
                kept.push(Match { score, ..*found });
            }
        }
        // Of equal scores the first: matches are in a fixed order.
        let top = kept[from..].iter().fold(None, |top: Option<&Match>, next| {
            if top.is_none_or(|top| next.score > top.score) {
                Some(next)
            } else {
                top
            }
        });
        match top {
            Some(top) if top.score > options.minimum_score => *best = Some(top.distances),
            _ => kept.truncate(from),
        }
        offsets.push(kept.len() as u32);
    }
    all.matches = kept;
    all.offsets = offsets;
    best
}

/// The score of one match.
fn support(
    views: &[View],
    view: &View,
    segment: usize,
    matches: &[Match],
    directions: &[Vector3<f64>],
    own: usize,
    options: &MatchedOptions,
) -> f64 {
    let found = &matches[own];
    let other = &views[found.view as usize];
    let ends = view.ends_at(segment as u32, found.distances);
    // Twice the variance along the rays: the mean of what both views allow.
    let spread = [0, 1].map(|end| {
        (view.sigma * found.distances[end]).powi(2) + other.sigma_at(&ends[end]).powi(2)
    });
    let angle_spread = 2.0 * options.angle_sigma_rad.powi(2);
    let mut sum = 0.0;
    let mut current = None;
    let mut largest = 0.0_f64;
    for (third, direction) in matches.iter().zip(directions) {
        if third.view == found.view {
            continue;
        }
        if current != Some(third.view) {
            sum += largest;
            largest = 0.0;
            current = Some(third.view);
        }
        let exponent = (0..2)
            .map(|end| (found.distances[end] - third.distances[end]).powi(2) / spread[end])
            .fold(0.0, f64::max);
        // exp(-1) is below any sensible least similarity; it spares most of the angles.
        if exponent > 1.0 && options.minimum_similarity > 0.37 {
            continue;
        }
        let cosine = direction.dot(&directions[own]).abs().min(1.0);
        let angle = cosine.acos();
        let similarity = (-exponent.max(angle * angle / angle_spread)).exp();
        if similarity > options.minimum_similarity {
            largest = largest.max(similarity);
        }
    }
    sum + largest
}
