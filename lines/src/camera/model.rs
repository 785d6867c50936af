//! Camera intrinsics with distortion; projection and unprojection.

use nalgebra::{Matrix2x3, Point2, Point3, Vector2, Vector3};
use thiserror::Error;

use super::distortion::{Distortion, distort_radial_tangential, fisheye_radius, invert_increasing};

/// A calibrated camera, valid by construction.
///
/// Frames: a point in the camera frame (x right, y down, z forward) projects to pixel coordinates; the centre of the
/// top-left pixel is (0, 0).
///
/// ```
/// use linecarve_lines::camera::{Camera, Distortion};
/// use nalgebra::{Point2, Point3};
///
/// let camera = Camera::pinhole(500.0, 500.0, 319.5, 239.5)?;
/// assert_eq!(camera.project(&Point3::new(0.0, 0.0, 2.0)), Some(Point2::new(319.5, 239.5)));
///
/// let distortion = Distortion::RadialTangential { k1: -0.28, k2: 0.07, p1: 1e-4, p2: 1e-5, k3: 0.0 };
/// let camera = Camera::with_distortion(458.7, 457.3, 367.2, 248.4, distortion)?;
/// let pixel = Point2::new(700.0, 20.0);
/// let direction = camera.unproject(&pixel)?;
/// assert!((camera.project(&(direction * 3.0).into()).unwrap() - pixel).norm() < 1e-9);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    distortion: Distortion,
    /// Largest usable radius or angle of the distortion, derived from its coefficients.
    limit: f64,
}

/// What a negative focal length means, and the remedy.
fn mirrored(focal: f64) -> &'static str {
    if focal < 0.0 && focal.is_finite() {
        ": a negative one means y up in a mirrored world, as in ICL-NUIM; make it positive, and change the sign of ty, qx and qz of all poses"
    } else {
        ""
    }
}

/// A camera parameter is invalid.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CameraError {
    /// A focal length is zero, negative or not finite.
    #[error("focal length {name} = {value} px must be positive and finite{}", mirrored(*value))]
    FocalLength {
        /// `fx` or `fy`.
        name: &'static str,
        /// The refused value.
        value: f64,
    },
    /// A principal point coordinate is not finite.
    #[error("principal point {name} = {value} px must be finite")]
    PrincipalPoint {
        /// `cx` or `cy`.
        name: &'static str,
        /// The refused value.
        value: f64,
    },
    /// A distortion coefficient is not finite.
    #[error("distortion coefficient {position} = {value} must be finite")]
    Distortion {
        /// Position among the coefficients of the model, from 1.
        position: usize,
        /// The refused value.
        value: f64,
    },
}

/// Error of unprojecting a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum UnprojectError {
    /// The pixel lies beyond the range in which the lens model is invertible, or is not finite.
    #[error("pixel ({x}, {y}) lies outside the range in which the distortion model is invertible")]
    OutsideModel {
        /// Pixel x.
        x: f64,
        /// Pixel y.
        y: f64,
    },
    /// Newton's method did not reach the pixel.
    #[error("the viewing direction of pixel ({x}, {y}) did not converge (off by {residual_px} px)")]
    NotConverged {
        /// Pixel x.
        x: f64,
        /// Pixel y.
        y: f64,
        /// Distance from the pixel to the projection of the last iterate.
        residual_px: f64,
    },
    /// The viewing direction points sideways or backwards, where no positive depth z exists.
    #[error("the viewing direction of pixel ({x}, {y}) has no positive depth")]
    NoDepth {
        /// Pixel x.
        x: f64,
        /// Pixel y.
        y: f64,
    },
}

impl Camera {
    /// An ideal pinhole camera; focal lengths and principal point in pixels.
    ///
    /// # Errors
    /// When a focal length is not positive and finite, or the principal point is not finite.
    pub fn pinhole(fx: f64, fy: f64, cx: f64, cy: f64) -> Result<Self, CameraError> {
        Self::with_distortion(fx, fy, cx, cy, Distortion::None)
    }

    /// A camera with lens distortion; focal lengths and principal point in pixels.
    ///
    /// # Errors
    /// As [`Camera::pinhole`], and when a coefficient is not finite.
    pub fn with_distortion(
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Distortion,
    ) -> Result<Self, CameraError> {
        for (name, value) in [("fx", fx), ("fy", fy)] {
            if !(value.is_finite() && value > 0.0) {
                return Err(CameraError::FocalLength { name, value });
            }
        }
        for (name, value) in [("cx", cx), ("cy", cy)] {
            if !value.is_finite() {
                return Err(CameraError::PrincipalPoint { name, value });
            }
        }
        for (index, value) in distortion.coefficients().into_iter().enumerate() {
            if !value.is_finite() {
                return Err(CameraError::Distortion {
                    position: index + 1,
                    value,
                });
            }
        }
        let limit = distortion.limit();
        Ok(Self {
            fx,
            fy,
            cx,
            cy,
            distortion,
            limit,
        })
    }

