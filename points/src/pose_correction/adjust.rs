//! Bundle adjustment of some cameras and their points.

use nalgebra::{
    DMatrix, DVector, Matrix3, Matrix6, Matrix6x3, Point2, Point3, SMatrix, Vector3, Vector6,
};

use super::lens::{ByLens, CorrectedLens, FreeLens, LensVector, PARAMETERS};
use super::pose::{CorrectedPose, PosePrior};
use super::residual::{CHI2_PIXEL, cauchy, chi2, linearize};

/// Largest number of steps.
const MAX_STEPS: usize = 12;

/// A step that lowers the cost by less than this share ends the adjustment.
const LAST_GAIN: f64 = 1e-4;

/// A point and its observations.
#[derive(Debug, Clone, Default)]
pub struct Track {
    /// Position of the point.
    pub point_in_world: Point3<f64>,
    /// Observations, at most one per camera.
    pub observations: Vec<TrackObservation>,
}

/// Pixel of a point in a camera of an adjustment.
#[derive(Debug, Clone, Copy)]
pub struct TrackObservation {
    /// Index of the camera.
    pub camera: u32,
    /// Pixel in the image with its distortion.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along x and y alike.
    pub sigma_px: f64,
}

/// Result of an adjustment.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AdjustmentSummary {
    /// Sum of robust squared errors in variances before the adjustment.
    pub cost_before: f64,
    /// The sum after the adjustment.
    pub cost_after: f64,
    /// Number of steps that lowered the cost.
    pub steps: usize,
}

/// Minimises the reprojection errors over the `free` cameras, the points of all tracks and the `free_lens` parameters of the
/// lens that all cameras share. Other cameras are fixed; without free ones the points and the lens alone move. Each free camera is held by its
/// given pose. The cost never grows.
///
/// Levenberg-Marquardt with Cauchy's kernel. Points are eliminated by the Schur complement, so that the linear system has six
/// unknowns per free camera and at most nine for the lens. The result is deterministic.
///
/// # Complexity
/// Per step: quadratic, for each track, in the free cameras that observe it; cubic in the number of free cameras.
///
/// # Reference
/// Local bundle adjustment of ORB-SLAM (Mur-Artal, Montiel, Tardos, IEEE Transactions on Robotics 31(5), 2015, section VI-D);
/// Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment: a modern synthesis", 2000, section 6.1. *Differs:* given
/// poses are measurements, so that no camera needs to be fixed.
pub fn adjust_bundle(
    lens: &mut CorrectedLens,
    free_lens: FreeLens,
    poses: &mut [CorrectedPose],
    free: &[u32],
    prior: &PosePrior,
    tracks: &mut [Track],
) -> AdjustmentSummary {
    let mut slots: Vec<Option<usize>> = vec![None; poses.len()];
    for (slot, &index) in free.iter().enumerate() {
        slots[index as usize] = Some(slot);
    }
    let mut problem = Problem {
        prior,
        free,
        slots,
        system: System::new(free.len(), free_lens.count()),
    };
    let mut cost = problem.cost(lens, poses, tracks);
    let mut adjustment = AdjustmentSummary {
        cost_before: cost,
        cost_after: cost,
        steps: 0,
    };
    if !cost.is_finite() {
        return adjustment;
    }
    let mut damping = 1e-4;
    let mut next = Candidate {
        lens: lens.clone(),
        poses: poses.to_vec(),
        points: Vec::with_capacity(tracks.len()),
    };
    for _ in 0..MAX_STEPS {
        let is_solved = problem.step(lens, poses, tracks, damping, &mut next);
        let next_cost = if is_solved {
            swap_points(tracks, &mut next.points);
            problem.cost(&next.lens, &next.poses, tracks)
        } else {
            f64::INFINITY
        };
        if next_cost < cost {
            lens.clone_from(&next.lens);
            poses.copy_from_slice(&next.poses);
            let gain = (cost - next_cost) / cost;
            cost = next_cost;
            adjustment.steps += 1;
            damping = (damping * 0.1).max(1e-9);
            if gain < LAST_GAIN {
                break;
            }
        } else {
            if is_solved {
                swap_points(tracks, &mut next.points);
            }
            damping *= 10.0;
            if damping > 1e4 {
                break;
            }
        }
    }
    adjustment.cost_after = cost;
    adjustment
}

fn swap_points(tracks: &mut [Track], points: &mut [Point3<f64>]) {
    for (track, point) in tracks.iter_mut().zip(points) {
        std::mem::swap(&mut track.point_in_world, point);
    }
}

/// Candidate poses, points and lens after one Levenberg-Marquardt step.
struct Candidate {
    lens: CorrectedLens,
    poses: Vec<CorrectedPose>,
    points: Vec<Point3<f64>>,
}

struct Problem<'a> {
    prior: &'a PosePrior,
    free: &'a [u32],
    /// Index of each camera among the free ones.
    slots: Vec<Option<usize>>,
    system: System,
}

