//! Corners of a grid as single numbers, near ones close to each other.

use nalgebra::Point3;

/// Bits of a coordinate.
const BITS: u32 = 21;
/// What is added to a coordinate so that it is not negative.
const OFFSET: i64 = 1 << (BITS - 1);

/// Coordinates, in sides, of the lowest corner of the cube around a point; `None` for points too far away and NaN.
#[inline]
pub(super) fn coordinates_below(point: &Point3<f64>, side: f64) -> Option<[i32; 3]> {
    let scaled = point.coords / side;
    if !scaled.iter().all(|along| along.abs() < OFFSET as f64) {
        return None;
    }
    // Without SSE 4.1 `floor` is a call.
    Some([scaled.x, scaled.y, scaled.z].map(|along| {
        let whole = along as i32;
        whole - i32::from(along < f64::from(whole))
    }))
}

/// A corner of the grid. The bits of its coordinates alternate (Morton order), so that corners with near numbers are near.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Corner(u64);

impl Corner {
    /// The corner at coordinates, in sides; `None` beyond a million.
    pub(super) fn new(coordinates: [i64; 3]) -> Option<Self> {
        let mut code = 0;
        for (axis, coordinate) in coordinates.into_iter().enumerate() {
            let shifted = coordinate + OFFSET;
            // Two are left free at either end for the steps to neighbours.
            if !(2..2 * OFFSET - 2).contains(&shifted) {
                return None;
            }
            code |= spread(shifted as u64) << axis;
        }
        Some(Self(code))
    }

    /// The lowest corner of the cube around a point; `None` for points too far away and NaN.
    pub(super) fn below(point: &Point3<f64>, side: f64) -> Option<Self> {
        Self::new(coordinates_below(point, side)?.map(i64::from))
    }

    /// The corner of a grid of blocks and the place in the block, of so many bits.
    pub(super) fn split(self, bits: u32) -> (Self, u32) {
        let place = self.0 & ((1 << bits) - 1);
        (Self(self.0 >> bits), place as u32)
    }

    /// The inverse of [`split`](Self::split).
    pub(super) fn joined(block: Self, place: u32, bits: u32) -> Self {
        Self(block.0 << bits | u64::from(place))
    }

    /// Its coordinates in sides.
    pub(super) fn coordinates(self) -> [i64; 3] {
        [0, 1, 2].map(|axis| gather(self.0 >> axis) as i64 - OFFSET)
    }

    /// Its position.
    pub(super) fn position(self, side: f64) -> Point3<f64> {
        Point3::from(self.coordinates().map(|along| along as f64 * side))
    }

    /// The next corner along an axis.
    pub(super) fn next(self, axis: usize) -> Self {
        // Adding one to a coordinate whose bits lie three apart: the bits between carry over.
        let others = !(MASK << axis);
        let moved = ((self.0 | others).wrapping_add(1 << axis)) & !others;
        Self(self.0 & others | moved)
    }

    /// The axes along which two corners differ: bit `axis` is set for each.
    #[inline]
    pub(super) fn differing_axes(self, other: Self) -> usize {
        let bits = self.0 ^ other.0;
        let differs = |axis: usize| usize::from(bits & MASK << axis != 0) << axis;
        differs(0) | differs(1) | differs(2)
    }

    /// The corner before along an axis.
    pub(super) fn previous(self, axis: usize) -> Self {
        let others = !(MASK << axis);
        let moved = (self.0 & !others).wrapping_sub(1 << axis) & !others;
        Self(self.0 & others | moved)
    }
}

/// Every third bit.
const MASK: u64 = 0x1249_2492_4924_9249;

/// Moves the lowest 21 bits to every third.
fn spread(value: u64) -> u64 {
    let mut x = value & 0x1f_ffff;
    x = (x | x << 32) & 0x1f_0000_0000_ffff;
    x = (x | x << 16) & 0x1f_0000_ff00_00ff;
    x = (x | x << 8) & 0x100f_00f0_0f00_f00f;
    x = (x | x << 4) & 0x10c3_0c30_c30c_30c3;
    (x | x << 2) & MASK
}

/// The inverse of [`spread`].
fn gather(value: u64) -> u64 {
    let mut x = value & MASK;
    x = (x | x >> 2) & 0x10c3_0c30_c30c_30c3;
    x = (x | x >> 4) & 0x100f_00f0_0f00_f00f;
    x = (x | x >> 8) & 0x1f_0000_ff00_00ff;
    x = (x | x >> 16) & 0x1f_0000_0000_ffff;
    (x | x >> 32) & 0x1f_ffff
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_and_steps() {
        let last = OFFSET - 3;
        for coordinates in [
            [0, 0, 0],
            [-1, 5, 1023],
            [-last, last, -7],
            [4095, -4096, 1],
        ] {
            let corner = Corner::new(coordinates).unwrap();
            assert_eq!(corner.coordinates(), coordinates);
            for axis in 0..3 {
                let mut expected = coordinates;
                expected[axis] += 1;
                assert_eq!(corner.next(axis).coordinates(), expected);
                expected[axis] -= 2;
                assert_eq!(corner.previous(axis).coordinates(), expected);
            }
        }
        assert_eq!(Corner::new([OFFSET - 2, 0, 0]), None);
        assert_eq!(Corner::new([0, 1 - OFFSET, 0]), None);
    }

    #[test]
    fn the_cube_around_a_point() {
        let corner = Corner::below(&Point3::new(0.31, -0.01, 0.0), 0.1).unwrap();
        assert_eq!(corner.coordinates(), [3, -1, 0]);
        for bad in [f64::NAN, f64::INFINITY, 1e9] {
            assert_eq!(Corner::below(&Point3::new(bad, 0.0, 0.0), 0.1), None);
        }
    }
}
