//! Rigid alignment of two point sets.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The motion that maps the first points of pairs to the second with the least sum of squared distances; `None` for fewer than
/// three pairs, or collinear points.
///
/// # Reference
/// Arun, Huang, Blostein, "Least-squares fitting of two 3-D point sets", PAMI 1987; sign as in Umeyama, PAMI 1991.
pub(crate) fn align_points(pairs: &[[Point3<f64>; 2]]) -> Option<Isometry3<f64>> {
    if pairs.len() < 3 {
        return None;
    }
    let count = pairs.len() as f64;
    let mean = |side: usize| -> Vector3<f64> {
        pairs
            .iter()
            .map(|pair| pair[side].coords)
            .sum::<Vector3<f64>>()
            / count
    };
    let (from, to) = (mean(0), mean(1));
    let mut covariance = Matrix3::zeros();
    for pair in pairs {
        covariance += (pair[1].coords - to) * (pair[0].coords - from).transpose();
    }
    let svd = covariance.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let mut values = svd.singular_values;
    values.as_mut_slice().sort_by(|a, b| b.total_cmp(a));
    if values[1].is_nan() || values[1] <= 1e-9 * values[0] {
        return None;
    }
    let smallest = svd.singular_values.imin();
    let mut signs = Vector3::repeat(1.0);
    if (u.determinant() * v_t.determinant()) < 0.0 {
        signs[smallest] = -1.0;
    }
    let rotation = u * Matrix3::from_diagonal(&signs) * v_t;
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    let translation = Translation3::from(to - rotation * from);
    let motion = Isometry3::from_parts(translation, rotation);
    motion
        .to_homogeneous()
        .iter()
        .all(|x| x.is_finite())
        .then_some(motion)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_is_found_again() {
        let motion = Isometry3::new(Vector3::new(1.0, -2.0, 0.5), Vector3::new(0.4, 1.9, -0.7));
        let points = [
            Point3::new(0.0, 0.0, 1.0),
            Point3::new(1.0, 0.2, 2.0),
            Point3::new(-0.4, 1.0, 1.5),
        ];
        let pairs = points.map(|point| [point, motion * point]);
        let found = align_points(&pairs).unwrap();
        assert!((found.to_homogeneous() - motion.to_homogeneous()).norm() < 1e-9);
        let line = [0.0, 1.0, 2.0].map(|x| [Point3::new(x, 0.0, 1.0), Point3::new(x, 0.0, 1.0)]);
        assert!(align_points(&line).is_none());
        assert!(align_points(&pairs[..2]).is_none());
    }
}
