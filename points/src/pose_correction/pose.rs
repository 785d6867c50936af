//! Given and corrected poses.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

/// A given pose and its correction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrectedPose {
    given_camera_from_world: Isometry3<f64>,
    world_from_camera: Isometry3<f64>,
    camera_from_world: Isometry3<f64>,
}

/// Difference of a corrected pose from the given one.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseChange {
    /// Angle of the rotation.
    pub rotation_rad: f64,
    /// Distance of the camera centres, in the unit of the poses.
    pub translation: f64,
}

/// Uncertainty of a given pose: standard deviations per axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePrior {
    /// Standard deviation of the rotation.
    pub rotation_rad: f64,
    /// Standard deviation of the translation, in the unit of the poses.
    pub translation: f64,
}

impl PosePrior {
    /// Uncertainty of which rotation and translation each move projections at `depth` by `sigma_px`.
    pub fn in_pixels(sigma_px: f64, focal_px: f64, depth: f64) -> Self {
        let rotation_rad = sigma_px / focal_px;
        Self {
            rotation_rad,
            translation: rotation_rad * depth,
        }
    }

    /// Information of the six parameters: rotation, then translation.
    fn information(&self) -> Vector6<f64> {
        let (r, t) = (self.rotation_rad, self.translation);
        Vector6::new(r, r, r, t, t, t).map(|sigma| 1.0 / (sigma * sigma))
    }
}

impl CorrectedPose {
    /// A pose without correction.
    pub fn new(world_from_camera: Isometry3<f64>) -> Self {
        let camera_from_world = world_from_camera.inverse();
        Self {
            given_camera_from_world: camera_from_world,
            world_from_camera,
            camera_from_world,
        }
    }

    /// The given pose without correction.
    pub(crate) fn as_given(&self) -> Self {
        let world_from_camera = self.given_camera_from_world.inverse();
        Self {
            world_from_camera,
            camera_from_world: self.given_camera_from_world,
            ..*self
        }
    }

    /// The corrected pose: `point_in_world = world_from_camera * point_in_camera`.
    pub fn world_from_camera(&self) -> &Isometry3<f64> {
        &self.world_from_camera
    }

    /// Inverse of the corrected pose.
    pub fn camera_from_world(&self) -> &Isometry3<f64> {
        &self.camera_from_world
    }

    /// The corrected camera centre.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(self.world_from_camera.translation.vector)
    }

    /// Difference from the given pose.
    pub fn change(&self) -> PoseChange {
        let correction = self.correction();
        let given_center = self
            .given_camera_from_world
            .inverse_transform_point(&Point3::origin());
        PoseChange {
            rotation_rad: correction.rotation.angle(),
            translation: (self.center() - given_center).norm(),
        }
    }

    /// Sets the correction so that the motion relative to another, corrected pose is the given one.
    pub(crate) fn transfer_correction(&mut self, other: &Self) {
        let other_from_this =
            other.given_camera_from_world * self.given_camera_from_world.inverse();
        let camera_from_world = other_from_this.inverse() * other.camera_from_world;
        if camera_from_world
            .to_homogeneous()
            .iter()
            .all(|x| x.is_finite())
        {
            self.set(camera_from_world);
        }
    }

    /// Transform from the given to the corrected camera frame.
    fn correction(&self) -> Isometry3<f64> {
        self.camera_from_world * self.given_camera_from_world.inverse()
    }

    /// The pose after a small motion of points in the camera frame: rotation, then translation.
    pub(super) fn moved(&self, step: &Vector6<f64>) -> Self {
        let rotation: Vector3<f64> = step.fixed_rows::<3>(0).into();
        let translation: Vector3<f64> = step.fixed_rows::<3>(3).into();
        let mut moved = *self;
        let motion = Isometry3::from_parts(
            Translation3::from(translation),
            UnitQuaternion::from_scaled_axis(rotation),
        );
        let mut next = motion * self.camera_from_world;
        // Products of many unit quaternions drift from length one.
        next.rotation.renormalize();
        moved.set(next);
        moved
    }

    fn set(&mut self, camera_from_world: Isometry3<f64>) {
        self.camera_from_world = camera_from_world;
        self.world_from_camera = camera_from_world.inverse();
    }

    /// Adds the terms of the prior to the gradient and the normal matrix of a step; returns its cost.
    pub(super) fn add_prior(
        &self,
        prior: &PosePrior,
        gradient: &mut Vector6<f64>,
        normal: &mut Matrix6<f64>,
    ) -> f64 {
        let information = prior.information();
        let residual = self.residual();
        // A rotation of the camera also rotates its translation. The Jacobian of the rotation vector is nearly the identity.
        let translation: Vector3<f64> = residual.fixed_rows::<3>(3).into();
        let mut jacobian = Matrix6::identity();
        jacobian
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&-translation.cross_matrix());
        let weighted = Matrix6::from_diagonal(&information) * jacobian;
        *gradient += weighted.tr_mul(&residual);
        *normal += weighted.tr_mul(&jacobian);
        self.prior_cost(prior)
    }

    /// Cost of the prior.
    pub(super) fn prior_cost(&self, prior: &PosePrior) -> f64 {
        let residual = self.residual();
        prior.information().dot(&residual.component_mul(&residual))
    }

    fn residual(&self) -> Vector6<f64> {
        let correction = self.correction();
        let rotation = correction.rotation.scaled_axis();
        let translation = correction.translation.vector;
        Vector6::new(
            rotation.x,
            rotation.y,
            rotation.z,
            translation.x,
            translation.y,
            translation.z,
        )
    }
}
