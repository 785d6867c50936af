//! One gain per view and channel, so that views agree on the colours of what they see together.

use super::observe::{BRIGHTEST_USABLE, Observation};

/// Colours outside this range are left out: dark ones are mostly noise, bright ones may be clipped.
const USABLE: std::ops::Range<f32> = 16.0..BRIGHTEST_USABLE;
/// Residual of the logarithm, from which on an observation has no weight.
const TUKEY: f64 = 0.25;
/// Iterations of the weights, and of the solver in each of them.
const ROUNDS: usize = 4;
const SOLVER_STEPS: usize = 60;
/// Weight of the gain 1, as a share of the mean weight of a view.
const PRIOR_SHARE: f64 = 1e-3;

/// Share of the views that may be darker than the texture.
const DARKER_SHARE: f64 = 0.1;

/// Divides the gains of the views that were read by that of the darkest ones, so that the texture has room for what these show of
/// surfaces too bright for others. Returns the factor.
pub(super) fn darken(gains: &mut [[f32; 3]], is_read: impl Fn(usize) -> bool) -> f32 {
    let read = (0..).zip(gains.iter_mut());
    let mut read: Vec<&mut [f32; 3]> = read
        .filter_map(|(view, gain)| is_read(view).then_some(gain))
        .collect();
    let mut means: Vec<f32> = read
        .iter()
        .map(|gain| gain.iter().sum::<f32>() / 3.0)
        .collect();
    means.sort_by(f32::total_cmp);
    let brighter = (means.len().max(1) - 1) as f64 * (1.0 - DARKER_SHARE);
    let factor = means
        .get(brighter.round() as usize)
        .map_or(1.0, |gain| 1.0 / gain);
    for value in read.iter_mut().flat_map(|gain| gain.iter_mut()) {
        *value *= factor;
    }
    factor
}

/// The gains that multiply the sRGB values of each view.
///
/// The logarithms of gains and of the triangles' colours are found together: the colours are eliminated, and the gains
/// solved by conjugate gradients. Residuals are weighted as Tukey's biweight says, from the second round on.
pub(super) fn gains(of_triangle: &[Vec<Observation>], views: usize) -> Vec<[f32; 3]> {
    let mut gains = vec![[1.0_f32; 3]; views];
    for channel in 0..3 {
        let system = System::new(of_triangle, channel, views);
        for (gain, value) in gains.iter_mut().zip(system.solve()) {
            gain[channel] = value.exp() as f32;
        }
    }
    gains
}

/// Logarithms of the colours in one channel.
struct System {
    /// View, logarithm and weight of each observation, triangle by triangle.
    rows: Vec<(u32, f64, f64)>,
    /// End of each triangle in `rows`.
    ends: Vec<usize>,
    views: usize,
}

impl System {
    fn new(of_triangle: &[Vec<Observation>], channel: usize, views: usize) -> Self {
        let (mut rows, mut ends) = (Vec::new(), Vec::new());
        for observations in of_triangle {
            let start = rows.len();
            let usable = observations
                .iter()
                .filter(|o| o.is_comparable() && USABLE.contains(&o.color[channel]));
            rows.extend(
                usable.map(|o| (o.view, f64::from(o.color[channel]).ln(), f64::from(o.share))),
            );
            if rows.len() - start < 2 {
                rows.truncate(start);
            } else {
                ends.push(rows.len());
            }
        }
        Self { rows, ends, views }
    }

    fn triangles(&self) -> impl Iterator<Item = std::ops::Range<usize>> {
        let starts = std::iter::once(0).chain(self.ends.iter().copied());
        starts.zip(&self.ends).map(|(start, end)| start..*end)
    }

    fn solve(&self) -> Vec<f64> {
        let mut gains = vec![0.0; self.views];
        let mut weights: Vec<f64> = self.rows.iter().map(|row| row.2).collect();
        for round in 0..ROUNDS {
            if round > 0 {
                self.reweight(&gains, &mut weights);
            }
            self.solve_weighted(&weights, &mut gains);
        }
        gains
    }

    /// Weighted mean over the observations of a triangle.
    fn mean(
        &self,
        range: std::ops::Range<usize>,
        weights: &[f64],
        value: impl Fn(usize) -> f64,
    ) -> f64 {
        let (mut sum, mut total) = (0.0, 0.0);
        for at in range {
            sum += weights[at] * value(at);
            total += weights[at];
        }
        if total > 0.0 { sum / total } else { 0.0 }
    }

    fn reweight(&self, gains: &[f64], weights: &mut [f64]) {
        for range in self.triangles() {
            let leveled = |at: usize| self.rows[at].1 + gains[self.rows[at].0 as usize];
            // The median is not drawn to a wrong view.
            let mut values: Vec<f64> = range.clone().map(leveled).collect();
            values.sort_by(f64::total_cmp);
            let median = values[values.len() / 2];
            for at in range {
                let scaled = (leveled(at) - median) / TUKEY;
                weights[at] = self.rows[at].2 * (1.0 - scaled * scaled).max(0.0).powi(2);
            }
        }
    }

    /// Conjugate gradients on the normal equations without the triangles' colours.
    fn solve_weighted(&self, weights: &[f64], gains: &mut [f64]) {
        let prior = PRIOR_SHARE * weights.iter().sum::<f64>() / self.views.max(1) as f64;
        let product = |x: &[f64]| {
            let mut y: Vec<f64> = x.iter().map(|value| prior * value).collect();
            for range in self.triangles() {
                let mean = self.mean(range.clone(), weights, |at| x[self.rows[at].0 as usize]);
                for at in range {
                    let view = self.rows[at].0 as usize;
                    y[view] += weights[at] * (x[view] - mean);
                }
            }
            y
        };
        let mut right = vec![0.0; self.views];
        for range in self.triangles() {
            let mean = self.mean(range.clone(), weights, |at| self.rows[at].1);
            for at in range {
                right[self.rows[at].0 as usize] -= weights[at] * (self.rows[at].1 - mean);
            }
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let applied = product(gains);
        let mut residual: Vec<f64> = right.iter().zip(&applied).map(|(b, ax)| b - ax).collect();
        let mut direction = residual.clone();
        let mut squared = dot(&residual, &residual);
        let target = 1e-12 * dot(&right, &right);
        for _ in 0..SOLVER_STEPS {
            if squared <= target {
                break;
            }
            let applied = product(&direction);
            let step = squared / dot(&direction, &applied);
            for view in 0..self.views {
                gains[view] += step * direction[view];
                residual[view] -= step * applied[view];
            }
            let next = dot(&residual, &residual);
            for (along, left) in direction.iter_mut().zip(&residual) {
                *along = left + next / squared * *along;
            }
            squared = next;
        }
    }
}
