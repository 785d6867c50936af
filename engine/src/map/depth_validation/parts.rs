//! Which part of a triangle is measured.
//!
//! Where a surface ends, triangles connect it with what lies behind. A surface was measured along a part of them: beside an edge of the
//! triangle, or beside two. The part is bounded by one of the samples, of all of them the one with the most measured samples in its part.

use std::sync::LazyLock;

use linecarve_carving::TrianglePart;

use super::{FacetEvidence, SAMPLE_COUNT, SUBDIVISIONS};

/// Barycentric weights of the samples, in the order of [`Samples`](super::samples::Samples).
fn weights() -> [[u8; 3]; SAMPLE_COUNT as usize] {
    let mut weights = [[0; 3]; SAMPLE_COUNT as usize];
    let pairs = (0..SUBDIVISIONS).flat_map(|i| (0..SUBDIVISIONS - i).map(move |j| (i, j)));
    for (weights, (i, j)) in weights.iter_mut().zip(pairs) {
        let [a, b] = [i, j].map(|k| 3 * k as u8 + 1);
        *weights = [a, b, 3 * SUBDIVISIONS as u8 - a - b];
    }
    weights
}

/// A sample and, for each edge, which begins at the corner of the same index, the samples in the triangle between the edge and it, as
/// a bit set.
type Fan = ([u8; 3], [u32; 3]);

static FANS: LazyLock<Vec<Fan>> = LazyLock::new(|| {
    let weights = weights();
    let fan = |middle: &[u8; 3]| {
        let mut at_edges = [0; 3];
        for (sample, other) in weights.iter().enumerate() {
            // The corner whose weight fell most, and the edge opposite to it.
            let ratio = |a: &usize, b: &usize| {
                let product = |a: usize, b: usize| u32::from(other[a]) * u32::from(middle[b]);
                product(*a, *b).cmp(&product(*b, *a))
            };
            let corner = (0..3).min_by(ratio).unwrap_or(0);
            at_edges[(corner + 1) % 3] |= 1 << sample;
        }
        (*middle, at_edges)
    };
    weights.iter().map(fan).collect()
});

/// The part with the most measured samples, less those in it that are not measured or contradicted, and that number. Corners are those of the
/// samples. `None` where no part has more measured samples than others.
pub(super) fn best_part(evidence: &FacetEvidence) -> Option<(TrianglePart, i32)> {
    if evidence.agreed == 0 {
        return None;
    }
    let looked_through = evidence.contradicted & !evidence.agreed;
    let balance = |samples: u32| {
        let count = |bits: u32| (bits & samples).count_ones() as i32;
        count(evidence.agreed) - count(!evidence.agreed) - count(looked_through)
    };
    let mut best: Option<(TrianglePart, i32)> = None;
    for (weights, at_edges) in FANS.iter() {
        let balances = at_edges.map(balance);
        let edges = balances.map(|balance| balance > 0);
        let gain = balances.iter().filter(|balance| **balance > 0).sum();
        if edges != [true; 3] && gain > best.map_or(0, |(_, best)| best) {
            let weights = *weights;
            best = Some((TrianglePart { weights, edges }, gain));
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::super::samples::Samples;
    use super::*;

    fn evidence(is_measured: impl Fn(&Point3<f64>) -> bool) -> FacetEvidence {
        let points = Samples::of(corners()).points().to_vec();
        let measured = points
            .iter()
            .zip(0..)
            .filter(|(point, _)| is_measured(point));
        FacetEvidence {
            agreed: measured.map(|(_, bit)| 1 << bit).sum(),
            is_observed: true,
            ..FacetEvidence::default()
        }
    }

    fn corners() -> [Point3<f64>; 3] {
        [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]].map(|[x, y]| Point3::new(x, y, 0.0))
    }

    #[test]
    fn samples_have_their_weights() {
        let corners = corners();
        for (point, weights) in Samples::of(corners).points().iter().zip(weights()) {
            let weighted = |k: usize| corners[k].coords * f64::from(weights[k]) / 18.0;
            let expected = weighted(0) + weighted(1) + weighted(2);
            assert!((point.coords - expected).norm() < 1e-12);
        }
        assert!(
            FANS.iter()
                .all(|(_, [a, b, c])| a ^ b ^ c == (1 << SAMPLE_COUNT) - 1)
        );
    }

    #[test]
    fn a_strip_beside_an_edge_is_a_part() {
        // Corners at (0, 0), (1, 0), (0, 1): the first edge lies along x. Sorted by position the second corner is (0, 1).
        let samples = Samples::of(corners());
        let part = samples
            .measured_part(&evidence(|point| point.y < 0.3), 0.0)
            .unwrap();
        assert_eq!(part.edges, [true, false, false]);
        let inside = part.point(&corners());
        assert!(
            (0.1..0.6).contains(&inside.y) && (0.1..0.8).contains(&inside.x),
            "{inside}"
        );
        // The same with other corners first.
        for first in 1..3 {
            let mut rotated = corners();
            rotated.rotate_left(first);
            let same = Samples::of(rotated);
            let found = same.measured_part(&evidence(|point| point.y < 0.3), 0.0);
            assert_eq!(found, Some(part.rotated(first)));
        }
        // Its area, and what is less than that.
        assert!(
            samples
                .measured_part(&evidence(|point| point.y < 0.3), 0.1)
                .is_some()
        );
        assert_eq!(
            samples.measured_part(&evidence(|point| point.y < 0.3), 0.3),
            None
        );
    }

    #[test]
    fn strips_beside_two_edges_are_one_part() {
        let samples = Samples::of(corners());
        let part = samples.measured_part(&evidence(|point| point.y < 0.2 || point.x < 0.2), 0.0);
        assert_eq!(part.map(|part| part.edges), Some([true, false, true]));
    }

    #[test]
    fn without_measured_samples_there_is_no_part() {
        assert_eq!(best_part(&evidence(|_| false)), None);
        // One sample far from all edges is surrounded by what is not measured.
        let alone = evidence(|point| (point - Point3::new(0.39, 0.39, 0.0)).norm() < 0.06);
        assert_eq!(alone.agreed.count_ones(), 1);
        assert_eq!(best_part(&alone), None);
    }

    #[test]
    fn contradicted_samples_count_against_a_part() {
        // A strip with a gap.
        let measured = evidence(|point| point.y < 0.3 && !(0.3..0.5).contains(&point.x));
        let contradicted = FacetEvidence {
            contradicted: !measured.agreed & ((1 << SAMPLE_COUNT) - 1),
            ..measured
        };
        let gain = |evidence: &FacetEvidence| best_part(evidence).map_or(0, |(_, gain)| gain);
        assert!(gain(&measured) > 0 && gain(&contradicted) < gain(&measured));
    }
}
