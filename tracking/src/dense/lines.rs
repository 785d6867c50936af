//! Lines of an image on its surfaces, found again in another image: where surfaces leave a motion open, edges on them do not.

use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
use linecarve_lines::image::{GrayImage, sobel};
use nalgebra::{Isometry3, Matrix6, Point2, SymmetricEigen, Vector2, Vector3, Vector6};

use super::align::Alignment;
use super::view::DenseSurface;
use crate::camera::{Pinhole, cauchy, moved};
use crate::interpolation::sample;

/// Pixels of a chain between samples.
const SPACING: usize = 4;

/// Pixels of a chain on either side of a sample, between which it must be straight.
const ARM: usize = 8;

/// Largest distance of a sample from the straight line between the ends of its arms, in pixels.
const MAX_BEND_PX: f64 = 0.5;

/// How far from where it is expected a sample is looked for, in pixels: in the first steps and in the last ones.
const REACHES: [usize; 2] = [6, 3];

/// Steps with the first reach, and steps in all.
const FIRST_STEPS: usize = 3;
const STEPS: usize = 8;

/// Least strength of an edge in grey levels per pixel, and the largest ratio of the strengths of two images of it.
const MIN_STRENGTH: f64 = 1.5;
const MAX_STRENGTH_RATIO: f64 = 2.5;

/// Standard deviation of the distance of an edge from where it is expected, in pixels. Samples measure 0.1 pixels (rendered room, true
/// poses), but rolling shutters and lenses move whole lines.
const SIGMA_PX: f64 = 0.3;

/// What a sample counts for: those of a line err together.
const SAMPLE_WEIGHT: f64 = 0.1;

/// Scale of Cauchy's kernel in variances.
const ROBUST_BOUND: f64 = 6.25;

/// Fewest samples, and the least share of those inside the image, that are found.
const MIN_FOUND: usize = 60;
const MIN_FOUND_SHARE: f64 = 0.6;

/// Largest standard deviation of a motion that is determined: translation as a share of the depth, rotation in radians.
const MAX_SIGMA: f64 = 0.003;

/// A point of a straight edge on a surface.
#[derive(Debug)]
struct LineSample {
    /// In the camera.
    point: Vector3<f64>,
    /// A pixel further along the edge, on the same plane.
    next: Vector3<f64>,
    /// Whether the brighter side is to the right of the way to `next`, with y down.
    is_right_brighter: bool,
    /// Gradient in grey levels per pixel.
    strength: f64,
}

/// The straight edges of an image that lie on planes of its depth image.
#[derive(Debug)]
pub(crate) struct LineView {
    smoothed: GrayImage,
    samples: Vec<LineSample>,
}

impl LineView {
    /// Edges at depth steps are left out: there is no plane.
    pub(crate) fn new(image: &GrayImage, surface: &DenseSurface, camera: &Pinhole) -> Self {
        let mut detector = EdgeDetector::new(EdgeOptions::default()).unwrap_or_default();
        let chains = detector.detect(image);
        let smoothed = detector.smoothed().clone();
        let positions = chains.positions();
        let mut samples = Vec::new();
        for chain in 0..chains.len() {
            let start = chains.start(chain);
            let length = chains.chain(chain).len();
            for at in (ARM..length.saturating_sub(ARM)).step_by(SPACING) {
                let [before, pixel, after] = [at - ARM, at, at + ARM]
                    .map(|at| Vector2::from(positions[start + at]).cast::<f64>());
                samples.extend(line_sample(
                    &smoothed,
                    surface,
                    camera,
                    [before, pixel, after],
                ));
            }
        }
        Self { smoothed, samples }
    }
}

/// The sample at the middle one of three pixels of a chain.
fn line_sample(
    smoothed: &GrayImage,
    surface: &DenseSurface,
    camera: &Pinhole,
    [before, pixel, after]: [Vector2<f64>; 3],
) -> Option<LineSample> {
    let along = (after - before).try_normalize(1e-6)?;
    let right = Vector2::new(-along.y, along.x);
    if (pixel - before).dot(&right).abs() > MAX_BEND_PX {
        return None;
    }
    let [x, y] = [pixel.x, pixel.y].map(|at| at.round().max(0.0) as usize);
    let (gx, gy) = sobel(smoothed, x, y);
    let gradient = Vector2::new(f64::from(gx), f64::from(gy)) / 8.0;
    let ray = camera.ray(&Point2::from(pixel));
    let plane: Vector3<f64> = surface.planes[surface.pixel_of(&ray.cast())?].cast();
    let next = camera.ray(&Point2::from(pixel + along));
    let inverse_depths = [plane.dot(&ray), plane.dot(&next)];
    if plane == Vector3::zeros() || inverse_depths.iter().any(|rho| *rho <= 0.0) {
        return None;
    }
    Some(LineSample {
        point: ray / inverse_depths[0],
        next: next / inverse_depths[1],
        is_right_brighter: gradient.dot(&right) > 0.0,
        strength: gradient.dot(&right).abs(),
    })
}

