//! Errors of triangles against a ground truth.

use nalgebra::Point3;

use super::history::SurfaceHistory;

/// Mean distance of each triangle of a history to the ground truth, as a share of `end` from 0 to 255; clamped.
///
/// `distances` gives the distances of points. They are measured at the three nodes of the quadrature rule of degree 2: corners
/// are measured and would underestimate the error.
pub fn triangle_errors(
    history: &SurfaceHistory,
    end: f64,
    distances: impl FnOnce(&[Point3<f64>]) -> Vec<f64>,
) -> Vec<u8> {
    let nodes = history.triangles().flat_map(|corners| {
        let corners = corners.map(|corner| history.position(corner).coords);
        (0..3).map(move |k| {
            let [a, b, c] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
            Point3::from((a * 4.0 + b + c) / 6.0)
        })
    });
    let nodes: Vec<Point3<f64>> = nodes.collect();
    let distances = distances(&nodes);
    let of_triangles = distances.as_chunks::<3>().0.iter();
    let error = |at_nodes: &[f64; 3]| {
        let sum: f64 = at_nodes.iter().map(|distance| distance.min(end)).sum();
        (255.0 * sum / (3.0 * end)).round() as u8
    };
    of_triangles.map(error).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::page::{Elements, HistoryLimits};
    use linecarve_engine::testing::TestSurface;

    #[test]
    fn errors_are_means_over_the_triangle() {
        let positions = [[0.0; 3], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0]].map(Point3::from);
        let mut surface = TestSurface::default();
        let mut history = SurfaceHistory::new(HistoryLimits::default());
        history.note(&surface.change_to(&[[0, 1, 2]], &positions));
        history.record(0, |v| surface.position(v), 3, Elements::default());
        // The mean of x over the triangle is 1.
        let along_x = |points: &[Point3<f64>]| points.iter().map(|point| point.x).collect();
        assert_eq!(triangle_errors(&history, 10.0, along_x), [26]);
        let far = |points: &[Point3<f64>]| vec![f64::INFINITY; points.len()];
        assert_eq!(triangle_errors(&history, 10.0, far), [255]);
    }
}
