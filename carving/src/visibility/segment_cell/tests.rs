use proptest::prelude::*;

use super::*;

fn exact_orient(p: [[i128; 3]; 4]) -> i128 {
    let d = |i: usize, k: usize| p[i][k] - p[0][k];
    d(1, 0) * (d(2, 1) * d(3, 2) - d(2, 2) * d(3, 1))
        - d(1, 1) * (d(2, 0) * d(3, 2) - d(2, 2) * d(3, 0))
        + d(1, 2) * (d(2, 0) * d(3, 1) - d(2, 1) * d(3, 0))
}

/// The interval of t in which the segment is inside, as fractions, by clipping with rational numbers: an oracle that
/// shares nothing with the code but the orientation.
fn clip(
    center: [i128; 3],
    target: [i128; 3],
    cell: [[i128; 3]; 4],
) -> Option<((i128, i128), (i128, i128))> {
    let (mut low, mut high) = ((0i128, 1i128), (1i128, 1i128));
    let less = |a: (i128, i128), b: (i128, i128)| a.0 * b.1 < b.0 * a.1;
    for facet in FACET {
        let f = |x: [i128; 3]| exact_orient([cell[facet[0]], cell[facet[1]], cell[facet[2]], x]);
        let (a, b) = (f(target), f(center));
        // f(t) = a + t (b - a) >= 0
        if a == b {
            if a < 0 {
                return None;
            }
        } else if b > a {
            let t = (-a, b - a);
            if less(low, t) {
                low = t;
            }
        } else {
            let t = (a, a - b);
            if less(t, high) {
                high = t;
            }
        }
    }
    (!less(high, low)).then_some((low, high))
}

/// Whether the middle of the clipped interval is strictly inside.
fn crosses_by_clipping(center: [i128; 3], target: [i128; 3], cell: [[i128; 3]; 4]) -> bool {
    let Some((low, high)) = clip(center, target, cell) else {
        return false;
    };
    // t = n / d, the mean of both ends.
    let (n, d) = (low.0 * high.1 + high.0 * low.1, 2 * low.1 * high.1);
    FACET.iter().all(|facet| {
        let f = |x: [i128; 3]| exact_orient([cell[facet[0]], cell[facet[1]], cell[facet[2]], x]);
        f(target) * d + n * (f(center) - f(target)) > 0
    })
}

fn float(p: [i32; 3]) -> [f64; 3] {
    p.map(f64::from)
}

fn whole(p: [i32; 3]) -> [i128; 3] {
    p.map(i128::from)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 20_000, max_global_rejects: 1 << 20, ..Default::default() })]
    #[test]
    fn crossing_and_touching_agree_with_rational_clipping(
        mut p in prop::array::uniform4(prop::array::uniform3(0i32..=3)),
        ends in prop::array::uniform2(prop_oneof![
            3 => prop::array::uniform3(0i32..=3),
            1 => prop::array::uniform3(-2i32..=5),
        ]),
    ) {
        let orientation = exact_orient(p.map(whole));
        prop_assume!(orientation != 0 && ends[0] != ends[1]);
        if orientation < 0 {
            p.swap(0, 1);
        }
        let [center, target] = ends.map(float);
        let corners = p.map(float);
        let cell = [&corners[0], &corners[1], &corners[2], &corners[3]];
        let integers = p.map(whole);
        let [c, t] = ends.map(whole);
        prop_assert_eq!(crosses_cell(&center, &target, cell), crosses_by_clipping(c, t, integers));
        let clipped = clip(c, t, integers);
        prop_assert_eq!(
            relate(&center, &target, cell),
            match clipped {
                None => Relation::Apart,
                Some(_) if crosses_by_clipping(c, t, integers) => Relation::Crosses,
                Some((low, high)) if low.0 * high.1 < high.0 * low.1 => {
                    let facets = FACET.map(|facet| {
                        let [i, j, k] = facet.map(|k| integers[k]);
                        [c, t].iter().all(|end| exact_orient([i, j, k, *end]) == 0)
                    });
                    Relation::RunsInBoundary { facets }
                }
                Some(_) => Relation::Touches,
            }
        );
        // The same for the facets seen as a hull: outside of facet i is where its function is negative.
        for (i, facet) in FACET.iter().enumerate() {
            let [a, b, c3] = facet.map(|k| cell[k]);
            let f = |x| exact_orient([integers[facet[0]], integers[facet[1]], integers[facet[2]], x]);
            if f(t) < 0 {
                continue;
            }
            let hit = f(c) < 0 && {
                // Where the segment meets the plane, t = f(target) / (f(target) - f(center)).
                let (n, d) = (f(t), f(t) - f(c));
                FACET.iter().enumerate().filter(|(j, _)| *j != i).all(|(_, other)| {
                    let g = |x| exact_orient([integers[other[0]], integers[other[1]], integers[other[2]], x]);
                    g(t) * d + n * (g(c) - g(t)) >= 0
                })
            };
            // A ghost cell's facet turns counter-clockwise seen from outside.
            prop_assert_eq!(crosses_ghost(&center, &target, [a, c3, b]), hit);
        }
    }
}

#[test]
fn rays_in_facets_and_along_edges_cross_nothing() {
    let [o, x, y, z] = [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let cell = [&o, &x, &y, &z];
    assert!(!crosses_cell(&x, &o, cell));
    assert!(!crosses_cell(&[2.0, 0.0, 0.0], &o, cell));
    assert!(!crosses_cell(&[0.25, 0.25, 0.0], &o, cell));
    assert!(!crosses_cell(&[0.25, 0.25, 0.0], &[0.3, 0.3, -1.0], cell));
    assert!(crosses_cell(&[0.25, 0.25, 0.0], &[0.3, 0.3, 1.0], cell));
    assert!(crosses_cell(&[0.2, 0.2, 0.2], &[0.2, 0.2, 0.3], cell));
    assert!(crosses_cell(&[1.0, 1.0, 1.0], &o, cell));
    assert!(!crosses_cell(&[-1.0, -1.0, -1.0], &o, cell));
}
