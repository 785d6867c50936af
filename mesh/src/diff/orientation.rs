//! Triangles of opposite orientation.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::distances::nearest_corner;
use super::result::{ComparedMesh, MeshLocation};
use crate::Shape;
use crate::evaluate::NearestPointIndex;

/// Counts the triangles of `mesh` with an opposite surface of the other mesh, and none of the same orientation,
/// within `tolerance` of their centre. Also returns the largest of them.
///
/// Triangles lower than twice the tolerance do not count, because their orientation is noise.
pub(super) fn flipped(
    mesh: &Shape,
    on: ComparedMesh,
    other: &NearestPointIndex,
    tolerance: f64,
) -> (usize, Option<MeshLocation>) {
    let Some(scene) = other.scene() else {
        return (0, None);
    };
    // Tolerates rounding when the tolerance is zero.
    let slack = tolerance.max(1e-7 * mesh.diagonal());
    let found: Vec<(u32, f64, MeshLocation)> = mesh
        .triangles
        .par_iter()
        .enumerate()
        .filter_map(|(triangle, corners)| {
            let [a, b, c] = corners.map(|corner| mesh.positions[corner as usize]);
            let cross = (b - a).cross(&(c - a));
            let doubled_area = cross.norm();
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            let height = doubled_area / longest;
            // Also false for triangles without height.
            let is_high = height > 2.0 * slack;
            if !is_high {
                return None;
            }
            let normal: Vector3<f64> = cross / doubled_area;
            let center = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            let nearest = other.nearest(&center)?;
            let is_against = nearest.normal.is_some_and(|other| other.dot(&normal) < 0.0);
            if nearest.distance > slack || !is_against {
                return None;
            }
            // At thin parts, both sides are within reach: searches for a triangle of the same
            // orientation.
            let reach = nearest.distance + slack;
            let start = center + normal * reach;
            let agreeing = scene.cast_where(&start, &-normal, 2.0 * reach, |_, front| front);
            if agreeing.is_some() {
                return None;
            }
            let triangle = triangle as u32;
            let place = MeshLocation {
                on,
                point: center.coords.into(),
                distance: nearest.distance,
                nearest: nearest.point.coords.into(),
                vertex: nearest_corner(mesh, triangle, &center),
                triangle,
            };
            Some((triangle, doubled_area, place))
        })
        .collect();
    let worst = found
        .iter()
        .max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))
        .map(|(_, _, place)| *place);
    (found.len(), worst)
}
