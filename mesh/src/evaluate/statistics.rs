//! Summary statistics of distances.

use serde::Serialize;

/// Summary statistics of distances, in the unit of the ground truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DistanceStatistics {
    /// Number of distances.
    pub count: usize,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
    /// Root mean square.
    pub rms: f64,
    /// 90th percentile.
    pub p90: f64,
    /// 95th percentile.
    pub p95: f64,
    /// Maximum.
    pub max: f64,
}

impl DistanceStatistics {
    /// Summarises distances; `None` when there are none. Quantiles are interpolated.
    pub fn from_distances(distances: &[f64]) -> Option<Self> {
        if distances.is_empty() {
            return None;
        }
        let mut sorted = distances.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let count = sorted.len();
        // Summation in ascending order makes the result independent of the input order and reduces rounding.
        let mean = sorted.iter().sum::<f64>() / count as f64;
        let mean_square = sorted.iter().map(|d| d * d).sum::<f64>() / count as f64;
        Some(Self {
            count,
            mean,
            median: quantile(&sorted, 0.5),
            rms: mean_square.sqrt(),
            p90: quantile(&sorted, 0.9),
            p95: quantile(&sorted, 0.95),
            max: sorted[count - 1],
        })
    }
}

/// A quantile of ascending values, interpolated. Panics when there are none.
pub(super) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let rank = share * (sorted.len() - 1) as f64;
    let below = sorted[rank.floor() as usize];
    let above = sorted[rank.ceil() as usize];
    if below == above {
        return below;
    }
    below + (above - below) * rank.fract()
}

/// Share of distances below a threshold; 0 when there are none.
pub(super) fn share_below(distances: &[f64], threshold: f64) -> f64 {
    if distances.is_empty() {
        return 0.0;
    }
    let near = distances.iter().filter(|d| **d < threshold).count();
    near as f64 / distances.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_numbers_are_those_of_the_definition() {
        let s = DistanceStatistics::from_distances(&[3.0, 1.0, 2.0, 10.0]).unwrap();
        assert_eq!((s.count, s.mean, s.median, s.max), (4, 4.0, 2.5, 10.0));
        assert!((s.rms - (114.0_f64 / 4.0).sqrt()).abs() < 1e-15);
        assert!((s.p90 - 7.9).abs() < 1e-12);
        assert_eq!(DistanceStatistics::from_distances(&[]), None);
        assert_eq!(DistanceStatistics::from_distances(&[7.0]).unwrap().p95, 7.0);
        assert_eq!(share_below(&[0.1, 0.2, 0.3], 0.2), 1.0 / 3.0);
        assert_eq!(share_below(&[], 0.2), 0.0);
    }

    #[test]
    fn infinite_distances_stay_infinite_and_make_no_other_value_invalid() {
        let s = DistanceStatistics::from_distances(&[f64::INFINITY, f64::INFINITY]).unwrap();
        assert!(s.median.is_infinite() && s.p90.is_infinite());
        let s = DistanceStatistics::from_distances(&[1.0, 1.0, f64::INFINITY]).unwrap();
        assert_eq!(s.median, 1.0);
    }
}
