//! Quality of a facet: its angles with the circumspheres of its two cells.

use super::cut_options::CutOptions;
use crate::vectors::{cross, dot, minus};
use crate::visibility::{UNIT, precedes};

/// What the shape of a facet costs.
#[derive(Clone, Copy, Debug)]
pub struct FacetShape {
    /// Weight of the shape in units.
    quality: i64,
}

impl FacetShape {
    /// Costs of a cut with these options.
    pub fn new(options: &CutOptions) -> Self {
        Self {
            quality: options.quality_units(),
        }
    }

    /// The cost of a facet, from its cosines on both sides.
    pub fn cost(self, cosines: [i16; 2]) -> i64 {
        let cosine = cosines[0].min(cosines[1]);
        let shape = self.quality * (UNIT as i64 - i64::from(cosine));
        shape / UNIT as i64
    }
}

/// For the facet opposite each corner the cosine of its angle with the circumsphere, in units of 1/`UNIT`: 1 when the
/// sphere's centre is far inside, -1 when it is far on the other side of the facet. 0 where the result is NaN.
///
/// The result depends on positions alone, not on the order of the corners.
pub fn cosines(corners: [&[f64; 3]; 4]) -> [i16; 4] {
    // For each corner the number of corners before it in lexicographic order.
    let mut rank = [0; 4];
    for j in 1..4 {
        for i in 0..j {
            let is_before = usize::from(precedes(corners[i], corners[j]));
            rank[j] += is_before;
            rank[i] += 1 - is_before;
        }
    }
    let mut p = corners;
    for (corner, rank) in corners.into_iter().zip(rank) {
        p[rank] = corner;
    }
    // The circumcentre relative to the first corner.
    let edges = [1, 2, 3].map(|k| minus(p[k], p[0]));
    let normals = [
        cross(&edges[1], &edges[2]),
        cross(&edges[2], &edges[0]),
        cross(&edges[0], &edges[1]),
    ];
    let twice_determinant = 2.0 * dot(&edges[0], &normals[0]);
    let squares = edges.map(|e| dot(&e, &e));
    let center: [f64; 3] = std::array::from_fn(|k| {
        (0..3).map(|i| squares[i] * normals[i][k]).sum::<f64>() / twice_determinant
    });
    let radius = dot(&center, &center).sqrt();
    let ordered: [i16; 4] = std::array::from_fn(|opposite| {
        let [a, b, c] = match opposite {
            0 => [1, 2, 3],
            1 => [0, 2, 3],
            2 => [0, 1, 3],
            _ => [0, 1, 2],
        };
        let normal = cross(&minus(p[b], p[a]), &minus(p[c], p[a]));
        let inwards = dot(&normal, &minus(p[opposite], p[a])).signum();
        let from_corner = minus(&center, &minus(p[a], p[0]));
        let cosine = inwards * dot(&normal, &from_corner) / (dot(&normal, &normal).sqrt() * radius);
        // A cast takes NaN to 0.
        (cosine.clamp(-1.0, 1.0) * UNIT as f64).round() as i16
    });
    rank.map(|rank| ordered[rank])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_regular_cell_has_a_third_and_the_order_of_corners_does_not_matter() {
        let p = [
            [1.0, 1.0, 1.0],
            [1.0, -1.0, -1.0],
            [-1.0, 1.0, -1.0],
            [-1.0, -1.0, 1.0],
        ];
        // The centre is at a third of the circumradius from each facet: 256 / 3.
        assert_eq!(cosines([&p[0], &p[1], &p[2], &p[3]]), [85; 4]);
        let q = [
            [0.3, 0.1, 0.2],
            [2.0, 0.4, 0.1],
            [0.2, 3.0, 0.3],
            [0.5, 0.4, 0.9],
        ];
        let all = cosines([&q[0], &q[1], &q[2], &q[3]]);
        assert_eq!(
            cosines([&q[3], &q[1], &q[0], &q[2]]),
            [all[3], all[1], all[0], all[2]]
        );
    }

    #[test]
    fn a_flat_cell_is_bad_on_the_side_away_from_its_centre() {
        // Three corners of a wide triangle and a low apex over its middle: the centre is far below.
        let p = [
            [0.0, 0.0, 0.0],
            [2.0, 0.0, 0.0],
            [0.0, 2.0, 0.0],
            [0.6, 0.6, 0.05],
        ];
        let cosines = cosines([&p[0], &p[1], &p[2], &p[3]]);
        assert!(cosines[3] < -240, "{cosines:?}");
        assert!(cosines[..3].iter().all(|&c| c > 200), "{cosines:?}");
    }
}
