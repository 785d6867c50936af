//! Rigid transforms from the matrices and quaternions of files.

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector3};

/// Largest deviation of a 3x3 block from a rotation that counts as rounding. Six-digit files deviate by 1e-6, poses
/// accumulated in single precision by 1e-3; a scale or a shear deviates by more than this.
const ROTATION_TOLERANCE: f64 = 0.02;

/// Why a matrix or quaternion is not a rigid transform.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RigidTransformError {
    /// A number is NaN or infinite.
    #[error("has numbers that are not finite")]
    NotFinite,
    /// The 3x3 block is not a rotation.
    #[error(
        "is not a rotation and a translation (its 3x3 block deviates from a rotation by {deviation:.3})"
    )]
    NotRotation {
        /// Largest deviation of the block times its transpose from the identity, halved.
        deviation: f64,
    },
    /// The 3x3 block is a reflection.
    #[error("is a reflection (its 3x3 block has a negative determinant)")]
    Reflection,
    /// The last row is not 0 0 0 1: the matrix is projective or transposed.
    #[error("has the last row [{0}, {1}, {2}, {3}] instead of [0, 0, 0, 1] (transposed?)", row[0], row[1], row[2], row[3])]
    LastRow {
        /// The last row.
        row: [f64; 4],
    },
    /// The quaternion is not of unit length.
    #[error("has a quaternion of length {length} instead of 1")]
    Quaternion {
        /// Its length.
        length: f64,
    },
}

/// The rigid transform nearest to a row-major 4x4 matrix.
///
/// # Errors
/// If the matrix is far from a rigid transform.
pub fn from_matrix(rows: &[[f64; 4]; 4]) -> Result<Isometry3<f64>, RigidTransformError> {
    if rows.iter().flatten().any(|value| !value.is_finite()) {
        return Err(RigidTransformError::NotFinite);
    }
    let last_row_misses = |(value, expected): (&f64, f64)| (value - expected).abs() > 1e-6;
    if rows[3]
        .iter()
        .zip([0.0, 0.0, 0.0, 1.0])
        .any(last_row_misses)
    {
        return Err(RigidTransformError::LastRow { row: rows[3] });
    }
    let block = Matrix3::from_fn(|r, c| rows[r][c]);
    let translation = Translation3::new(rows[0][3], rows[1][3], rows[2][3]);
    Ok(Isometry3::from_parts(
        translation,
        nearest_rotation(&block)?,
    ))
}

/// The rotation nearest to a matrix in the Frobenius norm, by singular value decomposition.
fn nearest_rotation(block: &Matrix3<f64>) -> Result<UnitQuaternion<f64>, RigidTransformError> {
    // The decomposition overflows on huge numbers: refuse these first.
    let deviation = (block * block.transpose() - Matrix3::identity()).amax() * 0.5;
    if deviation.is_nan() || deviation > 0.5 {
        return Err(RigidTransformError::NotRotation { deviation });
    }
    if block.determinant() < 0.0 {
        return Err(RigidTransformError::Reflection);
    }
    let svd = block.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Err(RigidTransformError::NotRotation { deviation });
    };
    let rotation = u * v_t;
    let deviation = (rotation - block).amax();
    if deviation.is_nan() || deviation > ROTATION_TOLERANCE {
        return Err(RigidTransformError::NotRotation { deviation });
    }
    Ok(UnitQuaternion::from_rotation_matrix(
        &Rotation3::from_matrix_unchecked(rotation),
    ))
}

/// The rigid transform of a translation and a quaternion (x, y, z, w), which is normalised.
///
/// # Errors
/// If a number is not finite or the length of the quaternion is not within 0.9 and 1.1.
pub fn from_translation_quaternion(
    translation: [f64; 3],
    [x, y, z, w]: [f64; 4],
) -> Result<Isometry3<f64>, RigidTransformError> {
    if translation
        .iter()
        .chain(&[x, y, z, w])
        .any(|v| !v.is_finite())
    {
        return Err(RigidTransformError::NotFinite);
    }
    let quaternion = Quaternion::new(w, x, y, z);
    let length = quaternion.norm();
    if !(0.9..=1.1).contains(&length) {
        return Err(RigidTransformError::Quaternion { length });
    }
    Ok(Isometry3::from_parts(
        Translation3::from(Vector3::from(translation)),
        UnitQuaternion::from_quaternion(quaternion),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const IDENTITY: [[f64; 4]; 4] = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 1.0],
    ];

    #[test]
    fn invalid_transforms_are_refused() {
        let with = |r: usize, c: usize, value: f64| {
            let mut rows = IDENTITY;
            rows[r][c] = value;
            from_matrix(&rows)
        };
        assert!(matches!(
            with(0, 3, f64::NAN),
            Err(RigidTransformError::NotFinite)
        ));
        assert!(matches!(
            with(3, 0, 0.5),
            Err(RigidTransformError::LastRow { .. })
        ));
        assert!(matches!(
            with(1, 1, -1.0),
            Err(RigidTransformError::Reflection)
        ));
        assert!(matches!(
            with(1, 1, 1.2),
            Err(RigidTransformError::NotRotation { .. })
        ));
        assert!(matches!(
            with(1, 1, 1e300),
            Err(RigidTransformError::NotRotation { .. })
        ));
        assert!(matches!(
            with(1, 1, 0.0),
            Err(RigidTransformError::NotRotation { .. })
        ));
        assert!(from_matrix(&IDENTITY).is_ok());
        assert!(from_translation_quaternion([0.0; 3], [0.0; 4]).is_err());
    }

    proptest! {
        #[test]
        fn rounded_rotations_are_restored(
            axis in prop::array::uniform3(-3.0..3.0_f64),
            noise in prop::array::uniform9(-4e-4..4e-4_f64),
        ) {
            let rotation = Rotation3::new(Vector3::from(axis));
            let mut rows = IDENTITY;
            for r in 0..3 {
                for c in 0..3 {
                    rows[r][c] = rotation[(r, c)] + noise[3 * r + c];
                }
            }
            let pose = from_matrix(&rows).unwrap();
            prop_assert!((pose.rotation.norm() - 1.0).abs() < 1e-12);
            prop_assert!(pose.rotation.angle_to(&rotation.into()) < 2e-3);
        }

        #[test]
        fn any_numbers_are_rigid_or_refused(values in prop::array::uniform16(any::<f64>())) {
            let rows = [0, 4, 8, 12].map(|at| [values[at], values[at + 1], values[at + 2], values[at + 3]]);
            let _ = from_matrix(&rows);
            let mut rows = rows;
            rows[3] = IDENTITY[3];
            if let Ok(pose) = from_matrix(&rows) {
                prop_assert!(pose.rotation.coords.iter().all(|v| v.is_finite()));
            }
            let _ = from_translation_quaternion([values[0], values[1], values[2]], [values[3], values[4], values[5], values[6]]);
        }
    }
}
