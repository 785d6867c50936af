//! Orientation and binary descriptor of a corner.

use super::descriptor::Descriptor;
use super::spread::Corner;

/// Reach of orientation and descriptor around a corner.
pub(super) const REACH_PX: usize = 19;

/// Side of the patch within reach.
const PATCH_PX: usize = 2 * REACH_PX + 1;

/// Row stride of the copy of a patch: a power of two.
const PATCH_ROW: usize = 64;

/// Radius of the disc whose intensity centroid gives the orientation.
const DISC_PX: usize = 15;

/// Pixels of a row of the disc, padded to a multiple of 16.
const DISC_ROW: usize = 2 * DISC_PX + 2;

/// Half widths of the disc's rows from the centre outwards. The disc is symmetric in rows and columns, unlike a circle rounded
/// row by row.
const DISC_HALF_WIDTHS: [usize; DISC_PX + 1] =
    [15, 15, 15, 15, 14, 14, 14, 13, 13, 12, 11, 10, 9, 8, 6, 3];

/// Bit masks of the pixels in the disc, row by row from the centre.
const DISC: [[i16; DISC_ROW]; DISC_PX + 1] = {
    let mut disc = [[0; DISC_ROW]; DISC_PX + 1];
    let mut row = 0;
    while row <= DISC_PX {
        let mut column = DISC_PX - DISC_HALF_WIDTHS[row];
        while column <= DISC_PX + DISC_HALF_WIDTHS[row] {
            disc[row][column] = -1;
            column += 1;
        }
        row += 1;
    }
    disc
};

/// Orientation of a corner: direction of the intensity centroid, from +x towards +y.
///
/// # Panics
/// When the corner lies within [`REACH_PX`] of the level's border.
pub(super) fn direction(level: &[u8], stride: usize, corner: Corner) -> f32 {
    let left = corner.column as usize - DISC_PX;
    let row = corner.row as usize;
    let pixels = |row: usize| {
        level[row * stride + left..]
            .first_chunk::<DISC_ROW>()
            .expect("the disc lies in the level")
    };
    // One sum per column, for vector instructions. 16 bits hold them: at most 31 grey values, and 255 (1 + 2 + ... + 15).
    let mut sums = [0_i16; DISC_ROW];
    let mut down = [0_i16; DISC_ROW];
    for ((sum, pixel), inside) in sums.iter_mut().zip(pixels(row)).zip(&DISC[0]) {
        *sum = i16::from(*pixel) & inside;
    }
    for (distance, inside) in (1..).zip(&DISC[1..]) {
        let (above, below) = (pixels(row - distance), pixels(row + distance));
        for column in 0..DISC_ROW {
            let above = i16::from(above[column]) & inside[column];
            let below = i16::from(below[column]) & inside[column];
            sums[column] += above + below;
            down[column] += (below - above) * distance as i16;
        }
    }
    let down: i32 = down.iter().map(|down| i32::from(*down)).sum();
    let right: i32 = (sums.iter().zip(-(DISC_PX as i32)..))
        .map(|(sum, distance)| i32::from(*sum) * distance)
        .sum();
    (down as f32).atan2(right as f32)
}

/// ORB descriptors of corners of a smoothed level: intensity comparisons of 256 pixel pairs, rotated by the orientation.
///
/// # Panics
/// When a corner lies within [`REACH_PX`] of the level's border.
///
/// # Reference
/// Rublee, Rabaud, Konolige, Bradski, "ORB: an efficient alternative to SIFT or SURF", ICCV 2011, section 4.
pub(super) fn describe(
    smoothed: &[u8],
    stride: usize,
    corners: &[Corner],
    directions_rad: &[f32],
) -> Vec<Descriptor> {
    let mut patch = [0; PATCH_ROW * PATCH_ROW];
    let of_corner = |(corner, direction_rad): (&Corner, &f32)| {
        let left = corner.column as usize - REACH_PX;
        let top = corner.row as usize - REACH_PX;
        let rows = patch.chunks_exact_mut(PATCH_ROW).take(PATCH_PX);
        for (row, patch) in (top..).zip(rows) {
            let start = row * stride + left;
            patch[..PATCH_PX].copy_from_slice(&smoothed[start..start + PATCH_PX]);
        }
        describe_patch(&patch, *direction_rad)
    };
    corners.iter().zip(directions_rad).map(of_corner).collect()
}

