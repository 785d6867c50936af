//! What a class of confidence is worth, by how far its depth is from the surfaces of other keyframes.

use serde::Serialize;

/// Largest distance that is looked at, as a share of the depth. What lies further away is another surface.
const LARGEST: f64 = 0.1;
/// Resolution of distances.
const BINS: usize = 500;
/// Distances needed to say anything about a class.
const LEAST_COUNT: u64 = 200;
/// Standard deviation of a normal distribution over the lower quartile of its absolute value.
const SIGMA_OVER_QUARTILE: f64 = 3.138;
/// A class of which less than this share of the points lies on surfaces, in those of the best class, carries nothing: most of it is wrong.
const LEAST_SHARE: f64 = 0.5;
/// Nor does a class whose standard deviation is as large as this share of the depth: distances up to [`LARGEST`] have it that lie anywhere.
const LARGEST_SIGMA: f64 = 0.05;

/// What was measured of a class of confidence.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct ClassSummary {
    /// The class as stored, or the rank of a value from 0 to 15.
    pub class: u8,
    /// Share of the pixels with depth.
    pub share: f64,
    /// Points that were compared with the surface of another keyframe.
    pub compared: u64,
    /// Share of them that lie within a tenth of the depth of it.
    pub agreeing: f64,
    /// Standard deviation of these, as a share of the depth; that of both keyframes.
    pub deviation: f64,
    /// Standard deviation of the class beyond that of the best one, as a share of the depth; `None` if it is left out.
    #[serde(rename = "sigma")]
    pub excess: Option<f64>,
}

/// Distances by class.
#[derive(Debug, Clone)]
pub(super) struct ClassHistogram {
    classes: Vec<Distances>,
}

#[derive(Debug, Clone, Default)]
struct Distances {
    pixels: u64,
    compared: u64,
    bins: Vec<u64>,
}

impl Default for ClassHistogram {
    fn default() -> Self {
        Self {
            classes: vec![Distances::default(); 256],
        }
    }
}

impl Distances {
    fn agreeing(&self) -> u64 {
        self.bins.iter().sum()
    }

    /// Standard deviation by the lower quartile of what agrees, which other surfaces hardly change.
    fn deviation(&self) -> f64 {
        let quarter = self.agreeing() as f64 / 4.0;
        let mut below = 0.0;
        for (bin, count) in self.bins.iter().enumerate() {
            let count = *count as f64;
            if below + count >= quarter && count > 0.0 {
                let quartile = bin as f64 + (quarter - below) / count;
                return SIGMA_OVER_QUARTILE * quartile / BINS as f64 * LARGEST;
            }
            below += count;
        }
        LARGEST
    }
}

impl ClassHistogram {
    /// Counts pixels with depth.
    pub(super) fn count_pixels(&mut self, classes: impl Iterator<Item = u8>) {
        for class in classes {
            self.classes[usize::from(class)].pixels += 1;
        }
    }

    /// Adds the distance of a point from a surface, as a share of the depth; `None` if there is none along its ray.
    pub(super) fn add(&mut self, class: u8, distance: Option<f64>) {
        let Some(distance) = distance else { return };
        let class = &mut self.classes[usize::from(class)];
        class.compared += 1;
        // False for NaN.
        if distance.abs() < LARGEST {
            if class.bins.is_empty() {
                class.bins = vec![0; BINS];
            }
            class.bins[(distance.abs() / LARGEST * BINS as f64) as usize] += 1;
        }
    }

    /// Adds all that another one counted.
    pub(super) fn merge(&mut self, other: &Self) {
        for (class, other) in self.classes.iter_mut().zip(&other.classes) {
            class.pixels += other.pixels;
            class.compared += other.compared;
            if class.bins.is_empty() {
                class.bins.clone_from(&other.bins);
            } else {
                for (bin, other) in class.bins.iter_mut().zip(&other.bins) {
                    *bin += other;
                }
            }
        }
    }
}

