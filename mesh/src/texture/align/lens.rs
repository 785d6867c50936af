//! One step of the distortion that photographs of a camera share, together with their motions.

use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::super::distortion::DistortionGrid;
use super::Photo;
use super::pyramid::Level;
use super::step::{Aligned, Expected, LONGEST_STEP_PX, MOTION, MotionMatrix, MotionVector, Seen};

/// Fewest photographs from which a distortion is estimated: with few, displacements would make up for errors of the mesh.
pub(super) const LEAST_VIEWS: usize = 8;
/// How much an undistorted lens counts, as a share of the number of points.
const UNDISTORTED_SHARE: f64 = 0.001;
/// Standard deviation of displacements, in pixels.
const SHIFT_PX: f64 = 3.0;
/// Standard deviation of the difference between displacements of neighbouring nodes, in pixels.
const NEIGHBOUR_PX: f64 = 1.0;
/// Photographs whose equations of displacements are held at a time.
const AT_A_TIME: usize = 64;
/// Unknowns that the brightness of a point depends on: the motion, and displacements of four nodes.
const LOCAL: usize = MOTION + 8;

/// Sums over the points of a cell of products of their derivatives, and of those with the error.
type CellSums = ([[f64; LOCAL]; LOCAL], [f64; LOCAL]);

/// Equations of the motion of a view.
pub(super) struct MotionEquations {
    normal: MotionMatrix,
    right: MotionVector,
    /// How much displacements count in them, a row for each unknown of the motion.
    mixed: DMatrix<f64>,
    /// Median depth of the points.
    depth: f64,
}

/// Equations of displacements: x and y of each node.
struct ShiftEquations {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    /// Information of a measurement of a pixel, times points for each node.
    unit: f64,
}

impl ShiftEquations {
    fn new(nodes: usize) -> Self {
        Self {
            normal: DMatrix::zeros(2 * nodes, 2 * nodes),
            right: DVector::zeros(2 * nodes),
            unit: 0.0,
        }
    }

    fn add(&mut self, other: &Self) {
        self.normal += &other.normal;
        self.right += &other.right;
        self.unit += other.unit;
    }

    /// The displacements are small, and neighbours have similar ones.
    fn add_expectation(&mut self, now: &DistortionGrid) {
        let information = |deviation: f64| UNDISTORTED_SHARE * self.unit / (deviation * deviation);
        let [own, difference] = [SHIFT_PX, NEIGHBOUR_PX].map(information);
        for axis in 0..2 {
            for node in 0..now.nodes() {
                let at = 2 * node + axis;
                self.normal[(at, at)] += own;
                self.right[at] += own * now.shift(node)[axis];
            }
            for [a, b] in now.neighbours() {
                let error = difference * (now.shift(b)[axis] - now.shift(a)[axis]);
                let [a, b] = [a, b].map(|node| 2 * node + axis);
                self.normal[(a, a)] += difference;
                self.normal[(b, b)] += difference;
                self.normal[(a, b)] -= difference;
                self.normal[(b, a)] -= difference;
                self.right[a] -= error;
                self.right[b] += error;
            }
        }
    }

    /// The step of x and y of each node, at most `longest` pixels.
    fn solved(self, longest: f64) -> Option<DVector<f64>> {
        let mut step = -self.normal.cholesky()?.solve(&self.right);
        let most = step.amax();
        if !most.is_finite() {
            return None;
        }
        step *= f64::min(1.0, longest / most.max(f64::MIN_POSITIVE));
        Some(step)
    }
}

/// Equations of a view, those of displacements without the motion. Adjusts gain and offset; `None` where its points are too few or say too little.
fn equations<'a>(
    aligned: &mut Aligned<'_>,
    level: &Level,
    points: impl Iterator<Item = Expected<'a>>,
) -> Option<(MotionEquations, ShiftEquations)> {
    let (seen, scale) = aligned.fit_brightness(level, points)?;
    let nodes = aligned.distortion.nodes();
    let mut shifts = ShiftEquations::new(nodes);
    shifts.unit = scale * scale * seen.len() as f64 / nodes as f64;
    let mut motion = MotionEquations {
        normal: MotionMatrix::zeros(),
        right: MotionVector::zeros(),
        mixed: DMatrix::zeros(MOTION, 2 * nodes),
        depth: Aligned::median_depth(&seen),
    };
    for (cell, sums) in cell_sums(aligned, &seen, scale).iter().enumerate() {
        add_cell(
            aligned.distortion.corners(cell),
            sums,
            &mut motion,
            &mut shifts,
        );
    }
    aligned.add_given((&mut motion.normal, &mut motion.right), &seen, scale);
    let back = motion.mixed.transpose() * motion.normal.try_inverse()?;
    shifts.normal -= &back * &motion.mixed;
    shifts.right -= back * motion.right;
    Some((motion, shifts))
}

