//! Cubes of an octree that is aligned with the axes. The cubes of level `l` have sides of `2^l`.

use nalgebra::Point3;

/// Levels below the top level.
pub(super) const DEPTH: u32 = 20;
/// The extent of a cloud has at most `2^TOP` cubes of the top level along an axis.
const TOP: i32 = 6;

/// The top level of a cloud with this extent. Noise and details are smaller than its cubes, and most clouds have thousands of them.
pub(crate) fn top_level(extent: f64) -> i32 {
    /// Beyond, coordinates are not accepted.
    const RANGE: f64 = 900.0;
    let level = extent.log2().ceil();
    match level.is_finite() {
        true => level.clamp(-RANGE, RANGE) as i32 - TOP,
        false => 0,
    }
}

/// The cube of the top level that holds a position.
pub(crate) fn top_cube(position: &Point3<f64>, top: i32) -> [i64; 3] {
    let side = f64::from(top).exp2();
    (position.coords / side).map(|x| x.floor() as i64).into()
}

/// Where a position lies in its cube of the top level, along a Morton curve of `3 DEPTH` bits.
pub(super) fn morton(position: &Point3<f64>, top: i32) -> u64 {
    let side = f64::from(top).exp2();
    let cells = f64::from(1u32 << DEPTH);
    let [x, y, z] = <[f64; 3]>::from(position.coords).map(|x| {
        let share = x / side;
        spread((((share - share.floor()) * cells) as u64).min((1 << DEPTH) - 1))
    });
    x << 2 | y << 1 | z
}

/// The bits of a number, two zeros between them.
fn spread(x: u64) -> u64 {
    let steps = [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ];
    steps.iter().fold(x, |x, (by, mask)| (x | x << by) & mask)
}
