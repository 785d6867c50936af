//! A pose as given and as corrected.

use nalgebra::{Isometry3, Matrix6, Point3, Translation3, UnitQuaternion, Vector3, Vector6};

/// The pose of a camera: as given, and as its image has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CorrectedPose {
    given_camera_from_world: Isometry3<f64>,
    world_from_camera: Isometry3<f64>,
    camera_from_world: Isometry3<f64>,
}

/// How far a pose was moved.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct PoseChange {
    /// Angle by which the camera was turned.
    pub rotation_rad: f64,
    /// Distance of the camera centres, in units of the poses.
    pub translation: f64,
}

/// By how much a given pose may be wrong: standard deviations of each axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosePrior {
    /// Of the direction.
    pub rotation_rad: f64,
    /// Of the place, in units of the poses.
    pub translation: f64,
}

impl PosePrior {
    /// Errors by which each of turn and shift moves the projections of points at `depth` by `sigma_px`.
    pub fn in_pixels(sigma_px: f64, focal_px: f64, depth: f64) -> Self {
        let rotation_rad = sigma_px / focal_px;
        Self {
            rotation_rad,
            translation: rotation_rad * depth,
        }
    }

    /// Information of the six parameters: turn, then shift.
    fn information(&self) -> Vector6<f64> {
        let (turn, shift) = (self.rotation_rad, self.translation);
        Vector6::new(turn, turn, turn, shift, shift, shift).map(|sigma| 1.0 / (sigma * sigma))
    }
}

impl CorrectedPose {
    /// A pose that nothing has corrected.
    pub fn new(world_from_camera: Isometry3<f64>) -> Self {
        let camera_from_world = world_from_camera.inverse();
        Self {
            given_camera_from_world: camera_from_world,
            world_from_camera,
            camera_from_world,
        }
    }

    /// The pose as corrected: `point_in_world = world_from_camera * point_in_camera`.
    pub fn world_from_camera(&self) -> &Isometry3<f64> {
        &self.world_from_camera
    }

    /// Its inverse.
    pub fn camera_from_world(&self) -> &Isometry3<f64> {
        &self.camera_from_world
    }

    /// Where the camera is, as corrected.
    pub fn center(&self) -> Point3<f64> {
        Point3::from(self.world_from_camera.translation.vector)
    }

    /// How far the pose was moved.
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

    /// Starts from a correction like that of another keyframe: the motion between the two stays as given.
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

    /// Corrected from given camera.
    fn correction(&self) -> Isometry3<f64> {
        self.camera_from_world * self.given_camera_from_world.inverse()
    }

    /// The same pose a small motion further: turn, then shift, of points in the camera.
    pub(super) fn moved(&self, step: &Vector6<f64>) -> Self {
        let turn: Vector3<f64> = step.fixed_rows::<3>(0).into();
        let shift: Vector3<f64> = step.fixed_rows::<3>(3).into();
        let mut moved = *self;
        let motion = Isometry3::from_parts(
            Translation3::from(shift),
            UnitQuaternion::from_scaled_axis(turn),
        );
        let mut next = motion * self.camera_from_world;
        // Products of many rotations drift from length one.
        next.rotation.renormalize();
        moved.set(next);
        moved
    }

    fn set(&mut self, camera_from_world: Isometry3<f64>) {
        self.camera_from_world = camera_from_world;
        self.world_from_camera = camera_from_world.inverse();
    }

    /// What the given pose, as a measurement, adds to the cost, to the gradient and to the normal matrix of a step.
    pub(super) fn hold(
        &self,
        prior: &PosePrior,
        gradient: &mut Vector6<f64>,
        normal: &mut Matrix6<f64>,
    ) -> f64 {
        let information = prior.information();
        let residual = self.residual();
        // A turn of the camera carries its shift along; the change of the turn itself is as good as one, for small turns.
        let shift: Vector3<f64> = residual.fixed_rows::<3>(3).into();
        let mut jacobian = Matrix6::identity();
        jacobian
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&-shift.cross_matrix());
        let weighted = Matrix6::from_diagonal(&information) * jacobian;
        *gradient += weighted.tr_mul(&residual);
        *normal += weighted.tr_mul(&jacobian);
        self.held_cost(prior)
    }

    /// The cost of being away from the given pose.
    pub(super) fn held_cost(&self, prior: &PosePrior) -> f64 {
        let residual = self.residual();
        prior.information().dot(&residual.component_mul(&residual))
    }

    fn residual(&self) -> Vector6<f64> {
        let correction = self.correction();
        let turn = correction.rotation.scaled_axis();
        let shift = correction.translation.vector;
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }
}
