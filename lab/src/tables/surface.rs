//! Distances of lines to the ground-truth surface.

use crate::baselines::FoundSegment;
use nalgebra::Point3;
use rayon::prelude::*;
use serde::Serialize;

use super::truth::Truth;

/// Distances to the ground truth, in its units.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct SurfaceMeasure {
    /// Distances of end points: the measure of the paper's Table I.
    pub ends: Distances,
    /// Distances of evenly spaced samples along whole segments: long segments count more.
    pub along: Distances,
    /// Distances of the depths measured at the pixels of the end points: what end points have whose depth is as it was measured.
    pub depths: Distances,
}

/// Mean and quantiles of a set of distances; zero of an empty one.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Distances {
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// 90th percentile.
    pub p90: f64,
    /// Number of distances.
    pub count: usize,
}

impl Distances {
    /// Summarises distances.
    pub fn new(mut distances: Vec<f64>) -> Self {
        if distances.is_empty() {
            return Self::default();
        }
        // Summed in the given order, which is the same in every run.
        let mean = distances.iter().sum::<f64>() / distances.len() as f64;
        distances.sort_unstable_by(f64::total_cmp);
        let quantile = |share: f64| distances[((distances.len() - 1) as f64 * share) as usize];
        Self {
            mean,
            median: quantile(0.5),
            p90: quantile(0.9),
            count: distances.len(),
        }
    }
}

/// Distances of segments to the ground truth. Samples along a segment are at most `step` apart, in units of the poses; each segment
/// has at least one.
pub fn measure(truth: &Truth, segments: &[FoundSegment], step: f64) -> SurfaceMeasure {
    let distance = |point: &Point3<f64>| truth.distance(point);
    let found: Vec<(Vec<f64>, Vec<f64>)> = segments
        .par_iter()
        .map(|segment| {
            let [a, b] = segment.ends_in_world;
            let ends = [a, b].iter().filter_map(distance).collect();
            let samples = ((b - a).norm() / step).ceil().clamp(1.0, 1e4) as usize;
            let along = (0..samples)
                .filter_map(|sample| {
                    let share = (sample as f64 + 0.5) / samples as f64;
                    distance(&(a + (b - a) * share))
                })
                .collect();
            (ends, along)
        })
        .collect();
    let (ends, along): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    SurfaceMeasure {
        ends: Distances::new(ends.into_iter().flatten().collect()),
        along: Distances::new(along.into_iter().flatten().collect()),
        depths: Distances::default(),
    }
}

/// Distances of points to the ground truth.
pub fn distances(truth: &Truth, points: &[Point3<f64>]) -> Distances {
    let points = points.par_iter();
    Distances::new(points.filter_map(|point| truth.distance(point)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_mesh::Shape;
    use nalgebra::Similarity3;

    #[test]
    fn a_slanted_segment_over_a_floor() {
        let floor = Shape {
            positions: vec![
                Point3::new(-9.0, -9.0, 0.0),
                Point3::new(9.0, -9.0, 0.0),
                Point3::new(0.0, 9.0, 0.0),
            ],
            triangles: vec![[0, 1, 2]],
            ..Shape::default()
        };
        let segment = FoundSegment {
            ends_in_world: [Point3::new(0.0, 0.0, 0.0), Point3::new(1.0, 0.0, 0.2)],
            keyframe: None,
        };
        let measure = measure(
            &Truth::new(floor, &Similarity3::identity()),
            &[segment],
            0.01,
        );
        assert!((measure.ends.mean - 0.1).abs() < 1e-12);
        assert_eq!(measure.ends.count, 2);
        assert!((measure.along.mean - 0.1).abs() < 1e-3);
        assert!((measure.along.p90 - 0.18).abs() < 0.005);
        assert!(measure.along.count >= 100);
    }

    #[test]
    fn nothing_has_no_distance() {
        assert_eq!(Distances::new(Vec::new()), Distances::default());
    }
}
