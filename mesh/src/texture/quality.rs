//! How well a view suits as texture of a triangle.

use super::observe::Observation;

/// Difference from the median of all views, in sRGB steps, at which a view has half the quality.
const DISAGREEMENT: f32 = 20.0;
/// Triangles with less gradient, per pixel, say nothing about sharpness.
const MIN_GRADIENT: f32 = 3.0;
/// Bounds of the sharpness of a view relative to the others.
const SHARPNESS: std::ops::RangeInclusive<f32> = 0.25..=2.0;

/// Sets the quality of all observations: pixels per area, times the cosine of the viewing angle, times the visible share,
/// times the squared sharpness of the view, times its agreement with the other views of the triangle.
pub(super) fn rate(of_triangle: &mut [Vec<Observation>], gains: &[[f32; 3]]) {
    let sharpness = sharpness(of_triangle, gains);
    let mut values = Vec::new();
    let says_color = |o: &&Observation| o.is_comparable() && !o.is_clipped();
    for observations in of_triangle {
        let median: [f32; 3] = std::array::from_fn(|channel| {
            values.clear();
            let whole = observations.iter().filter(says_color);
            values.extend(whole.map(|o| leveled(o, gains)[channel]));
            values.sort_by(f32::total_cmp);
            values.get(values.len() / 2).copied().unwrap_or(0.0)
        });
        let count = observations.iter().filter(says_color).count();
        for observation in observations {
            let color = leveled(observation, gains);
            let difference =
                (0..3).fold(0.0, |most: f32, i| most.max((color[i] - median[i]).abs()));
            // Of two views none is the wrong one.
            let agreement = if count > 2 && says_color(&&*observation) {
                1.0 / (1.0 + (difference / DISAGREEMENT).powi(4))
            } else {
                1.0
            };
            let sharp = sharpness[observation.view as usize];
            observation.quality = observation.density
                * observation.cosine
                * observation.share
                * sharp
                * sharp
                * agreement;
        }
    }
}

/// Colour of an observation with the gain of its view.
pub(super) fn leveled(observation: &Observation, gains: &[[f32; 3]]) -> [f32; 3] {
    let gain = gains[observation.view as usize];
    std::array::from_fn(|channel| gain[channel] * observation.color[channel])
}

/// Gradient of each view relative to the mean of all views of the same triangles.
fn sharpness(of_triangle: &[Vec<Observation>], gains: &[[f32; 3]]) -> Vec<f32> {
    let mut own = vec![0.0_f64; gains.len()];
    let mut all = vec![0.0_f64; gains.len()];
    let gradient = |o: &Observation| gains[o.view as usize][1] * o.gradient;
    for observations in of_triangle {
        let whole = || observations.iter().filter(|o| o.is_comparable());
        let mean = whole().map(gradient).sum::<f32>() / whole().count().max(1) as f32;
        if mean < MIN_GRADIENT {
            continue;
        }
        for observation in whole() {
            own[observation.view as usize] += f64::from(gradient(observation));
            all[observation.view as usize] += f64::from(mean);
        }
    }
    let ratios = own.iter().zip(&all);
    ratios
        .map(|(own, all)| match *all > 0.0 {
            true => ((own / all) as f32).clamp(*SHARPNESS.start(), *SHARPNESS.end()),
            false => 1.0,
        })
        .collect()
}
