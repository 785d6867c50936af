//! Outlines where the depth jumps or the surface folds.

use super::buffer::{Sample, SampleBuffer};

/// Second differences of inverse depth, relative to it, at which an outline begins and is full.
const JUMP: (f64, f64) = (0.02, 0.05);
/// Cosines between neighbouring normals at which a crease begins and is full: about 30 and 50 degrees.
const CREASE: (f64, f64) = (0.87, 0.64);

/// How strongly a sample lies on an outline: (jump, crease), each 0 to 1.
///
/// Inverse depth is linear in the pixel on any plane, whatever its slant, so that its second difference is zero on planes,
/// small at creases and large at jumps.
pub(super) fn outline_at(
    buffer: &SampleBuffer,
    sample: &Sample,
    (column, row): (usize, usize),
) -> (f64, f64) {
    let step = (buffer.supersampling / 2).max(1);
    if is_within(buffer, sample, (column, row), step) {
        return (0.0, 0.0);
    }
    let inverse = 1.0 / f64::from(sample.depth);
    let normal = buffer.normal(sample);
    let (mut jump, mut fold) = (0.0_f64, 1.0_f64);
    let pairs = [
        (
            column.checked_sub(step).map(|c| (c, row)),
            Some((column + step, row)).filter(|(c, _)| *c < buffer.width),
        ),
        (
            row.checked_sub(step).map(|r| (column, r)),
            Some((column, row + step)).filter(|(_, r)| *r < buffer.height),
        ),
    ];
    for (before, after) in pairs {
        let (Some(before), Some(after)) = (before, after) else {
            continue;
        };
        let neighbours = [before, after].map(|(c, r)| buffer.at(c, r));
        // Nothing behind is infinitely far: inverse depth zero.
        let sum: f64 = neighbours
            .iter()
            .map(|n| n.map_or(0.0, |n| 1.0 / f64::from(n.depth)))
            .sum();
        // Only the nearer surface carries the outline, else the line is twice as wide.
        jump = jump.max((2.0 * inverse - sum) / inverse);
        for neighbour in neighbours.into_iter().flatten() {
            fold = fold.min(normal.dot(&buffer.normal(neighbour)));
        }
    }
    (ramp(jump, JUMP), ramp(fold, CREASE))
}

/// Whether the samples around see the same side of the same triangle.
fn is_within(
    buffer: &SampleBuffer,
    sample: &Sample,
    (column, row): (usize, usize),
    step: usize,
) -> bool {
    if column < step || column + step >= buffer.width || row < step || row + step >= buffer.height {
        return false;
    }
    let around = [
        (column - step, row),
        (column + step, row),
        (column, row - step),
        (column, row + step),
    ];
    let face = Some(sample.face);
    around
        .iter()
        .all(|(column, row)| buffer.at(*column, *row).map(|other| other.face) == face)
}

/// 0 at `from`, 1 at `to`, smooth between.
fn ramp(value: f64, (from, to): (f64, f64)) -> f64 {
    let t = ((value - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
