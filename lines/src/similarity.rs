//! Least-squares similarity between corresponding points.

use nalgebra::{Matrix3, Point3, Rotation3, Similarity3, UnitQuaternion, Vector3};

/// The transform T, similarity or rigid, that minimises the sum of squared distances between `T * from[i]` and
/// `to[i]`.
///
/// `None` for fewer than three pairs, and when the points of either list are collinear or equal.
///
/// # Reference
/// S. Umeyama, *Least-squares estimation of transformation parameters between two point patterns*, PAMI 13(4), 1991,
/// equations 40 to 42.
pub fn fit_similarity(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    with_scale: bool,
) -> Option<Similarity3<f64>> {
    if from.len() != to.len() || from.len() < 3 {
        return None;
    }
    let count = from.len() as f64;
    let mean =
        |points: &[Point3<f64>]| points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
    let (mean_from, mean_to) = (mean(from), mean(to));
    let mut covariance = Matrix3::zeros();
    let mut spread = 0.0;
    for (a, b) in from.iter().zip(to) {
        let (a, b) = (a.coords - mean_from, b.coords - mean_to);
        covariance += b * a.transpose();
        spread += a.norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (u, v_transposed) = (svd.u?, svd.v_t?);
    let singular = svd.singular_values;
    // The second singular value fixes the rotation about the first direction; rounding residue does not count.
    let is_determined = singular[1] > 1e-9 * singular[0] && singular[0].is_finite();
    if !is_determined {
        return None;
    }
    let handedness = if u.determinant() * v_transposed.determinant() < 0.0 {
        -1.0
    } else {
        1.0
    };
    let signs = Vector3::new(1.0, 1.0, handedness);
    let rotation = u * Matrix3::from_diagonal(&signs) * v_transposed;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let scale = if with_scale {
        singular.dot(&signs) / spread
    } else {
        1.0
    };
    if !(scale > 0.0 && scale.is_finite()) {
        return None;
    }
    let translation = mean_to - rotation * mean_from * scale;
    Some(Similarity3::from_parts(translation.into(), rotation, scale))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn coordinate() -> impl Strategy<Value = f64> {
        -10.0..10.0_f64
    }

    proptest! {
        #[test]
        fn a_similarity_is_found_again(
            points in prop::collection::vec([coordinate(), coordinate(), coordinate()], 4..30),
            axis in [coordinate(), coordinate(), coordinate()],
            shift in [coordinate(), coordinate(), coordinate()],
            scale in 0.01..100.0_f64,
        ) {
            let from: Vec<_> = points.into_iter().map(Point3::from).collect();
            let given = Similarity3::new(Vector3::from(shift), Vector3::from(axis), scale);
            let to: Vec<_> = from.iter().map(|p| given * p).collect();
            if let Some(found) = fit_similarity(&from, &to, true) {
                for (a, b) in from.iter().zip(&to) {
                    prop_assert!((found * a - b).norm() < 1e-6 * scale);
                }
            }
        }
    }

    #[test]
    fn a_flat_pattern_is_enough_and_a_line_is_not() {
        let square = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
        ]
        .map(Point3::from);
        let turned: Vec<_> = square
            .iter()
            .map(|p| Point3::new(5.0, 2.0 * p.x, 2.0 * p.y))
            .collect();
        let found = fit_similarity(&square, &turned, true).unwrap();
        assert!((found.scaling() - 2.0).abs() < 1e-12);
        for (a, b) in square.iter().zip(&turned) {
            assert!((found * a - b).norm() < 1e-12);
        }
        let rigid = fit_similarity(&square, &turned, false).unwrap();
        assert_eq!(rigid.scaling(), 1.0);
        let line: Vec<_> = (0..5)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .collect();
        assert!(fit_similarity(&line, &line, true).is_none());
        assert!(fit_similarity(&square[..2], &turned[..2], true).is_none());
        let same = [Point3::origin(); 4];
        assert!(fit_similarity(&same, &same, true).is_none());
    }
}