/// Block between a point and the lens.
type PointByLens = SMatrix<f64, 3, PARAMETERS>;

/// Normal equations with points eliminated. Buffers are reused between steps.
struct System {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Per track: block of the point, later its inverse, and its gradient.
    point_blocks: Vec<(Matrix3<f64>, Vector3<f64>)>,
    /// Per observation in a free camera, track by track: slot and block between pose and point.
    pose_point_blocks: Vec<(usize, Matrix6x3<f64>)>,
    /// Per track: block between point and lens; empty when the lens is fixed.
    lens_point_blocks: Vec<PointByLens>,
    /// End of the pose-point blocks of each track.
    ends: Vec<usize>,
    /// Number of free lens parameters, which follow the poses.
    lens_count: usize,
}

impl System {
    fn new(free: usize, lens_count: usize) -> Self {
        let unknowns = 6 * free + lens_count;
        Self {
            normal: DMatrix::zeros(unknowns, unknowns),
            gradient: DVector::zeros(unknowns),
            point_blocks: Vec::new(),
            pose_point_blocks: Vec::new(),
            lens_point_blocks: Vec::new(),
            ends: Vec::new(),
            lens_count,
        }
    }

    fn clear(&mut self) {
        self.normal.fill(0.0);
        self.gradient.fill(0.0);
        self.point_blocks.clear();
        self.pose_point_blocks.clear();
        self.lens_point_blocks.clear();
        self.ends.clear();
    }

    fn add_pose(&mut self, slot: usize, gradient: &Vector6<f64>, normal: &Matrix6<f64>) {
        let at = 6 * slot;
        let mut rows = self.gradient.fixed_rows_mut::<6>(at);
        rows += gradient;
        let mut block = self.normal.fixed_view_mut::<6, 6>(at, at);
        block += normal;
    }

    /// Index of the first lens parameter.
    fn lens_start(&self) -> usize {
        self.gradient.len() - self.lens_count
    }

    fn add_lens(&mut self, gradient: &LensVector, normal: &SMatrix<f64, PARAMETERS, PARAMETERS>) {
        let (start, count) = (self.lens_start(), self.lens_count);
        let mut rows = self.gradient.rows_mut(start, count);
        rows += gradient.rows(0, count);
        let mut block = self.normal.view_mut((start, start), (count, count));
        block += normal.view((0, 0), (count, count));
    }

    /// Adds the block between a pose and the lens.
    fn add_pose_and_lens(&mut self, slot: usize, block: &SMatrix<f64, 6, PARAMETERS>) {
        let (start, count) = (self.lens_start(), self.lens_count);
        let mut columns = self.normal.view_mut((6 * slot, start), (6, count));
        columns += block.columns(0, count);
        let mut rows = self.normal.view_mut((start, 6 * slot), (count, 6));
        rows += block.columns(0, count).transpose();
    }
}

