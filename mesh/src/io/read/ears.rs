//! Triangles of a flat polygon by cutting off its ears: corners whose triangle is inside the polygon.
//!
//! # Reference
//! G. H. Meisters, "Polygons have ears", American Mathematical Monthly 82, 1975.

use std::collections::VecDeque;

/// A point of the plane.
pub(super) type Flat = [f64; 2];

/// The triangles of a counter-clockwise polygon by its corners. They do not overlap where no two sides cross.
///
/// Corners may lie on sides, and sides may touch, as those of a bridge to a hole. Sides that cross leave corners without an ear, which
/// are cut off as they are.
///
/// # Complexity
/// O(n log n) for polygons whose turning corners are spread along their longer axis, O(n^2) at worst.
pub(super) fn cut_ears(points: &[Flat]) -> Vec<[usize; 3]> {
    let mut polygon = Remaining::new(points);
    let count = points.len();
    let mut triangles = Vec::with_capacity(count.saturating_sub(2));
    // Corners with the number of changes of their neighbours when they were queued. A corner becomes an ear by such a change only.
    let mut queue: VecDeque<(usize, u32)> = (0..count).map(|at| (at, 0)).collect();
    let mut any = 0;
    while triangles.len() + 2 < count {
        let at = match queue.pop_front() {
            Some((at, changes)) if polygon.changes[at] != changes || !polygon.is_ear(at) => {
                continue;
            }
            Some((at, _)) => at,
            None => polygon.convex_after(any),
        };
        let [before, after] = polygon.neighbors[at];
        triangles.push([before, at, after]);
        polygon.remove(at);
        for beside in [before, after] {
            queue.push_back((beside, polygon.changes[beside]));
        }
        any = after;
    }
    triangles
}

/// The corners that have not been cut off.
struct Remaining<'a> {
    points: &'a [Flat],
    /// The corners before and after each.
    neighbors: Vec<[usize; 2]>,
    changes: Vec<u32>,
    /// Whether the corner remains and is not convex. A triangle with any corner inside has such a corner inside.
    may_block: Vec<bool>,
    /// The longer axis, and the corners that once might block with their coordinate along it, ascending.
    axis: usize,
    along: Vec<(f64, usize)>,
}

impl<'a> Remaining<'a> {
    fn new(points: &'a [Flat]) -> Self {
        let count = points.len();
        let extent = |axis: usize| {
            let values = || points.iter().map(|it| it[axis]);
            values().fold(f64::MIN, f64::max) - values().fold(f64::MAX, f64::min)
        };
        let axis = usize::from(extent(1) > extent(0));
        let mut it = Self {
            points,
            neighbors: (0..count)
                .map(|at| [(at + count - 1) % count, (at + 1) % count])
                .collect(),
            changes: vec![0; count],
            may_block: Vec::new(),
            axis,
            along: Vec::new(),
        };
        it.may_block = (0..count).map(|at| !it.is_convex(at)).collect();
        let blocking = (0..count).filter(|at| it.may_block[*at]);
        it.along = blocking.map(|at| (points[at][axis], at)).collect();
        it.along.sort_by(|a, b| a.0.total_cmp(&b.0));
        it
    }

    /// The corner with its neighbours, in order.
    fn triangle(&self, at: usize) -> [Flat; 3] {
        let [before, after] = self.neighbors[at];
        [before, at, after].map(|it| self.points[it])
    }

    fn is_convex(&self, at: usize) -> bool {
        let [a, b, c] = self.triangle(at);
        doubled_area(a, b, c) > 0.0
    }

    /// Whether the triangle of a corner is inside the polygon.
    fn is_ear(&self, at: usize) -> bool {
        if !self.is_convex(at) {
            return false;
        }
        let triangle = self.triangle(at);
        let along = triangle.map(|it| it[self.axis]);
        let low = along.into_iter().fold(f64::MAX, f64::min);
        let high = along.into_iter().fold(f64::MIN, f64::max);
        let first = self.along.partition_point(|(value, _)| *value < low);
        let within = self.along[first..].iter();
        !within
            .take_while(|(value, _)| *value <= high)
            .any(|(_, other)| {
                let point = self.points[*other];
                self.may_block[*other] && !triangle.contains(&point) && is_inside(point, triangle)
            })
    }

    /// The first convex corner after another; the other itself when there is none.
    fn convex_after(&self, start: usize) -> usize {
        let mut at = start;
        loop {
            at = self.neighbors[at][1];
            if at == start || self.is_convex(at) {
                return at;
            }
        }
    }