/// The fixed row stride makes indices cheap and always in range.
fn describe_patch(patch: &[u8; PATCH_ROW * PATCH_ROW], direction_rad: f32) -> Descriptor {
    let (sine, cosine) = (direction_rad.sin(), direction_rad.cos());
    let mut indices = [0_u16; 512];
    let centre = (REACH_PX * PATCH_ROW + REACH_PX) as i32;
    for ((index, x), y) in indices.iter_mut().zip(&PAIRS_X).zip(&PAIRS_Y) {
        let row = nearest(sine * x + cosine * y);
        let column = nearest(cosine * x - sine * y);
        *index = (row * PATCH_ROW as i32 + column + centre) as u16;
    }
    let grey = |index: u16| patch[usize::from(index) % patch.len()];
    let mut words = [0; 4];
    for (word, indices) in words.iter_mut().zip(indices.chunks_exact(128)) {
        for pair in indices.chunks_exact(2).rev() {
            *word = *word << 1 | u64::from(grey(pair[0]) < grey(pair[1]));
        }
    }
    Descriptor(words)
}

/// The nearest integer, ties to even, of a number below 2^22 in magnitude.
///
/// With SSE2 alone `f32::round_ties_even` is a function call, which dominated the time of a descriptor. Here the addition
/// rounds: an `f32` of 2^23 and more has no fraction.
fn nearest(value: f32) -> i32 {
    const SHIFT: f32 = 12_582_912.0;
    (value + SHIFT).to_bits() as i32 - SHIFT.to_bits() as i32
}

const PAIRS_X: [f32; 512] = coordinates(0);
const PAIRS_Y: [f32; 512] = coordinates(1);

const fn coordinates(axis: usize) -> [f32; 512] {
    let mut coordinates = [0.0; 512];
    let mut pixel = 0;
    while pixel < 512 {
        coordinates[pixel] = PAIRS[2 * pixel + axis] as f32;
        pixel += 1;
    }
    coordinates
}

