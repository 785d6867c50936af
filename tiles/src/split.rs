//! Which tile owns which positions, and the blocks within a tile: a k-d tree over positions.

use std::cmp::Ordering;
use std::ops::Range;

use linecarve_carving::internals::predicates::{are_collinear, orient3d};

use crate::bounds::Bounds;

/// Most positions of a block.
const BLOCK: usize = 256;

/// The positions of a tile.
#[derive(Clone, Debug, Default)]
pub(crate) struct Tile {
    /// Numbers of its positions, block by block.
    pub(crate) vertices: Vec<u32>,
    /// The blocks: ranges of `vertices`.
    pub(crate) blocks: Vec<Range<usize>>,
    /// Where in `vertices` the smallest and largest along each axis are.
    pub(crate) extremes: Vec<usize>,
}

/// Lexicographic order.
pub(crate) fn by_position(a: &[f64; 3], b: &[f64; 3]) -> Ordering {
    (0..3)
        .map(|k| a[k].total_cmp(&b[k]))
        .fold(Ordering::Equal, Ordering::then)
}

/// Splits distinct positions into tiles; some are empty when there are fewer positions.
pub(crate) fn tiles(positions: &[[f64; 3]], count: usize, seed: u64) -> Vec<Tile> {
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    let mut ranges = Vec::new();
    split(positions, &mut order, 0, count, seed, &mut ranges);
    let tile = |range: Range<usize>| {
        let mut vertices = order[range].to_vec();
        let mut blocks = Vec::new();
        let parts = vertices.len().div_ceil(BLOCK).max(1);
        split(positions, &mut vertices, 0, parts, 0, &mut blocks);
        blocks.retain(|block| !block.is_empty());
        let at = |&local: &usize| &positions[vertices[local] as usize];
        let extreme = |k: usize| {
            let by = move |a: &usize, b: &usize| {
                (at(a)[k].total_cmp(&at(b)[k])).then_with(|| by_position(at(a), at(b)))
            };
            let all = || 0..vertices.len();
            [all().min_by(by), all().max_by(by)]
        };
        let extremes = (0..3).flat_map(extreme).flatten().collect();
        Tile {
            extremes,
            vertices,
            blocks,
        }
    };
    ranges.into_iter().map(tile).collect()
}

/// Appends the ranges of `parts` parts of `order`, which is sorted along. Parts are of about equal size.
fn split(
    positions: &[[f64; 3]],
    order: &mut [u32],
    first: usize,
    parts: usize,
    seed: u64,
    ranges: &mut Vec<Range<usize>>,
) {
    if parts <= 1 {
        ranges.push(first..first + order.len());
        return;
    }
    let bounds = Bounds::of(order.iter().map(|&v| &positions[v as usize]));
    let side = |k: &usize| bounds.high[*k] - bounds.low[*k];
    let longest = (0..3).max_by(|a, b| side(a).total_cmp(&side(b)));
    // A seed turns the axis and moves the border.
    let mixed = seed
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(first as u64 ^ parts as u64);
    let turned = if seed == 0 {
        0
    } else {
        (mixed >> 17) as usize % 3
    };
    let axis = (longest.unwrap_or(0) + turned) % 3;
    let left = match seed {
        0 => parts / 2,
        _ => (parts / 3 + (mixed >> 29) as usize % (parts / 3 + 1)).clamp(1, parts - 1),
    };
    let at = (order.len() as u128 * left as u128 / parts as u128) as usize;
    let by = |a: &u32, b: &u32| {
        let (a, b) = (&positions[*a as usize], &positions[*b as usize]);
        a[axis].total_cmp(&b[axis]).then_with(|| by_position(a, b))
    };
    if at > 0 && at < order.len() {
        order.select_nth_unstable_by(at, by);
    }
    let (low, high) = order.split_at_mut(at);
    // The selection leaves an order of its own within the parts.
    let (left_parts, right_parts) = (left, parts - left);
    split(positions, low, first, left_parts, seed, ranges);
    split(positions, high, first + at, right_parts, seed, ranges);
}

/// Four positions that span space; `None` when there are none.
pub(crate) fn basis(positions: &[[f64; 3]]) -> Option<[u32; 4]> {
    let at = |i: usize| &positions[i];
    let (a, b) = (0, 1);
    let c = (2..positions.len()).find(|&c| !are_collinear(at(a), at(b), at(c)))?;
    let d = (c + 1..positions.len()).find(|&d| orient3d(at(a), at(b), at(c), at(d)) != 0.0)?;
    Some([a as u32, b as u32, c as u32, d as u32])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_is_in_one_tile_and_one_block() {
        let positions: Vec<[f64; 3]> = (0..1000)
            .map(|i| {
                [
                    f64::from(i % 10),
                    f64::from(i / 10 % 10),
                    f64::from(i / 100),
                ]
            })
            .collect();
        for (count, seed) in [(1, 0), (2, 0), (7, 3), (64, 1), (3000, 0)] {
            let tiles = tiles(&positions, count, seed);
            assert_eq!(tiles.len(), count);
            let mut all: Vec<u32> = tiles
                .iter()
                .flat_map(|tile| tile.vertices.clone())
                .collect();
            all.sort_unstable();
            assert_eq!(all, (0..1000).collect::<Vec<u32>>());
            for tile in &tiles {
                let blocks: Vec<usize> = tile.blocks.iter().cloned().flatten().collect();
                assert_eq!(blocks, (0..tile.vertices.len()).collect::<Vec<_>>());
            }
        }
        let flat: Vec<[f64; 3]> = positions.iter().map(|p| [p[0], p[1], 2.0]).collect();
        assert_eq!(basis(&flat[..100]), None);
        assert!(basis(&positions).is_some());
    }
}
