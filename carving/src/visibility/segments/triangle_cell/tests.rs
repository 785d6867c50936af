use proptest::prelude::*;

use super::*;
use crate::predicates::are_collinear;

type Weights = [i128; 3];

fn orient(p: [[i128; 3]; 4]) -> i128 {
    let d = |i: usize, k: usize| p[i][k] - p[0][k];
    d(1, 0) * (d(2, 1) * d(3, 2) - d(2, 2) * d(3, 1))
        - d(1, 1) * (d(2, 0) * d(3, 2) - d(2, 2) * d(3, 0))
        + d(1, 2) * (d(2, 0) * d(3, 1) - d(2, 1) * d(3, 0))
}

fn divisor(a: i128, b: i128) -> i128 {
    if b == 0 { a.abs() } else { divisor(b, a % b) }
}

/// Clips the triangle with the cell in barycentric coordinates, which are whole up to a positive factor. An oracle that
/// shares no idea with the code but the orientation. The corners of what is left, and the facet functions on the triangle.
fn clip(triangle: [[i128; 3]; 3], cell: [[i128; 3]; 4]) -> (Vec<Weights>, [Weights; 4]) {
    let functions =
        FACET.map(|[i, j, k]| triangle.map(|corner| orient([cell[i], cell[j], cell[k], corner])));
    let mut polygon: Vec<Weights> = vec![[1, 0, 0], [0, 1, 0], [0, 0, 1]];
    for function in functions {
        let mut clipped = Vec::new();
        for (i, from) in polygon.iter().enumerate() {
            let to = &polygon[(i + 1) % polygon.len()];
            let (f, g) = (at(&function, from), at(&function, to));
            if f >= 0 {
                clipped.push(*from);
            }
            if (f > 0 && g < 0) || (f < 0 && g > 0) {
                let cut: Weights = std::array::from_fn(|k| from[k] * g.abs() + to[k] * f.abs());
                let common = cut.into_iter().fold(0, divisor);
                clipped.push(cut.map(|c| c / common));
            }
        }
        polygon = clipped;
    }
    (polygon, functions)
}

fn at(function: &Weights, point: &Weights) -> i128 {
    (0..3).map(|k| function[k] * point[k]).sum()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, max_global_rejects: 1 << 20, ..Default::default() })]
    #[test]
    fn contact_agrees_with_rational_clipping(
        mut cell in prop::array::uniform4(prop::array::uniform3(0i32..=3)),
        triangle in prop::array::uniform3(prop_oneof![
            3 => prop::array::uniform3(0i32..=3),
            1 => prop::array::uniform3(-3i32..=6),
        ]),
    ) {
        let whole = |p: [i32; 3]| p.map(i128::from);
        let orientation = orient(cell.map(whole));
        prop_assume!(orientation != 0);
        if orientation < 0 {
            cell.swap(0, 1);
        }
        let corners = cell.map(|p| p.map(f64::from));
        let corners = [&corners[0], &corners[1], &corners[2], &corners[3]];
        let ends = triangle.map(|p| p.map(f64::from));
        let ends = [&ends[0], &ends[1], &ends[2]];
        if are_collinear(ends[0], ends[1], ends[2]) {
            prop_assert!(!triangle_meets_cell(ends, corners));
            return Ok(());
        }
        let (polygon, functions) = clip(triangle.map(whole), cell.map(whole));
        let meets = !polygon.is_empty()
            && functions.iter().all(|f| polygon.iter().any(|p| at(f, p) > 0));
        prop_assert_eq!(triangle_meets_cell(ends, corners), meets);
        let relation = relate_cell(&Triangle::new(ends), corners);
        prop_assert_eq!(relation.contact == Contact::Apart, polygon.is_empty());
        for (facet, function) in functions.iter().enumerate() {
            let touches = polygon.iter().any(|corner| at(function, corner) == 0);
            prop_assert!(relation.touched[facet] || !touches, "{facet}");
        }
        let crosses = crate::visibility::segment_cell::crosses_cell(ends[1], ends[2], corners);
        prop_assert!(relation.is_at_segment || !crosses);
        // What is in general position has no touch but at shared ends.
        if relation.is_generic && !meets && !polygon.is_empty() {
            prop_assert!(corners.contains(&ends[1]) || corners.contains(&ends[2]));
        }
    }
}