    /// Focal length along x in pixels.
    pub fn fx(&self) -> f64 {
        self.fx
    }

    /// Focal length along y in pixels.
    pub fn fy(&self) -> f64 {
        self.fy
    }

    /// Principal point x in pixels.
    pub fn cx(&self) -> f64 {
        self.cx
    }

    /// Principal point y in pixels.
    pub fn cy(&self) -> f64 {
        self.cy
    }

    /// Mean of the two focal lengths in pixels.
    pub fn mean_focal_px(&self) -> f64 {
        0.5 * (self.fx + self.fy)
    }

    /// The lens model.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Whether the camera has no lens distortion.
    pub fn is_pinhole(&self) -> bool {
        self.distortion == Distortion::None
    }

    /// The pinhole camera with the same focal lengths and principal point.
    pub fn without_distortion(&self) -> Self {
        Self {
            distortion: Distortion::None,
            limit: f64::INFINITY,
            ..*self
        }
    }

    /// The camera of an image scaled by `factor` in both directions.
    ///
    /// # Errors
    /// When the factor is not positive and finite.
    pub fn scaled(&self, factor: f64) -> Result<Self, CameraError> {
        // The image corner at (-0.5, -0.5) is fixed.
        let centre = |c: f64| (c + 0.5) * factor - 0.5;
        Self::with_distortion(
            self.fx * factor,
            self.fy * factor,
            centre(self.cx),
            centre(self.cy),
            self.distortion,
        )
    }

    /// Projects a point in the camera frame to a pixel; `None` when the point is not in front of the lens, outside the invertible range of
    /// the lens model, or not finite. The pixel may lie outside the image.
    pub fn project(&self, point_in_camera: &Point3<f64>) -> Option<Point2<f64>> {
        if self.is_pinhole() {
            let inverse = 1.0 / point_in_camera.z;
            let pixel = Point2::new(
                self.fx * (point_in_camera.x * inverse) + self.cx,
                self.fy * (point_in_camera.y * inverse) + self.cy,
            );
            return (point_in_camera.z > 0.0 && pixel.x.is_finite() && pixel.y.is_finite())
                .then_some(pixel);
        }
        self.project_with_jacobian(point_in_camera)
            .map(|(pixel, _)| pixel)
    }

    /// [`Camera::project`] with the Jacobian of the pixel (rows x, y) with respect to the point (columns x, y, z).
    pub fn project_with_jacobian(
        &self,
        point_in_camera: &Point3<f64>,
    ) -> Option<(Point2<f64>, Matrix2x3<f64>)> {
        let p = point_in_camera;
        let (plane, mut jacobian) = match self.distortion {
            Distortion::None => normalise(p)?,
            Distortion::RadialTangential { k1, k2, p1, p2, k3 } => {
                let (undistorted, by_point) = normalise(p)?;
                if undistorted.norm() > self.limit {
                    return None;
                }
                let (distorted, by_undistorted) =
                    distort_radial_tangential(undistorted, [k1, k2, p1, p2, k3]);
                (distorted, by_undistorted * by_point)
            }
            Distortion::KannalaBrandt { k1, k2, k3, k4 } => {
                self.project_fisheye(p, [k1, k2, k3, k4])?
            }
        };
        let pixel = Point2::new(self.fx * plane.x + self.cx, self.fy * plane.y + self.cy);
        jacobian.row_mut(0).scale_mut(self.fx);
        jacobian.row_mut(1).scale_mut(self.fy);
        (pixel.x.is_finite() && pixel.y.is_finite()).then_some((pixel, jacobian))
    }

