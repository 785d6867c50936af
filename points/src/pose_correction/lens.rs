//! Camera parameters that images were given with and that their matches contradict.

use linecarve_lines::camera::{Camera, CameraCorrection, CameraError};
use nalgebra::{Point3, SMatrix, SVector, Vector2};

/// Number of parameters that can be adjusted.
pub(super) const PARAMETERS: usize = 9;

/// Standard deviations of the parameters about their given values.
const PRIOR_SIGMAS: [f64; PARAMETERS] = [0.1, 0.1, 0.02, 0.05, 0.05, 0.3, 0.5, 0.005, 0.005];

/// Derivatives of a projection by the parameters.
pub(super) type ByLens = SMatrix<f64, 2, PARAMETERS>;
/// One value for each parameter.
pub(super) type LensVector = SVector<f64, PARAMETERS>;

/// What an adjustment changes of a camera that was given as a pinhole.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FreeLens {
    /// Nothing.
    Fixed,
    /// `k1` of Brown's model. Poses and points cannot compensate for it; for the other parameters they nearly can.
    Distortion,
    /// `k1` and the focal length: for given poses.
    FocalLength,
    /// All parameters: for given poses.
    All,
}

impl FreeLens {
    /// Number of adjusted parameters, the first ones.
    pub(super) fn count(self) -> usize {
        match self {
            Self::Fixed => 0,
            Self::Distortion => 1,
            Self::FocalLength => 2,
            Self::All => PARAMETERS,
        }
    }
}

/// A camera that was given as a pinhole, with corrected parameters.
///
/// They are `k1` of Brown's model, the logarithms of the factors on both focal lengths and on their ratio, the motion of the principal
/// point along x and y as a share of the given focal lengths, `k2`, `k3`, and the tangential coefficients `p1` and `p2`.
#[derive(Debug, Clone, PartialEq)]
pub struct CorrectedLens {
    given: Camera,
    change: LensVector,
    camera: Camera,
}

impl CorrectedLens {
    /// The given camera, without distortion.
    pub fn new(pinhole: Camera) -> Self {
        Self {
            given: pinhole.clone(),
            change: LensVector::zeros(),
            camera: pinhole,
        }
    }

    /// The corrected camera, with its distortion.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// What was corrected; `None` while the camera is as given.
    pub fn correction(&self) -> Option<CameraCorrection> {
        (self.change != LensVector::zeros()).then(|| correction(&self.change))
    }

    /// Displacement, in pixels, of the projection of a point in front of the camera by the correction.
    pub fn displacement_px(&self, point_in_camera: &Point3<f64>) -> f64 {
        let ends = [&self.camera, &self.given].map(|camera| camera.project(point_in_camera));
        match ends {
            [Some(corrected), Some(given)] => (corrected - given).norm(),
            _ => 0.0,
        }
    }

    /// The camera after a small step of the parameters.
    ///
    /// # Errors
    /// When the step is not finite.
    pub(super) fn moved(&self, step: &LensVector) -> Result<Self, CameraError> {
        let change = self.change + step;
        let camera = correction(&change).applied_to(&self.given)?;
        Ok(Self {
            given: self.given.clone(),
            change,
            camera,
        })
    }

    /// Gradient and information of the prior.
    pub(super) fn prior_terms(&self) -> (LensVector, LensVector) {
        let information = LensVector::from(PRIOR_SIGMAS).map(|sigma| 1.0 / (sigma * sigma));
        (information.component_mul(&self.change), information)
    }

    /// Cost of the prior.
    pub(super) fn prior_cost(&self) -> f64 {
        self.prior_terms().0.dot(&self.change)
    }

    /// Derivatives, by the parameters, of the projection of a point in front of the camera.
    pub(super) fn derivatives(&self, point_in_camera: &Point3<f64>) -> ByLens {
        let plane = point_in_camera.coords.xy() / point_in_camera.z;
        let square = plane.norm_squared();
        let focal = Vector2::new(self.camera.fx(), self.camera.fy());
        let radius = plane.component_mul(&focal);
        let center = Vector2::new(self.camera.cx(), self.camera.cy());
        let seen = self.camera.project(point_in_camera);
        let seen = seen.map_or(radius, |pixel| pixel.coords - center);
        let (x, y) = (plane.x, plane.y);
        let tangential =
            |along: f64, across: f64| Vector2::new(along, across).component_mul(&focal);
        ByLens::from_columns(&[
            square * radius,
            seen,
            Vector2::new(0.5 * seen.x, -0.5 * seen.y),
            Vector2::new(self.given.fx(), 0.0),
            Vector2::new(0.0, self.given.fy()),
            square.powi(2) * radius,
            square.powi(3) * radius,
            tangential(2.0 * x * y, square + 2.0 * y * y),
            tangential(square + 2.0 * x * x, 2.0 * x * y),
        ])
    }
}

fn correction(change: &LensVector) -> CameraCorrection {
    let [k1, log_focal, log_aspect, x, y, k2, k3, p1, p2] = (*change).into();
    CameraCorrection {
        focal_factor: log_focal.exp(),
        aspect_factor: log_aspect.exp(),
        center_shift: [x, y],
        k1,
        k2,
        k3,
        p1,
        p2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pinhole() -> Camera {
        Camera::pinhole(525.0, 520.0, 310.0, 245.0).unwrap()
    }

    #[test]
    fn derivatives_are_differences() {
        let change =
            LensVector::from([-0.06, 0.01, -0.02, 0.004, -0.003, 0.02, 0.01, 0.002, -0.001]);
        let lens = CorrectedLens::new(pinhole()).moved(&change).unwrap();
        let point = Point3::new(0.5, -0.3, 1.2);
        for parameter in 0..PARAMETERS {
            let seen = |size: f64| {
                let step = LensVector::ith(parameter, size);
                let moved = lens.moved(&step).unwrap();
                moved.camera().project(&point).unwrap()
            };
            let difference = (seen(1e-6) - seen(-1e-6)) / 2e-6;
            let derivative = lens.derivatives(&point).column(parameter).into_owned();
            assert!((difference - derivative).norm() < 1e-3, "{parameter}");
        }
        let shift = lens.camera().project(&point).unwrap() - pinhole().project(&point).unwrap();
        assert!((shift.norm() - lens.displacement_px(&point)).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_a_number_is_no_lens() {
        let step = LensVector::ith(0, f64::NAN);
        assert!(CorrectedLens::new(pinhole()).moved(&step).is_err());
    }
}
