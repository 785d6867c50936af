use proptest::prelude::*;

use super::*;

/// Exact orientation of integer points by expansion along the difference vectors.
fn orient_exact(p: &[[i64; 3]; 4]) -> i128 {
    let d = |i: usize, k: usize| i128::from(p[i][k]) - i128::from(p[0][k]);
    let minor = |k: usize, l: usize| d(2, k) * d(3, l) - d(2, l) * d(3, k);
    d(1, 0) * minor(1, 2) - d(1, 1) * minor(0, 2) + d(1, 2) * minor(0, 1)
}

/// Exact in-sphere determinant of integer points, positive inside for positive tetrahedra.
fn in_sphere_exact(p: &[[i64; 3]; 5]) -> i128 {
    let d = |i: usize, k: usize| i128::from(p[i][k]) - i128::from(p[4][k]);
    let lift = |i: usize| (0..3).map(|k| d(i, k) * d(i, k)).sum::<i128>();
    let det3 = |i: usize, j: usize, k: usize| {
        d(i, 0) * (d(j, 1) * d(k, 2) - d(j, 2) * d(k, 1))
            - d(i, 1) * (d(j, 0) * d(k, 2) - d(j, 2) * d(k, 0))
            + d(i, 2) * (d(j, 0) * d(k, 1) - d(j, 1) * d(k, 0))
    };
    lift(0) * det3(1, 2, 3) - lift(1) * det3(0, 2, 3) + lift(2) * det3(0, 1, 3)
        - lift(3) * det3(0, 1, 2)
}

fn sign(x: f64) -> i128 {
    i128::from((x > 0.0) as i8) - i128::from((x < 0.0) as i8)
}

/// Integer points scaled and shifted so that rounding matters; both operations are exact.
fn shifted(p: [i64; 3], offset: i64) -> [f64; 3] {
    p.map(|c| (c + offset) as f64 / 1024.0)
}

fn point() -> impl Strategy<Value = [i64; 3]> {
    prop_oneof![
        prop::array::uniform3(-3i64..=3),
        prop::array::uniform3(-(1i64 << 20)..=(1 << 20)),
        (prop::array::uniform3(-3i64..=3), 0u32..18).prop_map(|(p, shift)| p.map(|c| c << shift)),
    ]
}

#[test]
fn the_unit_corner_is_positive_and_its_centre_inside() {
    let (o, x, y, z) = ([0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    assert!(orient3d(&o, &x, &y, &z) > 0.0);
    assert!(orient3d(&x, &o, &y, &z) < 0.0);
    assert!(in_sphere(&o, &x, &y, &z, &[0.5, 0.5, 0.5]) > 0.0);
    assert!(in_sphere(&o, &x, &y, &z, &[1.5, 0.5, 0.5]) < 0.0);
    assert_eq!(in_sphere(&o, &x, &y, &z, &[1.0, 1.0, 1.0]), 0.0);
}

#[test]
fn collinearity_is_exact() {
    let [a, b] = [[0.1, 0.2, 0.3], [0.2, 0.4, 0.6]];
    assert!(are_collinear(&a, &b, &[0.4, 0.8, 1.2]));
    assert!(!are_collinear(
        &a,
        &b,
        &[0.4, 0.8, f64::from_bits(1.2f64.to_bits() + 1)]
    ));
}

proptest! {
    #[test]
    fn orientation_agrees_with_integers(p in prop::array::uniform4(point()), far in any::<bool>()) {
        let offset = if far { 10_240_000_000 } else { 0 };
        let [a, b, c, d] = p.map(|p| shifted(p, offset));
        prop_assert_eq!(sign(orient3d(&a, &b, &c, &d)), orient_exact(&p).signum());
    }

    #[test]
    fn in_sphere_agrees_with_integers(p in prop::array::uniform5(point()), far in any::<bool>()) {
        let offset = if far { 10_240_000_000 } else { 0 };
        let [a, b, c, d, e] = p.map(|p| shifted(p, offset));
        prop_assert_eq!(sign(in_sphere(&a, &b, &c, &d, &e)), in_sphere_exact(&p).signum());
    }

    /// The perturbed answer is a function of the five points alone: an even renumbering of the
    /// tetrahedron leaves it as it is.
    #[test]
    fn perturbed_side_ignores_numbering(p in prop::array::uniform5(prop::array::uniform3(0i64..=2))) {
        let orientation = orient_exact(&[p[0], p[1], p[2], p[3]]);
        prop_assume!(orientation != 0 && !p[..4].contains(&p[4]));
        let [a, mut b, mut c, d, e] = p.map(|p| shifted(p, 0));
        if orientation < 0 {
            std::mem::swap(&mut b, &mut c);
        }
        let side = in_sphere_perturbed(&a, &b, &c, &d, &e);
        for [p, q, r, s] in [[&b, &c, &a, &d], [&b, &a, &d, &c], [&d, &a, &c, &b]] {
            prop_assert_eq!(side, in_sphere_perturbed(p, q, r, s, &e));
        }
    }
}
