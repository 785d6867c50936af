//! Reprojection error of one observation and its derivatives.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Matrix2x3, Matrix2x6, Point2, Point3, Vector2, Vector6};

/// 95 % bound of the squared reprojection error in variances: chi-squared with two degrees of freedom.
pub(crate) const CHI2_PIXEL: f64 = 5.99;

/// Cost of an observation whose point is behind the camera, in variances.
const BEHIND_CAMERA_CHI2: f64 = 1e6;

/// Reprojection error in standard deviations and its derivatives.
pub(super) struct Linearized {
    pub(super) residual: Vector2<f64>,
    /// By rotation and translation of points in the camera frame.
    pub(super) by_pose: Matrix2x6<f64>,
    /// By the point in the world frame.
    pub(super) by_point: Matrix2x3<f64>,
    pub(super) chi2: f64,
}

/// Linearises a reprojection error; `None` when the point is not in front of the camera.
pub(super) fn linearize(
    camera: &Camera,
    camera_from_world: &Isometry3<f64>,
    point_in_world: &Point3<f64>,
    pixel: &Point2<f64>,
    sigma_px: f64,
) -> Option<Linearized> {
    let in_camera = camera_from_world * point_in_world;
    let (projected, by_camera_point) = camera.project_with_jacobian(&in_camera)?;
    let by_camera_point = by_camera_point / sigma_px;
    let residual = (projected - pixel) / sigma_px;
    let mut by_pose = Matrix2x6::zeros();
    by_pose
        .fixed_columns_mut::<3>(0)
        .copy_from(&(-by_camera_point * in_camera.coords.cross_matrix()));
    by_pose
        .fixed_columns_mut::<3>(3)
        .copy_from(&by_camera_point);
    let rotation = camera_from_world.rotation.to_rotation_matrix();
    Some(Linearized {
        residual,
        by_pose,
        by_point: by_camera_point * rotation.matrix(),
        chi2: residual.norm_squared(),
    })
}

/// Derivative of the projection of a point by the time, under a motion of points in the camera's frame (rotation vector, then
/// translation, per unit of time); `None` when the point is not in front of the camera.
pub(crate) fn motion_in_image(
    camera: &Camera,
    in_camera: &Point3<f64>,
    motion: &Vector6<f64>,
) -> Option<Vector2<f64>> {
    let (_, by_camera_point) = camera.project_with_jacobian(in_camera)?;
    let turn = motion.fixed_rows::<3>(0).cross(&in_camera.coords);
    Some(by_camera_point * (turn + motion.fixed_rows::<3>(3)))
}

/// Squared reprojection error in variances; large when the point is not in front of the camera.
pub(super) fn chi2(
    camera: &Camera,
    camera_from_world: &Isometry3<f64>,
    point_in_world: &Point3<f64>,
    pixel: &Point2<f64>,
    sigma_px: f64,
) -> f64 {
    camera
        .project(&(camera_from_world * point_in_world))
        .map_or(BEHIND_CAMERA_CHI2, |projected| {
            (projected - pixel).norm_squared() / (sigma_px * sigma_px)
        })
}

/// Cauchy's robust kernel: cost and weight of a squared error.
pub(super) fn cauchy(chi2: f64, squared_width: f64) -> (f64, f64) {
    let share = chi2 / squared_width;
    (squared_width * share.ln_1p(), 1.0 / (1.0 + share))
}
