//! Polygons of files as triangles.

use nalgebra::{Point3, Vector3};

use super::ears::{Flat, cut_ears};

/// A corner turns the other way if the sine of its angle is below the negative of this.
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
    if count < 4 {
        return fan();
    }
    let points: Vec<Point3<f64>> = (0..count).map(position).collect();
    let normal = normal(&points);
    if is_convex(&points, &normal) {
        return fan();
    }
    cut_ears(&flattened(&points, &normal))
}

/// A normal of the polygon with twice its area as length, by Newell.
fn normal(points: &[Point3<f64>]) -> Vector3<f64> {
    (1..points.len() - 1)
        .map(|at| (points[at] - points[0]).cross(&(points[at + 1] - points[0])))
        .sum()
}

/// Whether no corner turns against the others. Also true of coordinates that are not finite.
fn is_convex(points: &[Point3<f64>], normal: &Vector3<f64>) -> bool {
    let count = points.len();
    let length = normal.norm();
    let is_against = |at: usize| {
        let [a, b, c] = [at, at + 1, at + 2].map(|at| points[at % count]);
        let (before, after) = (b - a, c - b);
        let least = -TURN * before.norm() * after.norm() * length;
        before.cross(&after).dot(normal) < least
    };
    !(0..count).any(is_against)
}

/// The polygon along the axis nearest to its normal, counter-clockwise. No coordinate is multiplied, so sides along an axis remain so.
fn flattened(points: &[Point3<f64>], normal: &Vector3<f64>) -> Vec<Flat> {
    let axis = normal.iamax();
    let [mut x, mut y] = [(axis + 1) % 3, (axis + 2) % 3];
    if normal[axis] < 0.0 {
        std::mem::swap(&mut x, &mut y);
    }
    let offsets = points.iter().map(|it| it - points[0]);
    offsets.map(|it| [it[x], it[y]]).collect()
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