fn cell_sums(aligned: &Aligned<'_>, seen: &[Seen], scale: f64) -> Vec<CellSums> {
    let mut sums = vec![([[0.0; LOCAL]; LOCAL], [0.0; LOCAL]); aligned.distortion.cells()];
    for point in seen {
        let (error, weight) = aligned.error(point, scale);
        let mut local = [0.0; LOCAL];
        local[..MOTION].copy_from_slice(point.derivative.as_slice());
        let shares = point.position.shares.into_iter();
        for (target, share) in local[MOTION..].chunks_exact_mut(2).zip(shares) {
            target[0] = share * point.slopes[0];
            target[1] = share * point.slopes[1];
        }
        let (normal, right) = &mut sums[point.position.cell];
        for (row, target) in normal.iter_mut().enumerate() {
            let weighted = weight * local[row];
            right[row] += weighted * error;
            for (target, value) in target.iter_mut().zip(local) {
                *target += weighted * value;
            }
        }
    }
    sums
}

fn add_cell(
    corners: [usize; 4],
    (normal, right): &CellSums,
    motion: &mut MotionEquations,
    shifts: &mut ShiftEquations,
) {
    let unknown = |at: usize| 2 * corners[at / 2] + at % 2;
    for (row, (products, error)) in normal.iter().zip(right).enumerate() {
        let (with_motion, with_shifts) = products.split_at(MOTION);
        if row < MOTION {
            motion.right[row] += error;
            for (column, value) in with_motion.iter().enumerate() {
                motion.normal[(row, column)] += value;
            }
            for (column, value) in with_shifts.iter().enumerate() {
                motion.mixed[(row, unknown(column))] += value;
            }
        } else {
            let row = unknown(row - MOTION);
            shifts.right[row] += error;
            for (column, value) in with_shifts.iter().enumerate() {
                shifts.normal[(row, unknown(column))] += value;
            }
        }
    }
}

/// Adjusts gains, offsets, motions and distortions by one Gauss-Newton step of robust errors. `expected` gives what the others show of the points of a
/// photograph by its number; `lenses` counts the photographs of each lens.
pub(super) fn step<'a>(
    photos: &mut [Photo<'_>],
    lenses: &[usize],
    level: usize,
    expected: impl Fn(&Photo<'_>, usize) -> Vec<Expected<'a>> + Sync,
) {
    let mut sums: Vec<Option<ShiftEquations>> = lenses.iter().map(|_| None).collect();
    let mut motions = Vec::with_capacity(photos.len());
    for (group, photos) in (0..).zip(photos.chunks_mut(AT_A_TIME)) {
        let one = |(at, photo): (usize, &mut Photo<'_>)| {
            let points = expected(photo, group * AT_A_TIME + at);
            let level = photo.pyramid.level(level);
            equations(&mut photo.aligned, level, points.into_iter())
        };
        let found: Vec<_> = photos.par_iter_mut().enumerate().map(one).collect();
        for (photo, found) in photos.iter_mut().zip(found) {
            photo.fits = found.is_some();
            motions.push(found.map(|(motion, shifts)| {
                let nodes = photo.aligned.distortion.nodes();
                let sum = &mut sums[photo.lens];
                sum.get_or_insert_with(|| ShiftEquations::new(nodes))
                    .add(&shifts);
                motion
            }));
        }
    }
    let steps: Vec<Option<DVector<f64>>> = (0..)
        .zip(sums)
        .map(|(lens, sum)| {
            let photo = photos.iter().find(|photo| photo.lens == lens)?;
            let mut sum = sum.filter(|_| lenses[lens] >= LEAST_VIEWS)?;
            sum.add_expectation(&photo.aligned.distortion);
            sum.solved(LONGEST_STEP_PX * photo.pyramid.level(level).factor)
        })
        .collect();
    for (photo, motion) in photos.iter_mut().zip(motions) {
        let level = photo.pyramid.level(level);
        let mut moved = None;
        if let Some(motion) = motion {
            let mut right = motion.right;
            if let Some(step) = &steps[photo.lens] {
                right += &motion.mixed * step;
            }
            moved = photo
                .aligned
                .advance(level, &motion.normal, &right, motion.depth);
        }
        photo.fits &= moved.is_some();
        if let Some(step) = &steps[photo.lens] {
            photo.aligned.distortion.add(step.as_slice());
        }
    }
}