/// x and y of both pixels of each pair: the learned pattern of Rublee et al. (`bit_pattern_31_` of their program).
const PAIRS: [i8; 1024] = [
    8, -3, 9, 5, 4, 2, 7, -12, -11, 9, -8, 2, 7, -12, 12, -13, 2, -13, 2, 12, 1, -7, 1, 6, -2, -10,
    -2, -4, -13, -13, -11, -8, -13, -3, -12, -9, 10, 4, 11, 9, -13, -8, -8, -9, -11, 7, -9, 12, 7,
    7, 12, 6, -4, -5, -3, 0, -13, 2, -12, -3, -9, 0, -7, 5, 12, -6, 12, -1, -3, 6, -2, 12, -6, -13,
    -4, -8, 11, -13, 12, -8, 4, 7, 5, 1, 5, -3, 10, -3, 3, -7, 6, 12, -8, -7, -6, -2, -2, 11, -1,
    -10, -13, 12, -8, 10, -7, 3, -5, -3, -4, 2, -3, 7, -10, -12, -6, 11, 5, -12, 6, -7, 5, -6, 7,
    -1, 1, 0, 4, -5, 9, 11, 11, -13, 4, 7, 4, 12, 2, -1, 4, 4, -4, -12, -2, 7, -8, -5, -7, -10, 4,
    11, 9, 12, 0, -8, 1, -13, -13, -2, -8, 2, -3, -2, -2, 3, -6, 9, -4, -9, 8, 12, 10, 7, 0, 9, 1,
    3, 7, -5, 11, -10, -13, -6, -11, 0, 10, 7, 12, 1, -6, -3, -6, 12, 10, -9, 12, -4, -13, 8, -8,
    -12, -13, 0, -8, -4, 3, 3, 7, 8, 5, 7, 10, -7, -1, 7, 1, -12, 3, -10, 5, 6, 2, -4, 3, -10, -13,
    0, -13, 5, -13, -7, -12, 12, -13, 3, -11, 8, -7, 12, -4, 7, 6, -10, 12, 8, -9, -1, -7, -6, -2,
    -5, 0, 12, -12, 5, -7, 5, 3, -10, 8, -13, -7, -7, -4, 5, -3, -2, -1, -7, 2, 9, 5, -11, -11,
    -13, -5, -13, -1, 6, 0, -1, 5, -3, 5, 2, -4, -13, -4, 12, -9, -6, -9, 6, -12, -10, -8, -4, 10,
    2, 12, -3, 7, 12, 12, 12, -7, -13, -6, 5, -4, 9, -3, 4, 7, -1, 12, 2, -7, 6, -5, 1, -13, 11,
    -12, 5, -3, 7, -2, -6, 7, -8, 12, -7, -13, -7, -11, -12, 1, -3, 12, 12, 2, -6, 3, 0, -4, 3, -2,
    -13, -1, -13, 1, 9, 7, 1, 8, -6, 1, -1, 3, 12, 9, 1, 12, 6, -1, -9, -1, 3, -13, -13, -10, 5, 7,
    7, 10, 12, 12, -5, 12, 9, 6, 3, 7, 11, 5, -13, 6, 10, 2, -12, 2, 3, 3, 8, 4, -6, 2, 6, 12, -13,
    9, -12, 10, 3, -8, 4, -7, 9, -11, 12, -4, -6, 1, 12, 2, -8, 6, -9, 7, -4, 2, 3, 3, -2, 6, 3,
    11, 0, 3, -3, 8, -8, 7, 8, 9, 3, -11, -5, -6, -4, -10, 11, -5, 10, -5, -8, -3, 12, -10, 5, -9,
    0, 8, -1, 12, -6, 4, -6, 6, -11, -10, 12, -8, 7, 4, -2, 6, 7, -2, 0, -2, 12, -5, -8, -5, 2, 7,
    -6, 10, 12, -9, -13, -8, -8, -5, -13, -5, -2, 8, -8, 9, -13, -9, -11, -9, 0, 1, -8, 1, -2, 7,
    -4, 9, 1, -2, 1, -1, -4, 11, -6, 12, -11, -12, -9, -6, 4, 3, 7, 7, 12, 5, 5, 10, 8, 0, -4, 2,
    8, -9, 12, -5, -13, 0, 7, 2, 12, -1, 2, 1, 7, 5, 11, 7, -9, 3, 5, 6, -8, -13, -4, -8, 9, -5, 9,
    -3, -3, -4, -7, -3, -12, 6, 5, 8, 0, -7, 6, -6, 12, -13, 6, -5, -2, 1, -10, 3, 10, 4, 1, 8, -4,
    -2, -2, 2, -13, 2, -12, 12, 12, -2, -13, 0, -6, 4, 1, 9, 3, -6, -10, -3, -5, -3, -13, -1, 1, 7,
    5, 12, -11, 4, -2, 5, -7, -13, 9, -9, -5, 7, 1, 8, 6, 7, -8, 7, 6, -7, -4, -7, 1, -8, 11, -7,
    -8, -13, 6, -12, -8, 2, 4, 3, 9, 10, -5, 12, 3, -6, -5, -6, 7, 8, -3, 9, -8, 2, -12, 2, 8, -11,
    -2, -10, 3, -12, -13, -7, -9, -11, 0, -10, -5, 5, -3, 11, 8, -2, -13, -1, 12, -1, -8, 0, 9,
    -13, -11, -12, -5, -10, -2, -10, 11, -3, 9, -2, -13, 2, -3, 3, 2, -9, -13, -4, 0, -4, 6, -3,
    -10, -4, 12, -2, -7, -6, -11, -4, 9, 6, -3, 6, 11, -13, 11, -5, 5, 11, 11, 12, 6, 7, -5, 12,
    -2, -1, 12, 0, 7, -4, -8, -3, -2, -7, 1, -6, 7, -13, -12, -8, -13, -7, -2, -6, -8, -8, 5, -6,
    -9, -5, -1, -4, 5, -13, 7, -8, 10, 1, 5, 5, -13, 1, 0, 10, -13, 9, 12, 10, -1, 5, -8, 10, -9,
    -1, 11, 1, -13, -9, -3, -6, 2, -1, -10, 1, 12, -13, 1, -8, -10, 8, -11, 10, -6, 2, -13, 3, -6,
    7, -13, 12, -9, -10, -10, -5, -7, -10, -8, -8, -13, 4, -6, 8, 5, 3, 12, 8, -13, -4, 2, -3, -3,
    5, -13, 10, -12, 4, -13, 5, -1, -9, 9, -4, 3, 0, 3, 3, -9, -12, 1, -6, 1, 3, 2, 4, -8, -10,
    -10, -10, 9, 8, -13, 12, 12, -8, -12, -6, -5, 2, 2, 3, 7, 10, 6, 11, -8, 6, 8, 8, -12, -7, 10,
    -6, 5, -3, -9, -3, 9, -1, -13, -1, 5, -3, -7, -3, 4, -8, -2, -8, 3, 4, 2, 12, 12, 2, -5, 3, 11,
    6, -9, 11, -13, 3, -1, 7, 12, 11, -1, 12, 4, -3, 0, -3, 6, 4, -11, 4, 12, 2, -4, 2, 1, -10, -6,
    -8, 1, -13, 7, -11, 1, -13, 12, -11, -13, 6, 0, 11, -13, 0, -1, 1, 4, -13, 3, -9, -2, -9, 8,
    -6, -3, -13, -6, -8, -2, 5, -9, 8, 10, 2, 7, 3, -9, -1, -6, -1, -1, 9, 5, 11, -2, 11, -3, 12,
    -8, 3, 0, 3, 5, -1, 4, 0, 10, 3, -6, 4, 5, -13, 0, -10, 5, 5, 8, 12, 11, 8, 9, 9, -6, 7, -4, 8,
    -12, -10, 4, -10, 9, 7, 3, 12, 4, 9, -7, 10, -2, 7, 0, 12, -2, -1, -6, 0, -11,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_round_to_even() {
        for value in [
            -18.5_f32, -2.5, -1.5, -0.5, -0.2, 0.0, 0.5, 1.5, 2.4999, 17.5, 18.0,
        ] {
            assert_eq!(nearest(value), value.round_ties_even() as i32, "{value}");
        }
    }

    #[test]
    fn pairs_stay_within_reach_however_they_turn() {
        let farthest = PAIRS_X
            .iter()
            .zip(&PAIRS_Y)
            .map(|(x, y)| x.hypot(*y))
            .fold(0.0, f32::max);
        assert!(farthest.round() as usize <= REACH_PX, "{farthest}");
    }

    #[test]
    fn a_slope_points_to_its_bright_side() {
        let corner = Corner {
            column: 20,
            row: 20,
        };
        let slope = |x: i32, y: i32| -> Vec<u8> {
            let pixel = |i: i32| (100 + x * (i % 41 - 20) + y * (i / 41 - 20)) as u8;
            (0..41 * 41).map(pixel).collect()
        };
        for (x, y) in [(2, 0), (0, 2), (-2, 0), (1, -2), (2, 2)] {
            let found = direction(&slope(x, y), 41, corner);
            assert!(
                (found - (y as f32).atan2(x as f32)).abs() < 1e-4,
                "{x} {y}: {found}"
            );
        }
    }

    /// Turned by a quarter, an image has the same descriptor under the turned direction.
    #[test]
    fn descriptors_turn_with_the_image() {
        let side = 41;
        let image: Vec<u8> = (0..side * side).map(|i| (i * i * 7 % 251) as u8).collect();
        let turned: Vec<u8> = (0..side * side)
            .map(|i| image[(side - 1 - i % side) * side + i / side])
            .collect();
        let corner = Corner {
            column: 20,
            row: 20,
        };
        let quarter = std::f32::consts::FRAC_PI_2;
        assert_eq!(
            describe(&image, side, &[corner], &[0.0]),
            describe(&turned, side, &[corner], &[quarter])
        );
    }
}
