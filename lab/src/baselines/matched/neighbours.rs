//! The choice of views to match with each view.

use super::options::MatchedOptions;
use super::view::View;

/// The neighbours of each view, best first.
///
/// Near views of similar direction see the same lines. Distance is measured in units of the median distance to the nearest view,
/// and the angle between optical axes in units of the median angle to it, so that the unit of the poses does not matter.
///
/// *Differs from the paper*, which ranks views by the sparse points that they share.
pub(super) fn choose(views: &[View], options: &MatchedOptions) -> Vec<Vec<u32>> {
    let distance = |a: usize, b: usize| (views[a].center - views[b].center).norm();
    let angle = |a: usize, b: usize| views[a].axis.angle(&views[b].axis);
    let nearest: Vec<(f64, f64)> = (0..views.len())
        .filter_map(|a| {
            (0..views.len())
                .filter(|&b| distance(a, b) > 0.0)
                .map(|b| (distance(a, b), angle(a, b)))
                .min_by(|x, y| x.0.total_cmp(&y.0))
        })
        .collect();
    let Some(step) = median(nearest.iter().map(|n| n.0)) else {
        return vec![Vec::new(); views.len()];
    };
    // Angles below a degree do not change what is in view.
    let turn = median(nearest.iter().map(|n| n.1))
        .unwrap_or(0.0)
        .max(1.0_f64.to_radians());
    (0..views.len())
        .map(|a| {
            let mut ranked: Vec<(f64, u32)> = (0..views.len())
                .filter(|&b| {
                    let baseline = distance(a, b);
                    b != a
                        && baseline > 0.0
                        && baseline >= options.minimum_baseline_share * step
                        && angle(a, b) <= options.maximum_axis_angle_rad
                })
                .map(|b| (distance(a, b) / step + angle(a, b) / turn, b as u32))
                .collect();
            ranked.sort_by(|x, y| x.0.total_cmp(&y.0).then(x.1.cmp(&y.1)));
            ranked.truncate(options.neighbours);
            ranked.into_iter().map(|(_, b)| b).collect()
        })
        .collect()
}

/// The upper median; `None` of an empty set.
pub(super) fn median(values: impl Iterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.collect();
    let middle = values.len() / 2;
    (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
