//! Some cameras and the points that they see, moved together.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Matrix6x3, Point2, Point3, Vector3, Vector6};

use super::lens::CorrectedLens;
use super::pose::{CorrectedPose, PosePrior};
use super::sight::{CHI2_PIXEL, cauchy, chi2, linearize};

/// Steps at most.
const MAX_STEPS: usize = 12;

/// A step that lowers the cost by less than this share is the last.
const LAST_GAIN: f64 = 1e-4;

/// A point and the pixels at which cameras see it.
#[derive(Debug, Clone, Default)]
pub struct Track {
    /// Where it is.
    pub point_in_world: Point3<f64>,
    /// Who sees it; each camera once.
    pub observations: Vec<TrackObservation>,
}

/// A pixel at which a camera sees a point.
#[derive(Debug, Clone, Copy)]
pub struct TrackObservation {
    /// Index of the camera.
    pub camera: u32,
    /// Where.
    pub pixel: Point2<f64>,
    /// Standard deviation of the pixel, along x and y alike.
    pub sigma_px: f64,
}

/// What an adjustment did.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct AdjustmentSummary {
    /// Sum of robust squared errors before and after, in variances.
    pub cost_before: f64,
    /// The same after.
    pub cost_after: f64,
    /// Steps that lowered it.
    pub steps: usize,
}

/// Moves the cameras `free` and the points of all tracks to where the projections fit the pixels best; the other cameras
/// that see the points stay where they are, and every camera that moves is held by its given pose. The lens, one for all
/// cameras, follows when it `is_lens_free`. The cost never grows.
///
/// Levenberg-Marquardt on Cauchy's kernel; points are eliminated (Schur complement), so that the system that is solved has
/// six unknowns a free camera, and one for the lens. The same input gives the same bytes.
///
/// # Complexity
/// Per step: for each track quadratic in the free cameras that see it, and cubic in the number of free cameras.
///
/// # Reference
/// Local bundle adjustment of ORB-SLAM (Mur-Artal, Montiel, Tardos, IEEE Transactions on Robotics 31(5), 2015, section VI-D);
/// Triggs, McLauchlan, Hartley, Fitzgibbon, "Bundle adjustment: a modern synthesis", 2000, section 6.1. *Differs:* given
/// poses take part as measurements, so that no camera need be fixed.
pub fn adjust_bundle(
    lens: &mut CorrectedLens,
    is_lens_free: bool,
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
        system: System::new(free.len(), is_lens_free),
    };
    let mut cost = problem.cost(lens, poses, tracks);
    let mut adjustment = AdjustmentSummary {
        cost_before: cost,
        cost_after: cost,
        steps: 0,
    };
    if free.is_empty() || !cost.is_finite() {
        return adjustment;
    }
    let mut damping = 1e-4;
    let mut next = Step {
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

/// Where everything goes to.
struct Step {
    lens: CorrectedLens,
    poses: Vec<CorrectedPose>,
    points: Vec<Point3<f64>>,
}

struct Problem<'a> {
    prior: &'a PosePrior,
    free: &'a [u32],
    /// Which of the free cameras each camera is.
    slots: Vec<Option<usize>>,
    system: System,
}

/// The normal equations, with points eliminated. Memory is kept from one step to the next.
struct System {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Of each track: inverse of its own block and its gradient.
    points: Vec<(Matrix3<f64>, Vector3<f64>)>,
    /// Of each sight in a free pose, track by track: slot and block between pose and point.
    mixed: Vec<(usize, Matrix6x3<f64>)>,
    /// Of each track: block between lens and point; none when the lens is as it is.
    of_lens: Vec<Vector3<f64>>,
    /// Where the blocks of each track end.
    ends: Vec<usize>,
    /// Where the lens is: after the poses; `None` when it is as it is.
    lens_at: Option<usize>,
}

impl System {
    fn new(free: usize, is_lens_free: bool) -> Self {
        let unknowns = 6 * free + usize::from(is_lens_free);
        Self {
            normal: DMatrix::zeros(unknowns, unknowns),
            gradient: DVector::zeros(unknowns),
            points: Vec::new(),
            mixed: Vec::new(),
            of_lens: Vec::new(),
            ends: Vec::new(),
            lens_at: is_lens_free.then_some(6 * free),
        }
    }

    fn clear(&mut self) {
        self.normal.fill(0.0);
        self.gradient.fill(0.0);
        self.points.clear();
        self.mixed.clear();
        self.of_lens.clear();
        self.ends.clear();
    }

    fn add_pose(&mut self, slot: usize, gradient: &Vector6<f64>, normal: &Matrix6<f64>) {
        let at = 6 * slot;
        let mut rows = self.gradient.fixed_rows_mut::<6>(at);
        rows += gradient;
        let mut block = self.normal.fixed_view_mut::<6, 6>(at, at);
        block += normal;
    }

    fn add_lens(&mut self, at: usize, gradient: f64, normal: f64) {
        self.gradient[at] += gradient;
        self.normal[(at, at)] += normal;
    }

    /// What a pose and the lens have in common.
    fn add_pose_and_lens(&mut self, slot: usize, at: usize, block: &Vector6<f64>) {
        let mut column = self.normal.fixed_view_mut::<6, 1>(6 * slot, at);
        column += block;
        let mut row = self.normal.fixed_view_mut::<1, 6>(at, 6 * slot);
        row += block.transpose();
    }
}

