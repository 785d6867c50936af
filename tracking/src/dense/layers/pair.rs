//! Distances of the points of one layer from the planes of another, and their normal equations.

use linecarve_lines::upper_median;
use nalgebra::{Isometry3, Matrix3, SMatrix, SVector, Vector3};

use super::layer::{LayerPlacement, PlacedSurface};

/// Unknowns of a layer: motion of its camera in its own frame (translation, rotation), logarithm of the scale, shift of the inverse
/// depth, shift of the depth.
pub(super) const UNKNOWNS: usize = 9;
const BOTH: usize = 2 * UNKNOWNS;

/// Every so many pixels along either axis are compared.
const STRIDE: usize = 3;

/// Cosine of the largest angle between the planes of two pixels that are the same surface.
const MIN_NORMAL_COSINE: f32 = 0.85;

/// Scale of Cauchy's kernel in standard deviations.
const ROBUST_SIGMAS: f32 = 2.5;

/// Fewest pixels that say anything about a pair.
const MIN_PIXELS: usize = 60;

/// Normal equations of a pair: first the unknowns of its first layer, then those of its second one.
pub(super) struct PairEquations {
    pub(super) normal: SMatrix<f64, BOTH, BOTH>,
    pub(super) gradient: SVector<f64, BOTH>,
    /// Median absolute distance, in standard deviations.
    pub(super) median: f32,
}

/// A pixel of one layer at the plane of a pixel of another one.
struct Match<'a> {
    /// Point of the first layer, in the frame of either camera.
    from_point: &'a Vector3<f32>,
    to_point: Vector3<f32>,
    /// Plane of the second layer.
    plane: &'a Vector3<f32>,
    /// Depth of the second layer at the pixel.
    to_depth: f32,
    /// Distance from the plane, as a share of the depth.
    distance: f32,
    /// Variance of the distance by the noise of both depths.
    variance: f32,
}