/// The table of classes that occur, from the lowest on.
///
/// The best class is that with the smallest deviation among those of which as large a share agrees. Variances beyond its own are those of the
/// other classes: both kinds of comparison have the variance of the surface in common. A class with too few comparisons has the noise of
/// the camera, and the lowest one is left out.
pub(super) fn class_summaries(histogram: &ClassHistogram) -> Vec<ClassSummary> {
    let pixels: u64 = histogram.classes.iter().map(|class| class.pixels).sum();
    let mut table: Vec<ClassSummary> = Vec::new();
    for (class, distances) in histogram.classes.iter().enumerate() {
        if distances.pixels == 0 {
            continue;
        }
        table.push(ClassSummary {
            class: class as u8,
            share: distances.pixels as f64 / pixels as f64,
            compared: distances.compared,
            agreeing: distances.agreeing() as f64 / distances.compared.max(1) as f64,
            deviation: distances.deviation(),
            excess: Some(0.0),
        });
    }
    let is_measured = |summary: &ClassSummary| summary.compared >= LEAST_COUNT;
    let measured = || table.iter().filter(|summary| is_measured(summary));
    let best_share = measured().map(|one| one.agreeing).fold(0.0, f64::max);
    let carries = |summary: &ClassSummary| {
        summary.agreeing >= LEAST_SHARE * best_share && summary.deviation < LARGEST_SIGMA
    };
    let best = measured()
        .filter(|summary| carries(summary))
        .map(|summary| summary.deviation)
        .fold(LARGEST_SIGMA, f64::min);
    // Without any class that agrees, none is told from another.
    let has_best = measured().any(carries);
    for summary in &mut table {
        summary.excess = match is_measured(summary) {
            true if !has_best => summary.excess,
            true if carries(summary) => {
                Some((summary.deviation.powi(2) - best.powi(2)).max(0.0).sqrt())
            }
            true => None,
            false => (summary.class > 0).then_some(0.0),
        };
    }
    table
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Adds normally distributed distances, and others anywhere.
    fn fill(histogram: &mut ClassHistogram, class: u8, sigma: f64, wrong: f64) {
        let mut random = ChaCha8Rng::seed_from_u64(u64::from(class));
        for _ in 0..20_000 {
            let normal = (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
            let is_wrong = random.random::<f64>() < wrong;
            let distance = if is_wrong { 0.4 } else { sigma * normal };
            histogram.count_pixels(std::iter::once(class));
            histogram.add(class, Some(distance));
        }
    }

    #[test]
    fn classes_have_what_exceeds_the_best_one() {
        let mut histogram = ClassHistogram::default();
        fill(&mut histogram, 0, 0.02, 0.9);
        fill(&mut histogram, 1, 0.013, 0.2);
        fill(&mut histogram, 2, 0.005, 0.1);
        let table = class_summaries(&histogram);
        assert_eq!(table.len(), 3);
        assert_eq!(table[0].excess, None);
        assert!((table[1].excess.unwrap() - 0.012).abs() < 5e-4, "{table:?}");
        assert_eq!(table[2].excess, Some(0.0));
        assert!((table[2].agreeing - 0.9).abs() < 0.01);
        assert!((table[0].share - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_class_anywhere_and_one_never_compared_are_told() {
        let mut histogram = ClassHistogram::default();
        fill(&mut histogram, 2, 0.004, 0.0);
        for step in 0..1000 {
            histogram.count_pixels([0, 1, 1].into_iter());
            histogram.add(1, Some(LARGEST * f64::from(step) / 1000.0));
            histogram.add(0, None);
        }
        let table = class_summaries(&histogram);
        assert_eq!([table[0].excess, table[1].excess], [None, None]);
        assert_eq!(table[2].excess, Some(0.0));
        let one = class_summaries(&ClassHistogram::default());
        assert!(one.is_empty());
    }

    #[test]
    fn parts_add_up() {
        let (mut whole, mut a, mut b) = Default::default();
        for (part, class) in [(&mut a, 1), (&mut b, 2)] {
            fill(part, class, 0.01, 0.0);
            fill(&mut whole, class, 0.01, 0.0);
        }
        let mut sum = ClassHistogram::default();
        sum.merge(&a);
        sum.merge(&b);
        assert_eq!(class_summaries(&sum), class_summaries(&whole));
    }
}
