//! Errors of triangles against a ground truth.

use nalgebra::Point3;
use rayon::prelude::*;

use super::history::SurfaceHistory;

/// Mean distance of each triangle of a history to the ground truth, as a share of `end` from 0 to 255; clamped.
///
/// `distance` gives the distance of a point. It is evaluated at the three nodes of the quadrature rule of degree 2: corners
/// are measured and would underestimate the error. Runs in parallel, with the same result for any number of threads.
pub fn triangle_errors(
    history: &SurfaceHistory,
    end: f64,
    distance: &(dyn Fn(&Point3<f64>) -> f64 + Sync),
) -> Vec<u8> {
    let triangles: Vec<[u32; 3]> = history.triangles().collect();
    let positions = history.positions();
    triangles
        .par_iter()
        .map(|corners| {
            let corners = corners.map(|corner| positions[corner as usize].coords);
            let sum: f64 = (0..3)
                .map(|k| {
                    let [a, b, c] = [corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]];
                    let point = Point3::from((a * 4.0 + b + c) / 6.0);
                    distance(&point).min(end)
                })
                .sum();
            // The cast turns NaN into 0; such a triangle is not drawn.
            (255.0 * sum / (3.0 * end)).round() as u8
        })
        .collect()
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
        assert_eq!(triangle_errors(&history, 10.0, &|point| point.x), [26]);
        assert_eq!(triangle_errors(&history, 10.0, &|_| f64::INFINITY), [255]);
    }
}