impl Problem<'_> {
    fn cost(&self, lens: &CorrectedLens, poses: &[CorrectedPose], tracks: &[Track]) -> f64 {
        let is_lens_free = self.system.lens_count > 0;
        let of_lens = if is_lens_free { lens.prior_cost() } else { 0.0 };
        let held: f64 = self
            .free
            .iter()
            .map(|&index| poses[index as usize].prior_cost(self.prior))
            .sum();
        let seen: f64 = tracks
            .iter()
            .flat_map(|track| {
                track
                    .observations
                    .iter()
                    .map(move |observation| (track, observation))
            })
            .map(|(track, observation)| {
                let pose = poses[observation.camera as usize].camera_from_world();
                let error = chi2(
                    lens.camera(),
                    pose,
                    &track.point_in_world,
                    &observation.pixel,
                    observation.sigma_px,
                );
                cauchy(error, CHI2_PIXEL).0
            })
            .sum();
        of_lens + held + seen
    }

    /// Computes the candidate of one step; returns whether the equations have a solution.
    fn step(
        &mut self,
        lens: &CorrectedLens,
        poses: &[CorrectedPose],
        tracks: &[Track],
        damping: f64,
        next: &mut Candidate,
    ) -> bool {
        self.system.clear();
        let lens_count = self.system.lens_count;
        if lens_count > 0 {
            let (gradient, information) = lens.prior_terms();
            self.system
                .add_lens(&gradient, &SMatrix::from_diagonal(&information));
        }
        for (slot, &index) in self.free.iter().enumerate() {
            let mut gradient = Vector6::zeros();
            let mut normal = Matrix6::zeros();
            poses[index as usize].add_prior(self.prior, &mut gradient, &mut normal);
            self.system.add_pose(slot, &gradient, &normal);
        }
        for track in tracks {
            self.add_track(lens, poses, track);
        }
        let system = &mut self.system;
        for at in 0..system.normal.nrows() {
            system.normal[(at, at)] *= 1.0 + damping;
        }
        // The camera blocks are damped before the elimination, whose terms are not.
        let mut eliminated_poses = Vec::new();
        let mut start = 0;
        for track in 0..system.ends.len() {
            let end = system.ends[track];
            let (inverse, gradient) = &mut system.point_blocks[track];
            let mut damped = *inverse;
            for axis in 0..3 {
                damped[(axis, axis)] *= 1.0 + damping;
            }
            // An undetermined point stays.
            *inverse = damped.try_inverse().unwrap_or_else(Matrix3::zeros);
            for (slot, block) in &system.pose_point_blocks[start..end] {
                let through = block * *inverse;
                let mut rows = system.gradient.fixed_rows_mut::<6>(6 * slot);
                rows -= through * *gradient;
                for (other, other_block) in &system.pose_point_blocks[start..end] {
                    let mut view = system.normal.fixed_view_mut::<6, 6>(6 * slot, 6 * other);
                    view -= through * other_block.transpose();
                }
            }
            if lens_count > 0 {
                let block = system.lens_point_blocks[track];
                let through = *inverse * block;
                let of_lens = (-through.tr_mul(gradient), -through.tr_mul(&block));
                eliminated_poses.clear();
                let poses = &system.pose_point_blocks[start..end];
                eliminated_poses
                    .extend(poses.iter().map(|(slot, block)| (*slot, -block * through)));
                system.add_lens(&of_lens.0, &of_lens.1);
                for (slot, block) in &eliminated_poses {
                    system.add_pose_and_lens(*slot, block);
                }
            }
            start = end;
        }
        let Some(factor) = system.normal.clone().cholesky() else {
            return false;
        };
        let step = factor.solve(&-&system.gradient);
        if !step.iter().all(|x| x.is_finite()) {
            return false;
        }
        for (slot, &index) in self.free.iter().enumerate() {
            let of_camera: Vector6<f64> = step.fixed_rows::<6>(6 * slot).into();
            next.poses[index as usize] = poses[index as usize].moved(&of_camera);
        }
        let mut of_lens = LensVector::zeros();
        if lens_count > 0 {
            let rows = step.rows(system.lens_start(), lens_count);
            of_lens.rows_mut(0, lens_count).copy_from(&rows);
            let Ok(moved) = lens.moved(&of_lens) else {
                return false;
            };
            next.lens = moved;
        }
        next.points.clear();
        let mut start = 0;
        for (index, ((track, (inverse, gradient)), &end)) in tracks
            .iter()
            .zip(&system.point_blocks)
            .zip(&system.ends)
            .enumerate()
        {
            let mut right = *gradient;
            if lens_count > 0 {
                right += system.lens_point_blocks[index] * of_lens;
            }
            for (slot, block) in &system.pose_point_blocks[start..end] {
                right += block.tr_mul(&step.fixed_rows::<6>(6 * slot));
            }
            let to = track.point_in_world - inverse * right;
            next.points.push(to);
            start = end;
        }
        true
    }

    fn add_track(&mut self, lens: &CorrectedLens, poses: &[CorrectedPose], track: &Track) {
        let mut normal = Matrix3::zeros();
        let mut gradient = Vector3::zeros();
        let mut with_lens = PointByLens::zeros();
        for observation in &track.observations {
            let pose = poses[observation.camera as usize].camera_from_world();
            let point = &track.point_in_world;
            let Some(at) = linearize(
                lens.camera(),
                pose,
                point,
                &observation.pixel,
                observation.sigma_px,
            ) else {
                continue;
            };
            let (_, weight) = cauchy(at.chi2, CHI2_PIXEL);
            normal += weight * at.by_point.tr_mul(&at.by_point);
            gradient += weight * at.by_point.tr_mul(&at.residual);
            let system = &mut self.system;
            let slot = self.slots[observation.camera as usize];
            let of_pose = weight * at.by_pose.transpose();
            if let Some(slot) = slot {
                system.add_pose(slot, &(of_pose * at.residual), &(of_pose * at.by_pose));
                system.pose_point_blocks.push((slot, of_pose * at.by_point));
            }
            if system.lens_count > 0 {
                let by_lens: ByLens = lens.derivatives(&(pose * point)) / observation.sigma_px;
                let of_lens = weight * by_lens;
                system.add_lens(&of_lens.tr_mul(&at.residual), &of_lens.tr_mul(&by_lens));
                with_lens += at.by_point.tr_mul(&of_lens);
                if let Some(slot) = slot {
                    system.add_pose_and_lens(slot, &(of_pose * by_lens));
                }
            }
        }
        if self.system.lens_count > 0 {
            self.system.lens_point_blocks.push(with_lens);
        }
        self.system.point_blocks.push((normal, gradient));
        self.system.ends.push(self.system.pose_point_blocks.len());
    }
}

#[cfg(test)]
mod tests;
