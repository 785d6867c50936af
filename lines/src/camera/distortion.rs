//! Lens distortion on the normalised image plane.

use nalgebra::{Matrix2, Vector2};

use super::polynomial::{evaluate, first_positive_root};

/// Lens distortion model, with the coefficient order of OpenCV.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// No distortion: the ideal pinhole.
    None,
    /// Brown's model: radial polynomial `1 + k1 r^2 + k2 r^4 + k3 r^6` and tangential terms `p1`, `p2`.
    ///
    /// # Reference
    /// D. C. Brown, Close-Range Camera Calibration, Photogrammetric Engineering, 1971.
    RadialTangential {
        /// Second-order radial coefficient.
        k1: f64,
        /// Fourth-order radial coefficient.
        k2: f64,
        /// First tangential coefficient.
        p1: f64,
        /// Second tangential coefficient.
        p2: f64,
        /// Sixth-order radial coefficient, often 0.
        k3: f64,
    },
    /// The equidistant fisheye model: a ray at an angle `theta` to the axis has the image radius
    /// `theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)`.
    ///
    /// # Reference
    /// J. Kannala, S. S. Brandt, A Generic Camera Model and Calibration Method for Conventional, Wide-Angle, and
    /// Fish-Eye Lenses, IEEE TPAMI, 2006, equation 6.
    KannalaBrandt {
        /// Coefficient of `theta^3`.
        k1: f64,
        /// Coefficient of `theta^5`.
        k2: f64,
        /// Coefficient of `theta^7`.
        k3: f64,
        /// Coefficient of `theta^9`.
        k4: f64,
    },
}

impl Distortion {
    /// Brown's model with `k1` alone.
    pub fn radial(k1: f64) -> Self {
        Self::RadialTangential {
            k1,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        }
    }

    /// The coefficients in the order of the fields.
    pub fn coefficients(&self) -> Vec<f64> {
        match *self {
            Self::None => Vec::new(),
            Self::RadialTangential { k1, k2, p1, p2, k3 } => vec![k1, k2, p1, p2, k3],
            Self::KannalaBrandt { k1, k2, k3, k4 } => vec![k1, k2, k3, k4],
        }
    }

    /// Upper end of the range in which the radial function is increasing: an undistorted radius on the plane z = 1 for
    /// [`Distortion::RadialTangential`], an angle of at most pi for [`Distortion::KannalaBrandt`].
    pub(super) fn limit(&self) -> f64 {
        match *self {
            Self::None => f64::INFINITY,
            Self::RadialTangential { k1, k2, k3, .. } => {
                first_positive_root(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3])
                    .map_or(f64::INFINITY, f64::sqrt)
            }
            Self::KannalaBrandt { k1, k2, k3, k4 } => {
                let angle = first_positive_root(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4])
                    .map_or(f64::INFINITY, f64::sqrt);
                angle.min(std::f64::consts::PI)
            }
        }
    }
}

/// Distorted position and its Jacobian for Brown's model.
pub(super) fn distort_radial_tangential(
    undistorted: Vector2<f64>,
    [k1, k2, p1, p2, k3]: [f64; 5],
) -> (Vector2<f64>, Matrix2<f64>) {
    let (x, y) = (undistorted.x, undistorted.y);
    let r2 = x * x + y * y;
    let radial = evaluate(&[1.0, k1, k2, k3], r2);
    let radial_by_r2 = evaluate(&[k1, 2.0 * k2, 3.0 * k3], r2);
    let distorted = Vector2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let cross = 2.0 * x * y * radial_by_r2 + 2.0 * p1 * x + 2.0 * p2 * y;
    let jacobian = Matrix2::new(
        radial + 2.0 * x * x * radial_by_r2 + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        radial + 2.0 * y * y * radial_by_r2 + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    (distorted, jacobian)
}

/// Image radius of a ray at an angle to the axis, and its derivative.
pub(super) fn fisheye_radius(angle: f64, [k1, k2, k3, k4]: [f64; 4]) -> (f64, f64) {
    let squared = angle * angle;
    (
        angle * evaluate(&[1.0, k1, k2, k3, k4], squared),
        evaluate(&[1.0, 3.0 * k1, 5.0 * k2, 7.0 * k3, 9.0 * k4], squared),
    )
}

/// Solves `function(x) = target` for an increasing function on `[0, limit]` by bracketed Newton iteration; `function` returns value and
/// derivative. `None` when the target lies beyond the limit.
pub(super) fn invert_increasing(
    target: f64,
    limit: f64,
    function: impl Fn(f64) -> (f64, f64),
) -> Option<f64> {
    let mut low = 0.0;
    let mut high = if limit.is_finite() {
        limit
    } else {
        let mut high = target.max(1.0);
        while function(high).0 < target {
            high *= 2.0;
            if !high.is_finite() {
                return None;
            }
        }
        high
    };
    let at_limit = function(high).0;
    // The negation also rejects NaN.
    if !(target >= 0.0 && target <= at_limit) {
        return None;
    }
    let mut x = target.min(high);
    for _ in 0..100 {
        let (value, derivative) = function(x);
        if value > target {
            high = x;
        } else {
            low = x;
        }
        let newton = x - (value - target) / derivative;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        if (next - x).abs() <= 1e-15 * (1.0 + x) {
            return Some(next);
        }
        x = next;
    }
    Some(x)
}