impl Problem<'_> {
    fn cost(&self, lens: &CorrectedLens, poses: &[CorrectedPose], tracks: &[Track]) -> f64 {
        let of_lens = self.system.lens_at.map_or(0.0, |_| lens.held_cost());
        let held: f64 = self
            .free
            .iter()
            .map(|&index| poses[index as usize].held_cost(self.prior))
            .sum();
        let seen: f64 = tracks
            .iter()
            .flat_map(|track| track.observations.iter().map(move |sight| (track, sight)))
            .map(|(track, sight)| {
                let pose = poses[sight.camera as usize].camera_from_world();
                let error = chi2(
                    lens.camera(),
                    pose,
                    &track.point_in_world,
                    &sight.pixel,
                    sight.sigma_px,
                );
                cauchy(error, CHI2_PIXEL).0
            })
            .sum();
        of_lens + held + seen
    }

    /// Where cameras and points would go; returns whether the equations have a solution.
    fn step(
        &mut self,
        lens: &CorrectedLens,
        poses: &[CorrectedPose],
        tracks: &[Track],
        damping: f64,
        next: &mut Step,
    ) -> bool {
        self.system.clear();
        if let Some(at) = self.system.lens_at {
            let (gradient, normal) = lens.hold();
            self.system.add_lens(at, gradient, normal);
        }
        for (slot, &index) in self.free.iter().enumerate() {
            let mut gradient = Vector6::zeros();
            let mut normal = Matrix6::zeros();
            poses[index as usize].hold(self.prior, &mut gradient, &mut normal);
            self.system.add_pose(slot, &gradient, &normal);
        }
        for track in tracks {
            self.add_track(lens, poses, track);
        }
        let system = &mut self.system;
        for at in 0..system.normal.nrows() {
            system.normal[(at, at)] *= 1.0 + damping;
        }
        // After the cameras' own blocks are damped: what elimination takes away is not.
        let mut start = 0;
        for (track, ((inverse, gradient), &end)) in
            system.points.iter_mut().zip(&system.ends).enumerate()
        {
            let mut damped = *inverse;
            for axis in 0..3 {
                damped[(axis, axis)] *= 1.0 + damping;
            }
            // A point that nothing fixes stays.
            *inverse = damped.try_inverse().unwrap_or_else(Matrix3::zeros);
            for (slot, block) in &system.mixed[start..end] {
                let through = block * *inverse;
                let mut rows = system.gradient.fixed_rows_mut::<6>(6 * slot);
                rows -= through * *gradient;
                for (other, other_block) in &system.mixed[start..end] {
                    let mut view = system.normal.fixed_view_mut::<6, 6>(6 * slot, 6 * other);
                    view -= through * other_block.transpose();
                }
            }
            if let Some(at) = system.lens_at {
                let block = system.of_lens[track];
                let through = *inverse * block;
                system.gradient[at] -= through.dot(gradient);
                system.normal[(at, at)] -= through.dot(&block);
                for (slot, other_block) in &system.mixed[start..end] {
                    let common = other_block * through;
                    let mut column = system.normal.fixed_view_mut::<6, 1>(6 * slot, at);
                    column -= common;
                    let mut row = system.normal.fixed_view_mut::<1, 6>(at, 6 * slot);
                    row -= common.transpose();
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
        let of_lens = system.lens_at.map(|at| step[at]);
        if let Some(step) = of_lens {
            let Ok(moved) = lens.moved(step) else {
                return false;
            };
            next.lens = moved;
        }
        next.points.clear();
        let mut start = 0;
        for (index, ((track, (inverse, gradient)), &end)) in tracks
            .iter()
            .zip(&system.points)
            .zip(&system.ends)
            .enumerate()
        {
            let mut right = *gradient;
            if let Some(step) = of_lens {
                right += system.of_lens[index] * step;
            }
            for (slot, block) in &system.mixed[start..end] {
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
        let mut with_lens = Vector3::zeros();
        for sight in &track.observations {
            let pose = poses[sight.camera as usize].camera_from_world();
            let point = &track.point_in_world;
            let Some(at) = linearize(lens.camera(), pose, point, &sight.pixel, sight.sigma_px)
            else {
                continue;
            };
            let (_, weight) = cauchy(at.chi2, CHI2_PIXEL);
            normal += weight * at.by_point.tr_mul(&at.by_point);
            gradient += weight * at.by_point.tr_mul(&at.residual);
            let system = &mut self.system;
            let slot = self.slots[sight.camera as usize];
            let of_pose = weight * at.by_pose.transpose();
            if let Some(slot) = slot {
                system.add_pose(slot, &(of_pose * at.residual), &(of_pose * at.by_pose));
                system.mixed.push((slot, of_pose * at.by_point));
            }
            if let Some(start) = system.lens_at {
                let by_lens = lens.by_k1(&(pose * point)) / sight.sigma_px;
                let of_lens = weight * by_lens;
                system.add_lens(start, of_lens.dot(&at.residual), of_lens.dot(&by_lens));
                with_lens += at.by_point.tr_mul(&of_lens);
                if let Some(slot) = slot {
                    system.add_pose_and_lens(slot, start, &(of_pose * by_lens));
                }
            }
        }
        if self.system.lens_at.is_some() {
            self.system.of_lens.push(with_lens);
        }
        self.system.points.push((normal, gradient));
        self.system.ends.push(self.system.mixed.len());
    }
}

#[cfg(test)]
mod tests;
