//! Which tile owns which positions, and the blocks within a tile: a k-d tree over positions.

use std::cmp::Ordering;
use std::ops::Range;

use linecarve_carving::internals::predicates::{are_collinear, orient3d};

use crate::bounds::Bounds;
use crate::record::Record;

/// Most positions of a block.
const BLOCK: usize = 256;

/// How the positions of a tile are numbered.
#[derive(Clone, Debug, Default)]
pub(crate) struct Numbering {
    /// Indices of its positions, block by block.
    pub(crate) order: Vec<u32>,
    /// The blocks: ranges of `order`.
    pub(crate) blocks: Vec<Range<usize>>,
    /// Where in `order` the smallest and largest along each axis are.
    pub(crate) extremes: Vec<usize>,
}

/// Lexicographic order.
pub(crate) fn by_position(a: &[f64; 3], b: &[f64; 3]) -> Ordering {
    (0..3)
        .map(|k| a[k].total_cmp(&b[k]))
        .fold(Ordering::Equal, Ordering::then)
}

/// Numbers the distinct positions of a tile: near ones are in one block.
pub(crate) fn number(positions: &[[f64; 3]]) -> Numbering {
    let mut order: Vec<u32> = (0..positions.len() as u32).collect();
    let mut blocks = Vec::new();
    let parts = order.len().div_ceil(BLOCK).max(1);
    let mut leaf = |range: Range<usize>| blocks.push(range);
    split(positions, &mut order, 0, parts, 0, &mut leaf, &mut |_| ());
    blocks.retain(|block| !block.is_empty());
    let at = |&local: &usize| &positions[order[local] as usize];
    let extreme = |k: usize| {
        let by = move |a: &usize, b: &usize| {
            (at(a)[k].total_cmp(&at(b)[k])).then_with(|| by_position(at(a), at(b)))
        };
        let all = || 0..order.len();
        [all().min_by(by), all().max_by(by)]
    };
    Numbering {
        extremes: (0..3).flat_map(extreme).flatten().collect(),
        order,
        blocks,
    }
}

/// Where a part of space is split in two.
#[derive(Clone, Copy, Debug)]
enum Border {
    /// The smallest position of the upper half, along an axis.
    At(usize, [f64; 3]),
    /// The upper half is empty.
    AllLower,
    /// The lower half is empty.
    AllUpper,
}

impl Border {
    fn is_upper(&self, position: &[f64; 3]) -> bool {
        match self {
            Border::At(axis, border) => along(*axis, position, border).is_ge(),
            Border::AllLower => false,
            Border::AllUpper => true,
        }
    }
}

/// Which tile owns which position: a tree over all of space.
#[derive(Clone, Debug)]
pub(crate) struct Territory {
    /// The borders in depth-first order, each with the number of tiles below and in its lower half.
    borders: Vec<(Border, usize)>,
    tiles: usize,
}

impl Territory {
    /// Splits space into tiles with about equally many of these distinct positions; some are empty when there are fewer. Another seed
    /// splits in another way.
    pub(crate) fn new(positions: &[[f64; 3]], tiles: usize, seed: u64) -> Self {
        let mut order: Vec<u32> = (0..positions.len() as u32).collect();
        let mut borders = Vec::new();
        let mut enter = |border| borders.push(border);
        split(
            positions,
            &mut order,
            0,
            tiles,
            seed,
            &mut |_| (),
            &mut enter,
        );
        Self { borders, tiles }
    }

    /// The tile that owns a position.
    ///
    /// # Complexity
    /// Logarithmic in the number of tiles.
    pub(crate) fn tile(&self, position: &[f64; 3]) -> usize {
        let (mut node, mut first, mut count) = (0, 0, self.tiles);
        while count > 1 {
            let (border, lower) = &self.borders[node];
            // A part of n tiles has n - 1 borders.
            if border.is_upper(position) {
                (node, first, count) = (node + lower, first + lower, count - lower);
            } else {
                (node, count) = (node + 1, *lower);
            }
        }
        first
    }

    /// Everything that tells it from others.
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        for (border, lower) in &self.borders {
            let (axis, position) = match border {
                Border::At(axis, position) => (*axis as u64, *position),
                Border::AllLower => (3, [0.0; 3]),
                Border::AllUpper => (4, [0.0; 3]),
            };
            [*lower as u64, axis].put(out);
            position.put(out);
        }
    }
}

