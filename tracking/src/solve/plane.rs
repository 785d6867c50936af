//! The two motions that explain two views of a plane.

use nalgebra::{Matrix3, SMatrix, SVector, Unit, UnitQuaternion, Vector3};

use super::relative::RayMatch;
use crate::camera::cauchy;

/// Rounds of reweighting of the homography, and their kernel in variances.
const ROUNDS: usize = 8;
const KERNEL: f64 = 9.0;

/// Rotation and direction of translation.
pub(super) type PlaneMotion = (UnitQuaternion<f64>, Unit<Vector3<f64>>);

/// Both motions that a plane, to which most matches belong, leaves open; empty when the homography is a rotation.
///
/// # Reference
/// Ma, Soatto, Kosecka, Sastry, "An invitation to 3-D vision", 2004, section 5.3.3.
pub(super) fn motions_of_plane(matches: &[RayMatch]) -> Vec<PlaneMotion> {
    let Some(h) = homography(matches) else {
        return Vec::new();
    };
    let eigen = h.tr_mul(&h).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    let middle = eigen.eigenvalues[order[1]];
    if middle <= 0.0 {
        return Vec::new();
    }
    let sign = if h.determinant() < 0.0 { -1.0 } else { 1.0 };
    let h = h * (sign / middle.sqrt());
    let value = |at: usize| eigen.eigenvalues[order[at]] / middle;
    let vector = |at: usize| eigen.eigenvectors.column(order[at]).into_owned();
    let (v1, v2, v3) = (vector(0), vector(1), vector(2));
    let (long, short) = ((value(0) - 1.0).max(0.0), (1.0 - value(2)).max(0.0));
    if long + short < 1e-8 {
        return Vec::new();
    }
    [1.0, -1.0]
        .into_iter()
        .filter_map(|side| {
            let across = (v1 * short.sqrt() + v3 * (side * long.sqrt())) / (long + short).sqrt();
            let normal = v2.cross(&across);
            let from = Matrix3::from_columns(&[v2, across, normal]);
            let (to_v2, to_across) = (h * v2, h * across);
            let to = Matrix3::from_columns(&[to_v2, to_across, to_v2.cross(&to_across)]);
            let rotation = to * from.transpose();
            let direction = Unit::try_new((h - rotation) * normal, 1e-9)?;
            Some((UnitQuaternion::from_matrix(&rotation), direction))
        })
        .collect()
}

/// The homography of most matches, by least squares that are reweighted.
fn homography(matches: &[RayMatch]) -> Option<Matrix3<f64>> {
    let mut weights = vec![1.0; matches.len()];
    let mut found = None;
    for _ in 0..ROUNDS {
        let mut normal = SMatrix::<f64, 9, 9>::zeros();
        for (one, weight) in matches.iter().zip(&weights) {
            let (a, b) = (&one.first, &one.second);
            let rows = [
                [
                    -a.x,
                    -a.y,
                    -a.z,
                    0.0,
                    0.0,
                    0.0,
                    b.x * a.x,
                    b.x * a.y,
                    b.x * a.z,
                ],
                [
                    0.0,
                    0.0,
                    0.0,
                    -a.x,
                    -a.y,
                    -a.z,
                    b.y * a.x,
                    b.y * a.y,
                    b.y * a.z,
                ],
            ];
            for row in rows.map(SVector::<f64, 9>::from) {
                normal += *weight * row * row.transpose();
            }
        }
        let eigen = normal.symmetric_eigen();
        let least = eigen.eigenvalues.imin();
        let h = eigen.eigenvectors.column(least);
        let h = Matrix3::from_row_slice(h.as_slice());
        if !h.iter().all(|value| value.is_finite()) {
            return None;
        }
        for (one, weight) in matches.iter().zip(&mut weights) {
            let at = h * one.first;
            let error = if at.z.abs() < 1e-9 {
                f64::INFINITY
            } else {
                (at.xy() / at.z - one.second.xy()).norm_squared() / (one.sigma * one.sigma)
            };
            *weight = cauchy(error.min(1e12), KERNEL).1;
        }
        found = Some(h);
    }
    found
}
