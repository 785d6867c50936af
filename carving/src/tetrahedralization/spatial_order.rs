//! An order of insertion in which neighbours in sequence are neighbours in space.
//!
//! Points are dealt into rounds, each about eight times as large as the one before (a biased randomised insertion
//! order, which keeps the expected work optimal whatever the input), and run through along a Hilbert curve within
//! each round. The order has no influence on the resulting cells.
//!
//! # Reference
//!
//! N. Amenta, S. Choi, G. Rote, "Incremental constructions con BRIO", SoCG 2003. C. Hamilton, "Compact Hilbert
//! indices", Dalhousie University CS-2006-07, 2006, section 2 (the states of the curve).

use nalgebra::Point3;

/// Most levels of the curve: cells of the finest level have 1/65536 of the largest extent. Fewer where round, rank
/// along the curve and index do not fit in 64 bits together; 100 million points still get 11.
const MOST_LEVELS: u32 = 16;
/// Each round is about 2 to this power times as large as the one before.
const ROUND_BITS: u32 = 3;
/// Rounds are not split below about this many points.
const SMALLEST_ROUND: usize = 64;

/// For each state (entry corner and direction) and octant: eight times the next state, plus the rank of the octant.
type Table = [[u8; 8]; 24];

const fn rotate_left(bits: u32, by: u32) -> u32 {
    ((bits << by) | (bits >> (3 - by))) & 7
}

const fn rotate_right(bits: u32, by: u32) -> u32 {
    ((bits >> by) | (bits << (3 - by))) & 7
}

/// Number of trailing ones, modulo 3: the axis along which the curve leaves an octant.
const fn axis_after(rank: u32) -> u32 {
    (!rank).trailing_zeros() % 3
}

/// Hamilton's entry point `e(w)` and direction `d(w)` of the sub-curve of rank `w`, in three dimensions.
const fn hilbert_table() -> Table {
    let mut table = [[0; 8]; 24];
    let mut entry = 0;
    while entry < 8 {
        let mut direction = 0;
        while direction < 3 {
            let mut octant = 0;
            while octant < 8 {
                let gray = rotate_right(octant ^ entry, (direction + 1) % 3);
                let rank = gray ^ (gray >> 1) ^ (gray >> 2);
                let (sub_entry, sub_direction) = if rank == 0 {
                    (0, 0)
                } else {
                    let even = 2 * ((rank - 1) / 2);
                    let axis = if rank.is_multiple_of(2) {
                        axis_after(rank - 1)
                    } else {
                        axis_after(rank)
                    };
                    (even ^ (even >> 1), axis)
                };
                let next_entry = entry ^ rotate_left(sub_entry, (direction + 1) % 3);
                let next_direction = (direction + sub_direction + 1) % 3;
                table[(3 * entry + direction) as usize][octant as usize] =
                    ((3 * next_entry + next_direction) * 8 + rank) as u8;
                octant += 1;
            }
            direction += 1;
        }
        entry += 1;
    }
    table
}

const HILBERT: Table = hilbert_table();

/// Rank along the Hilbert curve of the grid cell `(x, y, z)`, each below 2^`levels`.
pub(crate) fn hilbert_rank([x, y, z]: [u32; 3], levels: u32) -> u64 {
    let mut state = 0;
    let mut rank = 0;
    for level in (0..levels).rev() {
        let octant = (x >> level & 1) | (y >> level & 1) << 1 | (z >> level & 1) << 2;
        let entry = HILBERT[state][octant as usize];
        state = usize::from(entry >> 3);
        rank = rank << 3 | u64::from(entry & 7);
    }
    rank
}

/// A fixed scramble of the index (the finaliser of Vigna's SplitMix64): deals points into rounds.
fn scramble(index: u64) -> u64 {
    let mut x = (index + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

/// Indices of `points` in an order good for insertion. Points must be finite.
///
/// # Complexity
///
/// `n log n` for the sort; eight bytes a point.
pub(crate) fn spatial_order(points: &[Point3<f64>]) -> Vec<u64> {
    let rounds = (points.len() / SMALLEST_ROUND).max(1).ilog2() / ROUND_BITS;
    in_rounds(points, rounds)
}

/// Indices of `points` along one Hilbert curve, an order good for location. Points must be finite.
pub(crate) fn curve_order(points: &[Point3<f64>]) -> Vec<u64> {
    in_rounds(points, 0)
}

/// Indices of `points` in order of their rounds, the last of which is `rounds`.
fn in_rounds(points: &[Point3<f64>], rounds: u32) -> Vec<u64> {
    let mut low = [f64::INFINITY; 3];
    let mut high = [f64::NEG_INFINITY; 3];
    for point in points {
        for axis in 0..3 {
            low[axis] = low[axis].min(point[axis]);
            high[axis] = high[axis].max(point[axis]);
        }
    }
    let index_bits = points.len().next_power_of_two().ilog2();
    let round_bits = u32::BITS - rounds.leading_zeros();
    let levels = ((u64::BITS - index_bits - round_bits) / 3).min(MOST_LEVELS);
    let extent = (0..3)
        .map(|axis| high[axis] - low[axis])
        .fold(0.0, f64::max);
    // Without extent all points fall into one grid cell; the cast below saturates.
    let cells = f64::from((1u32 << levels) - 1);
    let scale = if extent > 0.0 { cells / extent } else { 0.0 };
    let mut keys: Vec<u64> = (0u64..)
        .zip(points)
        .map(|(index, point)| {
            let grid = std::array::from_fn(|axis| ((point[axis] - low[axis]) * scale) as u32);
            let skipped = (scramble(index).trailing_zeros() / ROUND_BITS).min(rounds);
            let round = u64::from(rounds - skipped);
            (round << (3 * levels) | hilbert_rank(grid, levels)) << index_bits | index
        })
        .collect();
    keys.sort_unstable();
    for key in &mut keys {
        *key &= (1 << index_bits) - 1;
    }
    keys
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_visits_every_cell_once_and_steps_to_face_neighbours() {
        // The first three levels of the curve, seen in the finest cells of one corner.
        let side = 8u32;
        let mut cells: Vec<(u64, [u32; 3])> = (0..side.pow(3))
            .map(|i| [i % side, i / side % side, i / side / side])
            .map(|c| (hilbert_rank(c, 16), c))
            .collect();
        cells.sort_unstable();
        for pair in cells.windows(2) {
            assert_eq!(pair[0].0 + 1, pair[1].0);
            let steps: u32 = (0..3).map(|a| pair[0].1[a].abs_diff(pair[1].1[a])).sum();
            assert_eq!(steps, 1);
        }
    }

    #[test]
    fn the_order_is_a_permutation_even_without_extent() {
        for point in [[0.0; 3], [1e57, -1e57, 0.0]] {
            let points: Vec<Point3<f64>> = (0..1000)
                .map(|i| Point3::from(point) * f64::from(i % 7))
                .collect();
            let mut order = spatial_order(&points);
            order.sort_unstable();
            assert!(order.into_iter().eq(0..1000));
        }
        assert!(spatial_order(&[]).is_empty());
    }
}
