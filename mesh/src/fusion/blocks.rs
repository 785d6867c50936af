//! Sets of grid corners, one bit each in blocks of 4 x 4 x 4.

use rustc_hash::FxHashMap;

use super::grid::Corner;

/// Bits of a corner's number that tell its place in a block.
const PLACE_BITS: u32 = 6;
/// The bits of a block at each place along each axis.
const PLANES: [[u64; 4]; 3] = [
    [
        0x0055_0055_0055_0055,
        0x00aa_00aa_00aa_00aa,
        0x5500_5500_5500_5500,
        0xaa00_aa00_aa00_aa00,
    ],
    [
        0x0000_3333_0000_3333,
        0x0000_cccc_0000_cccc,
        0x3333_0000_3333_0000,
        0xcccc_0000_cccc_0000,
    ],
    [
        0x0000_0000_0f0f_0f0f,
        0x0000_0000_f0f0_f0f0,
        0x0f0f_0f0f_0000_0000,
        0xf0f0_f0f0_0000_0000,
    ],
];

/// Corners that are being collected: the bits of each block, by its number.
#[derive(Default)]
pub(super) struct CornerBits(FxHashMap<Corner, u64>);

impl CornerBits {
    pub(super) fn insert(&mut self, corner: Corner) {
        let (block, place) = corner.split(PLACE_BITS);
        *self.0.entry(block).or_default() |= 1 << place;
    }

    /// Both together.
    pub(super) fn union(self, other: Self) -> Self {
        let (mut large, small) = match self.0.len() < other.0.len() {
            true => (other.0, self.0),
            false => (self.0, other.0),
        };
        for (block, bits) in small {
            *large.entry(block).or_default() |= bits;
        }
        Self(large)
    }

    /// With the next corners along an axis.
    pub(super) fn with_next(&self, axis: usize) -> Self {
        let [first, second, third, last] = PLANES[axis];
        let step = 1 << axis;
        let next = |bits| (bits & (first | third)) << step | (bits & second) << (7 * step);
        let across = |bits| (bits & last) >> (9 * step);
        self.with(next, across, |block| block.next(axis))
    }

    /// With the corners before along an axis.
    pub(super) fn with_previous(&self, axis: usize) -> Self {
        let [first, second, third, last] = PLANES[axis];
        let step = 1 << axis;
        let previous = |bits| (bits & (second | last)) >> step | (bits & third) >> (7 * step);
        let across = |bits| (bits & first) << (9 * step);
        self.with(previous, across, |block| block.previous(axis))
    }

    /// With neighbours of the corners: those in their own block, and those in the block beside it.
    fn with(
        &self,
        within: impl Fn(u64) -> u64,
        across: impl Fn(u64) -> u64,
        beside: impl Fn(Corner) -> Corner,
    ) -> Self {
        let mut grown = FxHashMap::default();
        for (block, bits) in &self.0 {
            *grown.entry(*block).or_default() |= bits | within(*bits);
            let across = across(*bits);
            if across != 0 {
                *grown.entry(beside(*block)).or_default() |= across;
            }
        }
        Self(grown)
    }
}

/// A block of a set.
#[derive(Clone, Copy)]
pub(super) struct Block {
    number: Corner,
    bits: u64,
    /// Number of its first corner in the set.
    first: u32,
}

impl Block {
    /// How many corners it has.
    pub(super) fn len(self) -> usize {
        self.bits.count_ones() as usize
    }

    /// The number in the set of the corner at a place.
    #[inline]
    fn number(&self, place: u32) -> Option<usize> {
        let before = self.bits & ((1 << place) - 1);
        (self.bits >> place & 1 == 1).then(|| (self.first + before.count_ones()) as usize)
    }

    /// Its corners, ascending.
    pub(super) fn corners(self) -> impl Iterator<Item = Corner> {
        let set = move |bits: &u64| Some(bits & (bits - 1)).filter(|rest| *rest != 0);
        let start = Some(self.bits).filter(|bits| *bits != 0);
        std::iter::successors(start, set)
            .map(move |bits| Corner::joined(self.number, bits.trailing_zeros(), PLACE_BITS))
    }
}