    fn project_fisheye(
        &self,
        p: &Point3<f64>,
        coefficients: [f64; 4],
    ) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        let across = p.x.hypot(p.y);
        let squared = across * across + p.z * p.z;
        if squared.is_nan() || squared <= 0.0 {
            return None;
        }
        let angle = across.atan2(p.z);
        if angle > self.limit {
            return None;
        }
        let (radius, radius_by_angle) = fisheye_radius(angle, coefficients);
        if across <= 1e-12 * p.z.abs() {
            // Limit of radius / across on the axis: 1 / z.
            return (p.z > 0.0).then(|| normalise(p)).flatten();
        }
        let (cos, sin) = (p.x / across, p.y / across);
        let along = Vector3::new(cos * p.z, sin * p.z, -across) * (radius_by_angle / squared);
        let turning = radius / across;
        let jacobian = Matrix2x3::new(
            cos * along.x + turning * sin * sin,
            cos * along.y - turning * sin * cos,
            cos * along.z,
            sin * along.x - turning * sin * cos,
            sin * along.y + turning * cos * cos,
            sin * along.z,
        );
        Some((Vector2::new(radius * cos, radius * sin), jacobian))
    }

    /// The unit viewing direction of a pixel in the camera frame.
    ///
    /// # Errors
    /// When the pixel is not finite, lies beyond the invertible range of the lens model, or Newton's method fails.
    pub fn unproject(&self, pixel: &Point2<f64>) -> Result<Vector3<f64>, UnprojectError> {
        let outside = UnprojectError::OutsideModel {
            x: pixel.x,
            y: pixel.y,
        };
        let plane = Vector2::new((pixel.x - self.cx) / self.fx, (pixel.y - self.cy) / self.fy);
        if !(plane.x.is_finite() && plane.y.is_finite()) {
            return Err(outside);
        }
        match self.distortion {
            Distortion::None => Ok(plane.push(1.0).normalize()),
            Distortion::RadialTangential { k1, k2, p1, p2, k3 } => {
                let undistorted =
                    self.undistort_radial_tangential(plane, [k1, k2, p1, p2, k3], pixel)?;
                Ok(undistorted.push(1.0).normalize())
            }
            Distortion::KannalaBrandt { k1, k2, k3, k4 } => {
                let radius = plane.norm();
                let angle = invert_increasing(radius, self.limit, |angle| {
                    fisheye_radius(angle, [k1, k2, k3, k4])
                })
                .ok_or(outside)?;
                if radius == 0.0 {
                    return Ok(Vector3::z());
                }
                let (sin, cos) = angle.sin_cos();
                Ok((plane * (sin / radius)).push(cos))
            }
        }
    }

    /// The point at depth z along the viewing direction of a pixel.
    ///
    /// # Errors
    /// As [`Camera::unproject`], and when the direction has no positive z.
    pub fn point_at_depth(
        &self,
        pixel: &Point2<f64>,
        depth: f64,
    ) -> Result<Point3<f64>, UnprojectError> {
        if self.is_pinhole() {
            return Ok(Point3::new(
                (pixel.x - self.cx) / self.fx * depth,
                (pixel.y - self.cy) / self.fy * depth,
                depth,
            ));
        }
        let direction = self.unproject(pixel)?;
        if direction.z <= 1e-9 {
            return Err(UnprojectError::NoDepth {
                x: pixel.x,
                y: pixel.y,
            });
        }
        Ok(Point3::from(direction * (depth / direction.z)))
    }

    /// Radial part by bracketed Newton, then Newton in the plane for the tangential terms.
    fn undistort_radial_tangential(
        &self,
        distorted: Vector2<f64>,
        coefficients: [f64; 5],
        pixel: &Point2<f64>,
    ) -> Result<Vector2<f64>, UnprojectError> {
        let outside = UnprojectError::OutsideModel {
            x: pixel.x,
            y: pixel.y,
        };
        let [k1, k2, _, _, k3] = coefficients;
        let radius = distorted.norm();
        if radius == 0.0 && coefficients[2] == 0.0 && coefficients[3] == 0.0 {
            return Ok(distorted);
        }
        let radial = |r: f64| {
            let (d, j) = distort_radial_tangential(Vector2::new(r, 0.0), [k1, k2, 0.0, 0.0, k3]);
            (d.x, j[(0, 0)])
        };
        let mut undistorted = match invert_increasing(radius, self.limit, radial) {
            Some(r) if radius > 0.0 => distorted * (r / radius),
            Some(_) => distorted,
            // The tangential terms may still bring the pixel inside: start from the limit.
            None if self.limit.is_finite() => distorted * (0.99 * self.limit / radius),
            None => return Err(outside),
        };
        let mut residual_px = f64::INFINITY;
        for _ in 0..30 {
            let (value, jacobian) = distort_radial_tangential(undistorted, coefficients);
            let miss = distorted - value;
            residual_px = (miss.x * self.fx).hypot(miss.y * self.fy);
            if residual_px < 1e-10 {
                break;
            }
            let Some(inverse) = jacobian.try_inverse() else {
                return Err(outside);
            };
            undistorted += inverse * miss;
            let norm = undistorted.norm();
            if !norm.is_finite() {
                return Err(outside);
            }
            if norm > self.limit {
                undistorted *= self.limit / norm;
            }
        }
        // 0.001 px is far below image accuracy; a larger residual means no convergence.
        if residual_px < 1e-3 {
            Ok(undistorted)
        } else if undistorted.norm() >= 0.999 * self.limit {
            Err(outside)
        } else {
            Err(UnprojectError::NotConverged {
                x: pixel.x,
                y: pixel.y,
                residual_px,
            })
        }
    }
}

/// Position on the plane z = 1 and its Jacobian with respect to the point.
fn normalise(p: &Point3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    if p.z.is_nan() || p.z <= 0.0 {
        return None;
    }
    let inverse = 1.0 / p.z;
    let plane = Vector2::new(p.x * inverse, p.y * inverse);
    let jacobian = Matrix2x3::new(
        inverse,
        0.0,
        -plane.x * inverse,
        0.0,
        inverse,
        -plane.y * inverse,
    );
    (plane.x.is_finite() && plane.y.is_finite()).then_some((plane, jacobian))
}

#[cfg(test)]
mod tests;