/// Calls `take` for each compared pixel of `from` whose distance from `to` is within the gate, a share of the depth.
fn for_each_match(
    from: &PlacedSurface<'_>,
    to: &PlacedSurface<'_>,
    to_from: &Isometry3<f64>,
    gate: f32,
    mut take: impl FnMut(&Match<'_>),
) {
    let rotation: Matrix3<f32> = to_from.rotation.to_rotation_matrix().matrix().cast();
    let shift: Vector3<f32> = to_from.translation.vector.cast();
    let (width, height) = (from.surface.width, from.surface.height);
    for y in (STRIDE / 2..height).step_by(STRIDE) {
        for x in (STRIDE / 2..width).step_by(STRIDE) {
            let at = y * width + x;
            let own = &from.planes[at];
            if *own == Vector3::zeros() {
                continue;
            }
            let from_point = &from.points[at];
            let to_point = rotation * from_point + shift;
            let Some(there) = to.surface.pixel_of(&to_point) else {
                continue;
            };
            let plane = &to.planes[there];
            let distance = 1.0 - plane.dot(&to_point);
            let turned = rotation * own;
            let cosine = turned.dot(plane);
            let bound = MIN_NORMAL_COSINE
                * MIN_NORMAL_COSINE
                * turned.norm_squared()
                * plane.norm_squared();
            // False for a plane of zeros, and for NaN.
            if distance.abs() <= gate && cosine > 0.0 && cosine * cosine >= bound {
                take(&Match {
                    from_point,
                    to_point,
                    plane,
                    to_depth: to.points[there].z,
                    distance,
                    variance: from.surface.variances[at] + to.surface.variances[there],
                });
            }
        }
    }
}

/// Distances between two layers: the median of their absolute values as a share of the depth, and what noise alone would make of it.
/// `None` when they have too little in common.
pub(super) fn disagreement(
    [from, to]: [&PlacedSurface<'_>; 2],
    [from_placement, to_placement]: [&LayerPlacement; 2],
    gate: f32,
) -> Option<[f32; 2]> {
    let to_from = to_placement
        .world_from_camera
        .inv_mul(&from_placement.world_from_camera);
    let (mut distances, mut variances) = (Vec::new(), Vec::new());
    let mut take = |found: &Match<'_>| {
        distances.push(found.distance.abs());
        variances.push(found.variance);
    };
    for_each_match(from, to, &to_from, gate, &mut take);
    for_each_match(to, from, &to_from.inverse(), gate, &mut take);
    if distances.len() < MIN_PIXELS {
        return None;
    }
    let noise = MEDIAN_OVER_SIGMA * upper_median(&mut variances, f32::total_cmp)?.sqrt();
    Some([upper_median(&mut distances, f32::total_cmp)?, noise])
}

/// Median of the absolute value of a normal distribution over its standard deviation.
pub(super) const MEDIAN_OVER_SIGMA: f32 = 0.6745;

/// Normal equations of the distances between two layers; `None` when they have too little in common. `noise` is the standard deviation of
/// distances in those expected.
pub(super) fn equations(
    [from, to]: [&PlacedSurface<'_>; 2],
    [from_placement, to_placement]: [&LayerPlacement; 2],
    gate: f32,
    noise: f32,
) -> Option<PairEquations> {
    let to_from = to_placement
        .world_from_camera
        .inv_mul(&from_placement.world_from_camera);
    let mut equations = PairEquations {
        normal: SMatrix::zeros(),
        gradient: SVector::zeros(),
        median: 0.0,
    };
    let mut sizes = Vec::new();
    let placements = [from_placement, to_placement];
    for_each_match(from, to, &to_from, gate, |found| {
        sizes.push(equations.add(found, &to_from, placements, [0, UNKNOWNS], noise));
    });
    for_each_match(to, from, &to_from.inverse(), gate, |found| {
        let placements = [placements[1], placements[0]];
        sizes.push(equations.add(found, &to_from.inverse(), placements, [UNKNOWNS, 0], noise));
    });
    if sizes.len() < MIN_PIXELS {
        return None;
    }
    // The bias of depth is that of the whole image: a pair says as much as one pixel, with the error that distances are seen to have.
    let share = 1.0 / (sizes.len() as f64 * f64::from(noise * noise));
    equations.normal *= share;
    equations.gradient *= share;
    equations.median = upper_median(&mut sizes, f32::total_cmp)?;
    equations.normal.fill_upper_triangle_with_lower_triangle();
    Some(equations)
}

impl PairEquations {
    /// Adds a distance; `offsets` are the first unknowns of both layers. Returns its absolute value in standard deviations.
    fn add(
        &mut self,
        found: &Match<'_>,
        to_from: &Isometry3<f64>,
        [from, to]: [&LayerPlacement; 2],
        [from_offset, to_offset]: [usize; 2],
        noise: f32,
    ) -> f32 {
        let scaled = found.distance / found.variance.sqrt();
        let robust = scaled / (ROBUST_SIGMAS * noise);
        let weight = f64::from(1.0 / ((1.0 + robust * robust) * found.variance));
        let plane: Vector3<f64> = found.plane.cast();
        let (p, y): (Vector3<f64>, Vector3<f64>) = (found.from_point.cast(), found.to_point.cast());
        let mut row = [0.0; BOTH];
        let mut set = |at: usize, values: &Vector3<f64>| {
            row[at..at + 3].copy_from_slice(values.as_slice());
        };
        // The plane in the frame of the first camera, along which its point moves.
        let turned = to_from.rotation.inverse_transform_vector(&plane);
        set(from_offset, &-turned);
        set(from_offset + 3, &-p.cross(&turned));
        set(to_offset, &plane);
        set(to_offset + 3, &y.cross(&plane));
        let along = turned.dot(&p) / p.z;
        let (from_z, to_z) = (given_depth(from, p.z), f64::from(found.to_depth));
        let by_from = from.depth.derivatives(from_z);
        let by_to = to.depth.derivatives(given_depth(to, to_z));
        for k in 0..3 {
            row[from_offset + 6 + k] = -along * by_from[k];
            row[to_offset + 6 + k] = y.z / (to_z * to_z) * by_to[k];
        }
        for i in 0..BOTH {
            let weighted = weight * row[i];
            self.gradient[i] += weighted * f64::from(found.distance);
            for (j, value) in row.iter().enumerate().take(i + 1) {
                self.normal[(i, j)] += weighted * value;
            }
        }
        scaled.abs()
    }
}

/// The depth that a placement corrected to `z`.
fn given_depth(placement: &LayerPlacement, z: f64) -> f64 {
    let depth = &placement.depth;
    1.0 / (depth.scale / (z - depth.shift) - depth.inverse_shift)
}