/// Completes the motion of an alignment along what the surfaces leave open; `information` is that of the alignment, `depth` the length against
/// which translations are compared with rotations. `None` when lines do not determine it.
///
/// Samples of the edges of the source are looked for across the edge in the target: the nearest maximum of the gradient with the same polarity.
/// Gauss-Newton minimises the distances and the change of the alignment.
pub(crate) fn complete(
    camera: &Pinhole,
    source: &LineView,
    target: &LineView,
    found: &Alignment,
    information: &Matrix6<f64>,
    depth: f64,
) -> Option<Isometry3<f64>> {
    let mut pose = found.target_from_source;
    for step in 0..=STEPS {
        let reach = REACHES[usize::from(step >= FIRST_STEPS)];
        let sums = Sums::of(camera, source, target, &pose, reach);
        let change = pose * found.target_from_source.inverse();
        let (shift, turn) = (change.translation.vector, change.rotation.scaled_axis());
        let change = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        let normal = sums.normal + information;
        if step == STEPS {
            let units = Matrix6::from_diagonal(&Vector6::new(depth, depth, depth, 1.0, 1.0, 1.0));
            let weakest = SymmetricEigen::new(units * normal * units)
                .eigenvalues
                .min();
            let is_determined = weakest * MAX_SIGMA * MAX_SIGMA >= 1.0;
            let is_found = sums.found >= MIN_FOUND
                && sums.found as f64 >= MIN_FOUND_SHARE * sums.inside as f64;
            return (is_determined && is_found).then_some(pose);
        }
        let motion = normal
            .cholesky()?
            .solve(&-(sums.gradient + information * change));
        if !motion.iter().all(|value| value.is_finite()) {
            return None;
        }
        pose = moved(&pose, &motion);
    }
    None
}

/// Normal equations by a small motion of points in the target.
struct Sums {
    normal: Matrix6<f64>,
    gradient: Vector6<f64>,
    found: usize,
    inside: usize,
}

impl Sums {
    fn of(
        camera: &Pinhole,
        source: &LineView,
        target: &LineView,
        pose: &Isometry3<f64>,
        reach: usize,
    ) -> Self {
        let mut sums = Self {
            // A trace of information where nothing is known.
            normal: Matrix6::identity() * 1e-6,
            gradient: Vector6::zeros(),
            found: 0,
            inside: 0,
        };
        for sample in &source.samples {
            sums.add(camera, sample, &target.smoothed, pose, reach);
        }
        sums
    }

    fn add(
        &mut self,
        camera: &Pinhole,
        sample: &LineSample,
        target: &GrayImage,
        pose: &Isometry3<f64>,
        reach: usize,
    ) -> Option<()> {
        let point = pose * nalgebra::Point3::from(sample.point);
        let next = pose * nalgebra::Point3::from(sample.next);
        let pixel = camera.project_inside(&point)?.coords;
        let along = (camera.project(&next)?.coords - pixel).try_normalize(1e-6)?;
        let right = Vector2::new(-along.y, along.x);
        let brighter = if sample.is_right_brighter {
            right
        } else {
            -right
        };
        self.inside += 1;
        let (offset, strength) = nearest_edge(target, &pixel, &brighter, &along, reach)?;
        let ratio = strength / sample.strength;
        if !(MAX_STRENGTH_RATIO.recip()..=MAX_STRENGTH_RATIO).contains(&ratio) {
            return None;
        }
        self.found += 1;
        let error = -offset / SIGMA_PX;
        let (x, y) = (camera.fx * brighter.x, camera.fy * brighter.y);
        let across = -(x * point.x + y * point.y) / point.z;
        let row = Vector3::new(x, y, across) / (point.z * SIGMA_PX);
        let turn = point.coords.cross(&row);
        let row = Vector6::new(row.x, row.y, row.z, turn.x, turn.y, turn.z);
        let weight = SAMPLE_WEIGHT * cauchy(error * error, ROBUST_BOUND).1;
        self.normal += weight * row * row.transpose();
        self.gradient += weight * error * row;
        Some(())
    }
}

/// Distance along `brighter` from a pixel to the nearest maximum of the gradient along it, and its strength in grey levels per pixel.
fn nearest_edge(
    image: &GrayImage,
    pixel: &Vector2<f64>,
    brighter: &Vector2<f64>,
    along: &Vector2<f64>,
    reach: usize,
) -> Option<(f64, f64)> {
    // Grey levels at whole distances, from `reach` + 2 pixels before the pixel: means of three along the edge.
    let mut profile = [0.0; 2 * REACHES[0] + 5];
    let profile = &mut profile[..2 * reach + 5];
    let first = reach as f64 + 2.0;
    for (at, level) in profile.iter_mut().enumerate() {
        let center = pixel + brighter * (at as f64 - first);
        for side in [-1.0, 0.0, 1.0] {
            let mut grey = [0.0];
            let at = center + along * side;
            sample(image, at.x, at.y, 1, &mut grey)?;
            *level += grey[0] / 3.0;
        }
    }
    let slope = |at: usize| 0.5 * (profile[at + 1] - profile[at - 1]);
    let edges = (2..profile.len() - 2).filter_map(|at| {
        let [before, here, after] = [at - 1, at, at + 1].map(slope);
        let bend = before - 2.0 * here + after;
        let is_edge = here >= before && here > after && here >= MIN_STRENGTH;
        is_edge.then(|| (at as f64 - first + 0.5 * (before - after) / bend, here))
    });
    edges.min_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))
}