    fn remove(&mut self, at: usize) {
        let [before, after] = self.neighbors[at];
        self.neighbors[before][1] = after;
        self.neighbors[after][0] = before;
        self.may_block[at] = false;
        for beside in [before, after] {
            self.changes[beside] += 1;
            self.may_block[beside] = !self.is_convex(beside);
        }
    }
}

/// Twice the area of a triangle, counter-clockwise positive.
fn doubled_area(a: Flat, b: Flat, c: Flat) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Whether a point is in a counter-clockwise triangle or on its sides.
fn is_inside(point: Flat, [a, b, c]: [Flat; 3]) -> bool {
    [[a, b], [b, c], [c, a]]
        .into_iter()
        .all(|[from, to]| doubled_area(from, to, point) >= 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[Flat]) -> f64 {
        let sides = (0..points.len()).map(|at| [points[at], points[(at + 1) % points.len()]]);
        sides.map(|[a, b]| 0.5 * (a[0] * b[1] - a[1] * b[0])).sum()
    }

    /// Cuts a polygon whose triangles must all be counter-clockwise and have its area together.
    fn demand_whole(points: &[Flat]) {
        let triangles = cut_ears(points);
        assert_eq!(triangles.len(), points.len() - 2);
        let of_all = triangles.into_iter().map(|it| {
            let [a, b, c] = it.map(|at| points[at]);
            let area = 0.5 * doubled_area(a, b, c);
            assert!(area > 0.0, "{it:?}: {area}");
            area
        });
        let (sum, expected) = (of_all.sum::<f64>(), area(points));
        assert!(
            (sum - expected).abs() < 1e-9 * expected,
            "{sum}: {expected}"
        );
    }

    fn comb(teeth: u32, is_upright: bool) -> Vec<Flat> {
        let width = 2.0 * f64::from(teeth);
        let mut points = vec![[0.0, 0.0], [width, 0.0]];
        for tooth in (0..teeth).rev() {
            let x = 2.0 * f64::from(tooth);
            points.extend([[x + 1.0, 9.0], [x, 1.0]]);
        }
        match is_upright {
            true => points.iter().map(|[x, y]| [-y, *x]).collect(),
            false => points,
        }
    }

    fn star(corners: u32) -> Vec<Flat> {
        let corner = |at: u32| {
            let angle = std::f64::consts::TAU * f64::from(at) / f64::from(corners);
            let radius = 1.0 + 0.5 * f64::from(at % 2);
            [radius * angle.cos(), radius * angle.sin()]
        };
        (0..corners).map(corner).collect()
    }

    #[test]
    fn combs_and_stars_of_any_size_keep_their_area() {
        for corners in [10, 512, 513, 2000] {
            demand_whole(&star(corners));
            demand_whole(&comb(corners / 2, false));
            demand_whole(&comb(corners / 2, true));
        }
    }

    #[test]
    fn a_spiral_keeps_its_area() {
        let arm = |at: i32, width: f64| {
            let angle = 0.1 * f64::from(at);
            let radius = 1.0 + angle + width;
            [radius * angle.cos(), radius * angle.sin()]
        };
        let outside = (0..600).map(|at| arm(at, 1.0));
        demand_whole(
            &outside
                .chain((0..600).rev().map(|at| arm(at, 0.0)))
                .collect::<Vec<_>>(),
        );
    }

    #[test]
    fn corners_on_sides_and_bridges_to_holes_are_kept() {
        // A square with corners on all sides, and an L.
        demand_whole(&[
            [0., 0.],
            [1., 0.],
            [2., 0.],
            [2., 1.],
            [2., 2.],
            [1., 2.],
            [0., 2.],
            [0., 1.],
        ]);
        demand_whole(&[
            [2., 1.],
            [1., 1.],
            [1., 2.],
            [0., 2.],
            [0., 1.],
            [0., 0.],
            [2., 0.],
        ]);
        // A square hole in a square, and a bridge that is passed twice.
        let hole = [[1., 1.], [1., 2.], [2., 2.], [2., 1.], [1., 1.]];
        let square = [[0., 0.], [3., 0.], [3., 3.], [0., 3.], [0., 0.]];
        demand_whole(&[&square[..], &hole].concat());
    }

    #[test]
    fn sides_that_cross_end_all_the_same() {
        let tangle: Vec<Flat> = (0..999_u32)
            .map(|at| [f64::from(at * 7919 % 997), f64::from(at * 104_729 % 991)])
            .collect();
        assert_eq!(cut_ears(&tangle).len(), 997);
        assert_eq!(cut_ears(&[[0.0; 2]; 9]).len(), 7);
    }

    /// A second in all; by least area hours, which needs the cube of the number of corners.
    #[test]
    fn tens_of_thousands_of_corners_keep_their_area() {
        demand_whole(&comb(30_000, false));
        demand_whole(&star(60_000));
    }
}