/// A set of corners. They are numbered in ascending order.
pub(super) struct CornerSet {
    blocks: Vec<Block>,
    index: FxHashMap<Corner, u32>,
    len: usize,
}

impl CornerSet {
    pub(super) fn new(collected: &CornerBits) -> Self {
        let mut bits: Vec<(Corner, u64)> =
            collected.0.iter().map(|(it, bits)| (*it, *bits)).collect();
        bits.sort_unstable();
        let mut len = 0;
        let blocks: Vec<Block> = bits
            .into_iter()
            .map(|(number, bits)| {
                let first = len;
                len += bits.count_ones();
                Block {
                    number,
                    bits,
                    first,
                }
            })
            .collect();
        let index = blocks.iter().zip(0..).map(|(block, at)| (block.number, at));
        Self {
            index: index.collect(),
            blocks,
            len: len as usize,
        }
    }

    /// How many corners there are.
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// The blocks, ascending.
    pub(super) fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    #[inline]
    fn block(&self, number: Corner) -> Option<&Block> {
        self.index.get(&number).map(|at| &self.blocks[*at as usize])
    }
}

/// The blocks of a set at a block and beside it in one direction along each axis, so that they need not be searched for each corner.
pub(super) struct Nearby<'a> {
    own: Corner,
    /// Bit `axis` of a number tells that the block is beside along that axis.
    blocks: [Option<&'a Block>; 8],
}

impl<'a> Nearby<'a> {
    /// At a block and after it.
    pub(super) fn after(block: &Block, set: &'a CornerSet) -> Self {
        Self::new(block.number, set, Corner::next)
    }

    /// At a block and before it.
    pub(super) fn before(block: &Block, set: &'a CornerSet) -> Self {
        Self::new(block.number, set, Corner::previous)
    }

    fn new(own: Corner, set: &'a CornerSet, step: impl Fn(Corner, usize) -> Corner) -> Self {
        let block = |number: usize| {
            let axes = (0..3).filter(|axis| number >> axis & 1 == 1);
            set.block(axes.fold(own, &step))
        };
        Self {
            own,
            blocks: std::array::from_fn(block),
        }
    }

    /// The number in the set of a corner, which lies in one of the blocks.
    #[inline]
    pub(super) fn number(&self, corner: Corner) -> Option<usize> {
        let (block, place) = corner.split(PLACE_BITS);
        self.blocks[block.differing_axes(self.own)]?.number(place)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;

    #[test]
    fn sets_of_blocks_are_sets_of_corners() {
        let corners: Vec<Corner> = (0..600_i64)
            .map(|k| Corner::new([k * 7 % 19 - 9, k * 5 % 23 - 11, k * 11 % 17 - 8]).unwrap())
            .collect();
        let mut collected = CornerBits::default();
        let mut expected: BTreeSet<Corner> = BTreeSet::new();
        for corner in corners {
            collected.insert(corner);
            expected.insert(corner);
        }
        for axis in 0..3 {
            collected = collected
                .with_previous(axis)
                .union(collected.with_next(axis));
            let around = |it: &Corner| [it.previous(axis), *it, it.next(axis)];
            expected = expected.iter().flat_map(around).collect();
        }
        let set = CornerSet::new(&collected);
        assert_eq!(set.len(), expected.len());
        let all = set.blocks().iter().flat_map(|block| block.corners());
        assert!(all.eq(expected.iter().copied()));
        let numbers: BTreeMap<Corner, usize> = expected.iter().copied().zip(0..).collect();
        for block in set.blocks() {
            let (after, before) = (Nearby::after(block, &set), Nearby::before(block, &set));
            for (corner, beside) in block.corners().flat_map(|it| (0..8).map(move |k| (it, k))) {
                let axes = || (0..3).filter(|axis| beside >> axis & 1 == 1);
                let next = axes().fold(corner, Corner::next);
                assert_eq!(after.number(next), numbers.get(&next).copied());
                let previous = axes().fold(corner, Corner::previous);
                assert_eq!(before.number(previous), numbers.get(&previous).copied());
            }
        }
        assert_eq!(CornerSet::new(&CornerBits::default()).len(), 0);
    }
}
