//! The point cloud: every pixel with a strong gradient and a depth.

use std::time::Instant;

use nalgebra::Point2;

use super::method::{Findings, FoundPoint, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::image::sobel;

/// Settings of [`PointCloud`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointCloudOptions {
    /// Least gradient of a pixel in grey levels per pixel; 0 takes every pixel with a depth.
    pub minimum_gradient: f64,
}

impl Default for PointCloudOptions {
    /// lambda_G of Mur-Artal & Tardos, RSS 2015.
    fn default() -> Self {
        Self {
            minimum_gradient: 8.0,
        }
    }
}

/// Every pixel with a strong gradient and a depth as a point in the world: the semi-dense cloud that the paper starts
/// from. Points are not fused: a surface point that ten keyframes see appears ten times.
///
/// # Reference
/// R. Mur-Artal, J. D. Tardos, Probabilistic Semi-Dense Mapping from Highly Accurate Feature-Based Monocular SLAM, RSS 2015.
#[derive(Debug, Clone)]
pub struct PointCloud {
    options: PointCloudOptions,
}

impl PointCloud {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When the gradient is negative or not finite.
    pub fn new(options: PointCloudOptions) -> Result<Self, MethodError> {
        let value = options.minimum_gradient;
        if !(value.is_finite() && value >= 0.0) {
            return Err(MethodError::Option {
                method: Method::Points,
                name: "minimum_gradient",
                value,
            });
        }
        Ok(Self { options })
    }
}

impl LineMethod for PointCloud {
    fn method(&self) -> Method {
        Method::Points
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let depth = keyframe.require_depth(self.method())?;
        let start = Instant::now();
        // The Sobel weights sum to 8 per unit of slope.
        let least = 64.0 * self.options.minimum_gradient * self.options.minimum_gradient;
        for (x, y, measurement) in depth.known() {
            let (gx, gy) = sobel(keyframe.image, x, y);
            let squared = f64::from(gx * gx + gy * gy);
            if squared < least {
                continue;
            }
            let pixel = Point2::new(x as f64, y as f64);
            let Ok(point) = keyframe.camera.point_at_depth(&pixel, measurement.depth()) else {
                continue;
            };
            findings.points.push(FoundPoint {
                point_in_world: keyframe.world_from_camera * point,
                gray: keyframe.image.row(y)[x],
            });
        }
        findings.add_time("points", start.elapsed());
        Ok(())
    }
}
