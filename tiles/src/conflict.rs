//! Which points of other tiles are in conflict with a cell.
//!
//! A cell is one of the whole scene when no point is inside its circumsphere (of a ghost cell: outside its hull facet), ties
//! decided as the tetrahedralisation does. Whether a point is inside is the sign of a polynomial `m . q - d |q|^2` in the point
//! relative to a corner: a *separable quadratic*, whose bounds over a box are those of three parabolas. Boxes of points that
//! cannot be in conflict are skipped; points that rounding leaves in doubt are decided exactly.

use linecarve_carving::internals::predicates::{in_sphere_perturbed, orient3d};
use linecarve_carving::{CellId, Tetrahedralization};

use crate::bounds::Bounds;

/// Bound of the rounding errors of the coefficients, relative to products of the edges' lengths in the 1-norm: at most 16
/// operations each, taken four times as large.
const ERROR: f64 = 64.0 * f64::EPSILON;

/// Conflict as a quadratic: positive for points in conflict.
pub(crate) struct Quadratic {
    origin: [f64; 3],
    linear: [f64; 3],
    /// Not negative.
    square: f64,
    linear_error: f64,
    square_error: f64,
}

impl Quadratic {
    /// That of a cell.
    pub(crate) fn of(tetrahedra: &Tetrahedralization, cell: CellId) -> Self {
        let vertices = tetrahedra.cell_vertices(cell);
        let origin = *tetrahedra.coordinates(vertices[0]);
        let edge = |k: usize| minus(tetrahedra.coordinates(vertices[k]), &origin);
        let norm = |e: &[f64; 3]| e.iter().map(|x| x.abs()).sum::<f64>();
        let (e1, e2) = (edge(1), edge(2));
        let (n1, n2) = (norm(&e1), norm(&e2));
        if vertices[3].is_ghost() {
            return Self {
                origin,
                linear: cross(&e1, &e2),
                square: 0.0,
                linear_error: ERROR * n1 * n2,
                square_error: 0.0,
            };
        }
        let e3 = edge(3);
        let volume = n1 * n2 * norm(&e3);
        let normals = [cross(&e2, &e3), cross(&e3, &e1), cross(&e1, &e2)];
        let squares = [e1, e2, e3].map(|e| dot(&e, &e));
        let linear = std::array::from_fn(|k| (0..3).map(|i| squares[i] * normals[i][k]).sum());
        Self {
            origin,
            linear,
            square: dot(&e1, &normals[0]).max(0.0),
            linear_error: ERROR * volume * (n1 + n2 + norm(&e3)),
            square_error: ERROR * volume,
        }
    }

    /// The value at a point, and a bound of its error.
    pub(crate) fn at(&self, point: &[f64; 3]) -> (f64, f64) {
        let q = minus(point, &self.origin);
        let squared = dot(&q, &q);
        let size: f64 = q.iter().map(|x| x.abs()).sum();
        let value = dot(&self.linear, &q) - self.square * squared;
        let error = self.linear_error * size + self.square_error * squared;
        (value, error)
    }

    /// An upper bound of the value and its error over a box.
    pub(crate) fn most(&self, bounds: &Bounds) -> f64 {
        let square = (self.square - self.square_error).max(0.0);
        let along = |k: usize| {
            let low = bounds.low[k] - self.origin[k];
            let high = bounds.high[k] - self.origin[k];
            let linear = self.linear[k];
            let value = |t: f64| linear * t - square * t * t;
            let top = linear / (2.0 * square);
            let inside = (top > low && top < high).then(|| value(top));
            let ends = value(low).max(value(high));
            let size = low.abs().max(high.abs());
            let error = self.linear_error * size + self.square_error * size * size;
            ends.max(inside.unwrap_or(ends)) + error
        };
        (0..3).map(along).sum()
    }
}

/// Whether a point that is no corner is in conflict with a cell; exact.
pub(crate) fn is_in_conflict(
    tetrahedra: &Tetrahedralization,
    cell: CellId,
    point: &[f64; 3],
) -> bool {
    let vertices = tetrahedra.cell_vertices(cell);
    let inner = match vertices[3].is_ghost() {
        false => cell,
        true => {
            let [a, b, c] = [0, 1, 2].map(|k| tetrahedra.coordinates(vertices[k]));
            let side = orient3d(a, b, c, point);
            if side != 0.0 {
                return side > 0.0;
            }
            // In the plane of the facet the finite cell behind it decides.
            tetrahedra.neighbors(cell)[3]
        }
    };
    let [a, b, c, d] = (tetrahedra.cell_vertices(inner)).map(|v| tetrahedra.coordinates(v));
    in_sphere_perturbed(a, b, c, d, point)
}

fn minus(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| a[k] - b[k])
}

fn dot(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]
        #[test]
        fn no_point_in_conflict_is_missed(
            cloud in prop::collection::vec(prop_oneof![
                prop::array::uniform3(-3i32..=3),
                prop::array::uniform3(-100_000i32..=100_000),
            ], 5..14),
            others in prop::collection::vec(prop::array::uniform3(-4i32..=4), 1..20),
            is_far in any::<bool>(),
        ) {
            let place = |p: &[i32; 3]| p.map(|x| f64::from(x) / 7.0 + if is_far { 1e7 } else { 0.0 });
            let points: Vec<_> = cloud.iter().map(|p| place(p).into()).collect();
            let (tetrahedra, _) = Tetrahedralization::from_points(&points).unwrap();
            let taken: Vec<[f64; 3]> = cloud.iter().map(place).collect();
            let others: Vec<[f64; 3]> =
                others.iter().map(place).filter(|p| !taken.contains(p)).collect();
            let bounds = Bounds::of(&others);
            for cell in tetrahedra.cells() {
                let quadratic = Quadratic::of(&tetrahedra, cell);
                for point in &others {
                    let (value, error) = quadratic.at(point);
                    if is_in_conflict(&tetrahedra, cell, point) {
                        prop_assert!(value >= -error, "{value} {error}");
                        prop_assert!(quadratic.most(&bounds) >= 0.0);
                    } else {
                        prop_assert!(value <= error, "{value} {error}");
                    }
                }
            }
        }
    }
}