/// Order along an axis; equal positions alone are equal.
fn along(axis: usize, a: &[f64; 3], b: &[f64; 3]) -> Ordering {
    a[axis].total_cmp(&b[axis]).then_with(|| by_position(a, b))
}

/// Passes the ranges of `parts` parts of `order`, which is sorted along, to `leaf`, and the borders between to `enter`. Parts are of
/// about equal size.
fn split(
    positions: &[[f64; 3]],
    order: &mut [u32],
    first: usize,
    parts: usize,
    seed: u64,
    leaf: &mut impl FnMut(Range<usize>),
    enter: &mut impl FnMut((Border, usize)),
) {
    if parts <= 1 {
        leaf(first..first + order.len());
        return;
    }
    let bounds = Bounds::of(order.iter().map(|&v| &positions[v as usize]));
    let side = |k: &usize| bounds.high[*k] - bounds.low[*k];
    let longest = (0..3).max_by(|a, b| side(a).total_cmp(&side(b)));
    // A seed turns the axis and moves the border.
    let mixed = seed
        .wrapping_mul(0x9e37_79b9_7f4a_7c15)
        .wrapping_add(first as u64 ^ parts as u64);
    let turned = match seed {
        0 => 0,
        _ => (mixed >> 17) as usize % 3,
    };
    let axis = (longest.unwrap_or(0) + turned) % 3;
    let lower = match seed {
        0 => parts / 2,
        _ => (parts / 3 + (mixed >> 29) as usize % (parts / 3 + 1)).clamp(1, parts - 1),
    };
    let at = (order.len() as u128 * lower as u128 / parts as u128) as usize;
    let border = if at == 0 {
        Border::AllUpper
    } else if at == order.len() {
        Border::AllLower
    } else {
        let by = |a: &u32, b: &u32| along(axis, &positions[*a as usize], &positions[*b as usize]);
        order.select_nth_unstable_by(at, by);
        Border::At(axis, positions[order[at] as usize])
    };
    enter((border, lower));
    let (low, high) = order.split_at_mut(at);
    // The selection leaves an order of its own within the parts.
    split(positions, low, first, lower, seed, leaf, enter);
    split(
        positions,
        high,
        first + at,
        parts - lower,
        seed,
        leaf,
        enter,
    );
}

/// Four positions that span space, found one after another.
#[derive(Clone, Debug, Default)]
pub(crate) struct Basis {
    found: Vec<[f64; 3]>,
}

impl Basis {
    pub(crate) fn add(&mut self, position: &[f64; 3]) {
        let is_next = match &self.found[..] {
            [] => true,
            [a] => a != position,
            [a, b] => !are_collinear(a, b, position),
            [a, b, c] => orient3d(a, b, c, position) != 0.0,
            _ => false,
        };
        if is_next {
            self.found.push(*position);
        }
    }

    pub(crate) fn is_complete(&self) -> bool {
        self.found.len() == 4
    }

    pub(crate) fn contains(&self, position: &[f64; 3]) -> bool {
        self.found.contains(position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_position_is_in_one_tile_and_one_block() {
        let positions: Vec<[f64; 3]> = (0..1000)
            .map(|i| [i % 10, i / 10 % 10, i / 100].map(f64::from))
            .collect();
        for (count, seed) in [(1, 0), (2, 0), (7, 3), (64, 1), (3000, 0)] {
            let territory = Territory::new(&positions, count, seed);
            let mut owned = vec![0usize; count];
            for position in &positions {
                owned[territory.tile(position)] += 1;
            }
            assert_eq!(owned.iter().sum::<usize>(), 1000);
            if seed == 0 {
                let most = owned.iter().max().unwrap();
                assert!(most - owned.iter().min().unwrap() <= 1, "{owned:?}");
            }
        }
        let numbering = number(&positions);
        let blocks: Vec<usize> = numbering.blocks.iter().cloned().flatten().collect();
        assert_eq!(blocks, (0..1000).collect::<Vec<_>>());
        let mut all = numbering.order;
        all.sort_unstable();
        assert_eq!(all, (0..1000).collect::<Vec<u32>>());
        let mut basis = Basis::default();
        let flat = positions.iter().map(|p| [p[0], p[1], 2.0]);
        flat.for_each(|position| basis.add(&position));
        assert!(!basis.is_complete());
        positions.iter().for_each(|position| basis.add(position));
        assert!(basis.is_complete());
    }
}
