//! Adjusts the vertices of a surface to all dense depth that observes them.
//!
//! A landmark is the mean of the few measurements that were associated with it, and the carver moves it only when it is a
//! standard deviation away. The vertices that are exported need not wait: each goes to the least-squares point of the planes that
//! all keyframes measured around it. On a plane the distances are averaged; on an edge or in a corner, where the planes differ, the
//! point lies where they meet.
//!
//! # Reference
//! The quadric of planes is that of Garland and Heckbert, "Surface simplification using quadric error metrics", SIGGRAPH 1997; the
//! weights are Tukey's, as in Holland and Welsch, "Robust regression using iteratively reweighted least-squares", 1977.

use nalgebra::{Matrix3, Point3, Vector3};

use super::surface_points::MeasuredPlane;

/// Planes further away from a carved vertex than this, in standard deviations of the depth along the ray, are those of another surface.
pub(super) const GATE_SIGMAS: f64 = 4.0;
/// Residual, in standard deviations, from which on a plane has no weight.
const TUKEY_SIGMAS: f64 = 3.0;
/// Weight of the vertex's own position, as a share of that of all planes. It keeps vertices in place along the surface.
const PRIOR_SHARE: f64 = 0.05;
/// Iterations of the weights.
const ITERATIONS: usize = 4;

/// Standard deviation with which one view measured a position along its normal: the root of the mean variance of the planes around it; 0
/// without planes.
pub(super) fn spread_of(planes: &[MeasuredPlane]) -> f64 {
    let sum: f64 = planes.iter().map(|plane| plane.variance).sum();
    (sum / planes.len().max(1) as f64).sqrt()
}

/// How far planes around a position lie apart: the lower quartile of their distances from it, which planes of other surfaces hardly change;
/// 0 with fewer than two.
pub(super) fn scatter_of(planes: &mut [MeasuredPlane]) -> f64 {
    if planes.len() < 2 {
        return 0.0;
    }
    planes.sort_unstable_by(|a, b| a.distance.abs().total_cmp(&b.distance.abs()));
    planes[planes.len() / 4].distance.abs()
}

/// The robust least-squares point of planes near `position`.
pub(super) fn adjusted(position: &Point3<f64>, planes: &[MeasuredPlane]) -> Point3<f64> {
    let mut offset = Vector3::zeros();
    for _ in 0..ITERATIONS {
        let mut information = Matrix3::zeros();
        let mut right = Vector3::zeros();
        let mut total = 0.0;
        for plane in planes {
            let residual = plane.distance - plane.normal.dot(&offset);
            let scaled = residual * residual / (TUKEY_SIGMAS * TUKEY_SIGMAS * plane.variance);
            let weight = (1.0 - scaled).max(0.0).powi(2) / plane.variance;
            let weighted = weight * plane.normal.into_inner();
            information += weighted * plane.normal.transpose();
            right += plane.distance * weighted;
            total += weight;
        }
        let prior = Matrix3::from_diagonal_element(PRIOR_SHARE * total);
        // Not positive without a plane of any weight.
        let Some(factors) = (information + prior).cholesky() else {
            break;
        };
        offset = factors.solve(&right);
    }
    position + offset
}

#[cfg(test)]
mod tests {
    use nalgebra::Unit;

    use super::*;

    fn plane(normal: [f64; 3], distance: f64) -> MeasuredPlane {
        MeasuredPlane {
            normal: Unit::new_normalize(normal.into()),
            distance,
            variance: 1e-4,
        }
    }

    #[test]
    fn on_a_plane_distances_are_averaged() {
        let planes = [0.004, 0.006, 0.008].map(|distance| plane([0.0, 0.0, 1.0], distance));
        let moved = adjusted(&Point3::new(1.0, 2.0, 3.0), &planes);
        // Less by the weight of the prior.
        assert!((moved.z - 3.0 - 0.006 / (1.0 + PRIOR_SHARE)).abs() < 1e-4);
        assert_eq!((moved.x, moved.y), (1.0, 2.0));
    }

    #[test]
    fn on_an_edge_the_point_lies_where_the_planes_meet() {
        let planes = [plane([1.0, 0.0, 0.0], 0.01), plane([0.0, 1.0, 0.0], -0.005)];
        let moved = adjusted(&Point3::origin(), &planes);
        let share = 1.0 / (1.0 + 2.0 * PRIOR_SHARE);
        let expected = Point3::new(0.01 * share, -0.005 * share, 0.0);
        assert!((moved - expected).norm() < 1e-4, "{moved}");
    }

    #[test]
    fn a_wrong_plane_has_no_weight() {
        let mut planes = vec![plane([0.0, 0.0, 1.0], 0.002); 4];
        planes.push(plane([0.0, 0.0, 1.0], 0.05));
        let moved = adjusted(&Point3::origin(), &planes);
        assert!((moved.z - 0.002).abs() < 2e-4, "{moved}");
    }

    #[test]
    fn without_a_plane_the_point_stays() {
        let point = Point3::new(1.0, 2.0, 3.0);
        assert_eq!(adjusted(&point, &[]), point);
    }
}
