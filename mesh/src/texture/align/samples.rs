//! Points on a mesh, and which of them a view sees.

use nalgebra::{Point3, Vector3};

use super::super::depth_buffer::{DepthBuffer, Projection};
use super::super::observe::samples as centroids;
use super::super::types::TextureView;
use crate::TriangleMesh;

/// About as many points lie on a mesh, evenly, besides one on each small triangle.
const POINTS: f64 = 60_000.0;
/// Most points along the side of a triangle.
const MAX_ALONG: usize = 256;
/// Points seen at a flatter angle are left out: cosine of the angle between view and normal.
const LEAST_COSINE: f64 = 0.2;

/// A point on a triangle.
pub(super) struct SurfacePoint {
    pub(super) position: Point3<f64>,
    triangle: u32,
}

/// Points spread evenly over a mesh.
pub(super) fn surface_points(mesh: &TriangleMesh) -> Vec<SurfacePoint> {
    let corners = |triangle: &[u32; 3]| triangle.map(|corner| mesh.positions[corner as usize]);
    let doubled: f64 = mesh
        .triangles
        .iter()
        .map(|triangle| normal(&corners(triangle)).norm())
        .filter(|area| area.is_finite())
        .sum();
    // Points at the centres of n^2 equal parts of a triangle.
    let spacing = (0.5 * doubled / POINTS).sqrt();
    let mut points = Vec::new();
    for (index, triangle) in (0..).zip(&mesh.triangles) {
        let corners = corners(triangle);
        let along = ((0.5 * normal(&corners).norm()).sqrt() / spacing).round();
        if !along.is_finite() {
            continue;
        }
        let along = (along as usize).clamp(1, MAX_ALONG);
        let [a, b, c] = corners.map(|corner| corner.coords);
        points.extend(centroids(along).map(|[u, v, w]| SurfacePoint {
            position: Point3::from(u * a + v * b + w * c),
            triangle: index,
        }));
    }
    points
}

fn normal([a, b, c]: &[Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// The points that a view sees away from outlines, by number.
pub(super) fn seen(
    mesh: &TriangleMesh,
    points: &[SurfacePoint],
    view: &TextureView,
    size: (u32, u32),
) -> Vec<u32> {
    let projection = Projection::new(view);
    let depth = DepthBuffer::new(mesh, &projection, size);
    let eye = Point3::from(view.world_from_camera.translation.vector);
    let sees = |point: &SurfacePoint| {
        let corners = mesh.triangles[point.triangle as usize];
        let corners = corners.map(|corner| mesh.positions[corner as usize]);
        let toward_eye = eye - point.position;
        let normal = normal(&corners);
        let cosine = normal.dot(&toward_eye) / (normal.norm() * toward_eye.norm());
        if cosine.is_nan() || cosine < LEAST_COSINE {
            return false;
        }
        let whole = || {
            let [a, b, c] = corners.map(|corner| projection.project(&corner));
            DepthBuffer::slope(&[a?, b?, c?])
        };
        let around = || DepthBuffer::slope_around(&point.position, &corners, &projection);
        let pixel = projection.project(&point.position);
        pixel
            .zip(whole().or_else(around))
            .is_some_and(|(pixel, slope)| depth.visibility(&pixel, slope) >= 1.0)
    };
    (0..)
        .zip(points)
        .filter_map(|(number, point)| sees(point).then_some(number))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_are_spread_evenly() {
        let position = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let mesh = TriangleMesh {
            positions: vec![
                position(0.0, 0.0),
                position(1.0, 0.0),
                position(1.0, 1.0),
                position(0.0, 1.0),
            ],
            triangles: vec![[0, 1, 2], [0, 2, 3]],
            colors: None,
        };
        let points = surface_points(&mesh);
        let expected = 2 * 173 * 173;
        assert_eq!(points.len(), expected);
        let mean = points
            .iter()
            .map(|it| it.position.coords)
            .sum::<Vector3<f64>>()
            / expected as f64;
        assert!((mean - Vector3::new(0.5, 0.5, 0.0)).norm() < 1e-9, "{mean}");
        let left = points.iter().filter(|it| it.position.x < 0.25).count();
        assert!(left.abs_diff(expected / 4) < expected / 100, "{left}");
    }
}
