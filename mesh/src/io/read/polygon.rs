//! Polygons of files as triangles.

use nalgebra::{Point3, Vector3};

use crate::least_area::LeastArea;

/// Most corners of a polygon that is not taken as a fan: the time grows with their cube.
const MOST_CORNERS: usize = 512;

/// A corner turns the other way if its normal points against that of the polygon by more than this share.
const TURN: f64 = 1e-9;

/// The place of a vertex; not a number if the file has none yet, or none at all.
pub(super) fn position(positions: &[Point3<f64>], vertex: u32) -> Point3<f64> {
    let found = positions.get(vertex as usize);
    found
        .copied()
        .unwrap_or(Point3::from(Vector3::repeat(f64::NAN)))
}

/// The triangles of a polygon by its corners: a fan where it is convex, else without overlaps. `position` gives the place of a corner.
pub(super) fn triangles(count: usize, position: impl Fn(usize) -> Point3<f64>) -> Vec<[usize; 3]> {
    let fan = || (2..count).map(|at| [0, at - 1, at]).collect();
    if !(4..=MOST_CORNERS).contains(&count) {
        return fan();
    }
    let points: Vec<Point3<f64>> = (0..count).map(position).collect();
    if is_convex(&points) {
        return fan();
    }
    let found = LeastArea::of(&points, |_, _| true, |_, _| true);
    found.map_or_else(fan, |found| found.triangles())
}

/// Whether no corner turns against the others. Also true of coordinates that are not finite.
fn is_convex(points: &[Point3<f64>]) -> bool {
    let count = points.len();
    let mut normals = (0..count).map(|at| {
        let [a, b, c] = [at, at + 1, at + 2].map(|at| points[at % count]);
        (b - a).cross(&(c - b))
    });
    // Of the area, by Newell.
    let normal: Vector3<f64> = (1..count - 1)
        .map(|at| (points[at] - points[0]).cross(&(points[at + 1] - points[0])))
        .sum();
    let least = -TURN * normal.norm_squared();
    !normals.any(|corner| corner.dot(&normal) < least)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[[f64; 2]]) -> f64 {
        let lifted = |at: usize| Point3::new(points[at][0], points[at][1], 0.3 * points[at][0]);
        triangles(points.len(), lifted)
            .into_iter()
            .map(|[a, b, c]| {
                let [a, b, c] = [a, b, c].map(|at| points[at]);
                let doubled = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
                assert!(doubled > -1e-12, "a triangle is turned over");
                0.5 * doubled
            })
            .sum()
    }

    #[test]
    fn polygons_that_are_not_convex_do_not_overlap() {
        // An L, from a corner that does not see all others, with a corner on a straight side.
        let l = [
            [2.0, 1.0],
            [1.0, 1.0],
            [1.0, 2.0],
            [0.0, 2.0],
            [0.0, 1.0],
            [0.0, 0.0],
            [2.0, 0.0],
        ];
        assert!((area(&l) - 3.0).abs() < 1e-12);
        // A comb.
        let mut comb = vec![[0.0, 0.0], [9.0, 0.0]];
        for tooth in (0..5).rev() {
            let x = 2.0 * f64::from(tooth);
            comb.extend([[x + 1.0, 3.0], [x + 0.5, 1.0]]);
        }
        let expected: f64 = (0..comb.len())
            .map(|at| {
                let ([ax, ay], [bx, by]) = (comb[at], comb[(at + 1) % comb.len()]);
                0.5 * (ax * by - bx * ay)
            })
            .sum();
        assert!(expected > 0.0 && (area(&comb) - expected).abs() < 1e-9);
    }

    #[test]
    fn convex_ones_and_those_without_places_are_fans() {
        let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
        let place = |at: usize| Point3::new(square[at][0], square[at][1], 0.0);
        assert_eq!(triangles(4, place), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(
            triangles(4, |_| Point3::new(f64::NAN, 0.0, 0.0)),
            [[0, 1, 2], [0, 2, 3]]
        );
        assert_eq!(triangles(4, |_| Point3::origin()), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(triangles(3, place), [[0, 1, 2]]);
    }
}
