//! The range of coordinates for which every predicate is exact.

use nalgebra::Point3;
use thiserror::Error;

/// Largest accepted magnitude of a coordinate, 2^190 (about 1.6e57).
///
/// The in-sphere determinant is of degree five in differences of coordinates; with `|difference| <= 2^191`
/// it and the splitting of its factors stay below 2^1000, far from overflow.
pub const MAX_COORDINATE: f64 = f64::from_bits(((1023 + 190) as u64) << 52);

/// Smallest accepted magnitude of a coordinate other than zero, 2^-150 (about 7e-46).
///
/// Accepted coordinates are thus integer multiples of 2^-202, and a product of five differences is zero or at
/// least 2^-1010: no rounding error is lost to underflow.
pub const MIN_COORDINATE: f64 = f64::from_bits(((1023 - 150) as u64) << 52);

/// Why a position was refused. The tetrahedralisation is unchanged.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum PointError {
    /// A coordinate is NaN.
    #[error("coordinate {axis} is not a number; drop the point")]
    NotANumber {
        /// `'x'`, `'y'` or `'z'`.
        axis: char,
    },
    /// A coordinate is infinite or larger than [`MAX_COORDINATE`].
    #[error(
        "coordinate {axis} = {value:e} exceeds {MAX_COORDINATE:e} in magnitude; scale or drop the point"
    )]
    TooLarge {
        /// `'x'`, `'y'` or `'z'`.
        axis: char,
        /// The coordinate.
        value: f64,
    },
    /// A coordinate other than zero is smaller than [`MIN_COORDINATE`].
    #[error(
        "coordinate {axis} = {value:e} is below {MIN_COORDINATE:e} in magnitude; round it to zero"
    )]
    TooSmall {
        /// `'x'`, `'y'` or `'z'`.
        axis: char,
        /// The coordinate.
        value: f64,
    },
    /// Ids are 32 bits wide and none is left.
    #[error("no room for another point: a tetrahedralisation holds at most about 150 million")]
    Full,
}

/// Checks that exact arithmetic covers `point`; negative zeros become zeros.
///
/// # Errors
///
/// [`PointError`] names the first coordinate that is NaN, infinite or out of range.
#[inline]
pub fn accept_position(point: &Point3<f64>) -> Result<[f64; 3], PointError> {
    let mut position = [point.x, point.y, point.z];
    for (value, axis) in position.iter_mut().zip(['x', 'y', 'z']) {
        let magnitude = value.abs();
        if value.is_nan() {
            return Err(PointError::NotANumber { axis });
        }
        if magnitude > MAX_COORDINATE {
            return Err(PointError::TooLarge {
                axis,
                value: *value,
            });
        }
        if magnitude < MIN_COORDINATE {
            if magnitude > 0.0 {
                return Err(PointError::TooSmall {
                    axis,
                    value: *value,
                });
            }
            *value = 0.0;
        }
    }
    Ok(position)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_range_is_closed_and_zero_has_one_sign() {
        let accepted =
            accept_position(&Point3::new(-0.0, MAX_COORDINATE, -MIN_COORDINATE)).unwrap();
        assert_eq!(accepted[0].to_bits(), 0);
        assert_eq!(accepted[1..], [MAX_COORDINATE, -MIN_COORDINATE]);
    }

    #[test]
    fn refusals_name_the_coordinate() {
        let refusal = |x, y, z| accept_position(&Point3::new(x, y, z)).unwrap_err();
        assert_eq!(
            refusal(0.0, f64::NAN, 0.0),
            PointError::NotANumber { axis: 'y' }
        );
        let value = f64::NEG_INFINITY;
        assert_eq!(
            refusal(0.0, 0.0, value),
            PointError::TooLarge { axis: 'z', value }
        );
        assert_eq!(
            refusal(1e58, 0.0, 0.0),
            PointError::TooLarge {
                axis: 'x',
                value: 1e58
            }
        );
        assert_eq!(
            refusal(1e-300, 0.0, 0.0),
            PointError::TooSmall {
                axis: 'x',
                value: 1e-300
            }
        );
    }
}
