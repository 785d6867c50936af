//! The surfaces of several keyframes, fused in the view of one of them.

use rayon::prelude::*;

use super::field::Grid;
use super::fill::fill;
use super::free_space::FreeSpace;
use super::warp::{SurfaceView, warp};
use crate::triangulation::{SurfaceSample, SurfaceSamples};

/// Inverse depths that differ by at most this many standard deviations of their difference agree.
const GATE_SIGMAS: f32 = 2.0;
/// Standard deviation of a fused sample, in those of the samples it is the mean of: pose and lens errors, which the keyframes have in common,
/// do not show where they are compared. Measured beside depth cameras, where more than 85 % of the errors lie within two deviations.
const COMMON_ERROR: f32 = 2.0;

/// The surface of a keyframe from its own samples and those that `others` see in its view. At each grid pixel the inverse depth is taken on
/// which the samples with the largest weight agree, and their weighted mean. Its standard deviation is twice that of one sample: neighbouring
/// keyframes share images and pose errors, which do not average out. Where more keyframes see a surface behind that place than agree with it, the
/// pixel stays open. Then open pixels are closed where the samples around them lie on a plane; `is_open` flags the grid pixels without an
/// image edge, row by row.
///
/// Poses have to fit the images: the samples of keyframes are compared within their standard deviations.
///
/// The result does not depend on the number of threads.
///
/// # Complexity
/// O(grid pixels x n^2) for `n` keyframes.
///
/// # Reference
/// The idea is that of P. Merrell et al., Real-Time Visibility-Based Fusion of Depth Maps, ICCV 2007.
///
/// *Differs from the paper*: planes in place of depths; what most agree on, in place of a balance of occlusions.
pub fn fuse_surfaces(
    reference: &SurfaceView<'_>,
    others: &[SurfaceView<'_>],
    is_open: &[bool],
) -> SurfaceSamples {
    let own = reference.samples;
    let (columns, rows) = (own.columns(), own.rows());
    let warped: Vec<Vec<SurfaceSample>> = others
        .par_iter()
        .map(|other| warp(reference, other))
        .collect();
    let free_space = FreeSpace::new(reference, others);
    let mut samples = vec![SurfaceSample::default(); columns * rows];
    samples
        .par_iter_mut()
        .enumerate()
        .for_each_init(Vec::new, |seen, (index, fused)| {
            let (column, row) = (index % columns, index / columns);
            seen.clear();
            seen.extend(own.get(column, row));
            let others = warped.iter().map(|samples| samples[index]);
            seen.extend(others.filter(|sample| sample.rho > 0.0));
            if let Some((sample, agreeing)) = agreement(seen)
                && free_space.keyframes_behind(&own.pixel(column, row), &sample) <= agreeing
            {
                *fused = sample;
            }
        });
    if is_open.len() == samples.len() {
        let spacing = own.step_px() as f32;
        let grid = Grid {
            columns,
            rows,
            spacing,
            offset: 0.0,
        };
        fill(&grid, &mut samples, is_open);
    }
    for sample in &mut samples {
        sample.sigma *= COMMON_ERROR;
    }
    SurfaceSamples::new(own.step_px(), columns, rows, samples)
}

fn agree(a: &SurfaceSample, b: &SurfaceSample) -> bool {
    (a.rho - b.rho).abs() <= GATE_SIGMAS * a.sigma.hypot(b.sigma)
}

fn weight(sample: &SurfaceSample) -> f32 {
    sample.sigma.powi(-2)
}

/// The weighted mean of those samples at a pixel that agree with the one that has the most weight on its side, and their number.
fn agreement(seen: &[SurfaceSample]) -> Option<(SurfaceSample, usize)> {
    let with = |center: &SurfaceSample| -> f32 {
        let agreeing = seen.iter().filter(|other| agree(center, other));
        agreeing.map(weight).sum::<f32>() * center.rho * center.rho
    };
    let mut best: Option<(f32, &SurfaceSample)> = None;
    for center in seen {
        let total = with(center);
        if best.is_none_or(|(most, _)| total > most) {
            best = Some((total, center));
        }
    }
    let (_, center) = best?;
    let (mut weights, mut rho, mut slope, mut count) = (0.0, 0.0, [0.0; 2], 0);
    for sample in seen.iter().filter(|other| agree(center, other)) {
        let weight = weight(sample);
        weights += weight;
        count += 1;
        rho += weight * sample.rho;
        for (sum, component) in slope.iter_mut().zip(sample.slope) {
            *sum += weight * component;
        }
    }
    let sample = SurfaceSample {
        rho: rho / weights,
        slope: slope.map(|sum| sum / weights),
        sigma: (count as f32 / weights).sqrt(),
    };
    Some((sample, count))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Vector3};

    use super::*;
    use crate::camera::Camera;

    const COLUMNS: usize = 40;
    const ROWS: usize = 30;
    const STEP: u32 = 4;

    fn camera() -> Camera {
        Camera::pinhole(150.0, 150.0, 80.0, 60.0).unwrap()
    }

    /// The wall `z = 2 + 0.3 x` of the world, seen by a camera; `error` is added to inverse depths, as a share.
    fn wall(pose: &Isometry3<f64>, error: f64, is_seen: impl Fn(usize) -> bool) -> SurfaceSamples {
        let camera = camera();
        let normal = Vector3::new(-0.3, 0.0, 1.0);
        let distance = 2.0 - normal.dot(&pose.translation.vector);
        let normal = pose.rotation.inverse() * normal / distance;
        let samples = (0..COLUMNS * ROWS).map(|index| {
            if !is_seen(index % COLUMNS) {
                return SurfaceSample::default();
            }
            let at = |index: usize| f64::from(STEP) * index as f64 + f64::from(STEP / 2);
            let ray = Vector3::new(
                (at(index % COLUMNS) - camera.cx()) / camera.fx(),
                (at(index / COLUMNS) - camera.cy()) / camera.fy(),
                1.0,
            );
            let share = 1.0 + error;
            SurfaceSample {
                rho: (share * normal.dot(&ray)) as f32,
                slope: [
                    share * normal.x / camera.fx(),
                    share * normal.y / camera.fy(),
                ]
                .map(|component| component as f32),
                sigma: (0.01 * normal.dot(&ray)) as f32,
            }
        });
        SurfaceSamples::new(STEP, COLUMNS, ROWS, samples.collect())
    }

    fn poses() -> Vec<Isometry3<f64>> {
        [[0.0, 0.0], [0.2, 0.0], [-0.2, 0.1], [0.1, -0.2]]
            .iter()
            .map(|[x, y]| {
                Isometry3::new(
                    Vector3::new(*x, *y, 0.1 * x),
                    Vector3::new(0.1 * y, -0.2 * x, 0.1),
                )
            })
            .collect()
    }

    fn fused(surfaces: &[SurfaceSamples], is_open: &[bool]) -> SurfaceSamples {
        let (camera, poses) = (camera(), poses());
        let views = SurfaceView::from_poses(surfaces, &camera, &poses);
        fuse_surfaces(&views[0], &views[1..], is_open)
    }

    fn shares_of_truth(surface: &SurfaceSamples) -> Vec<f32> {
        let truth = wall(&poses()[0], 0.0, |_| true);
        (0..COLUMNS * ROWS)
            .filter_map(|index| {
                let (column, row) = (index % COLUMNS, index / COLUMNS);
                Some(surface.get(column, row)?.rho / truth.get(column, row)?.rho)
            })
            .collect()
    }

    #[test]
    fn what_other_keyframes_saw_is_where_it_is() {
        let poses = poses();
        let mut surfaces: Vec<SurfaceSamples> =
            poses.iter().map(|pose| wall(pose, 0.0, |_| true)).collect();
        surfaces[0] = wall(&poses[0], 0.0, |_| false);
        let shares = shares_of_truth(&fused(&surfaces, &[]));
        assert!(shares.len() > COLUMNS * ROWS * 9 / 10, "{}", shares.len());
        assert!(shares.iter().all(|share| (share - 1.0).abs() < 1e-4));
    }

    #[test]
    fn noise_is_averaged_and_an_outlier_is_outvoted() {
        let poses = poses();
        let errors = [0.3, 0.01, -0.008, 0.004];
        let surfaces: Vec<SurfaceSamples> = poses
            .iter()
            .zip(errors)
            .map(|(pose, error)| wall(pose, error, |_| true))
            .collect();
        let fused = fused(&surfaces, &[]);
        let near = shares_of_truth(&fused)
            .iter()
            .filter(|share| (**share - 1.0).abs() < 0.005)
            .count();
        assert!(near > COLUMNS * ROWS * 8 / 10, "{near}");
        // Keyframes that agree are as certain as one of them, but for what they have in common.
        let certain = fused.get(20, 15).unwrap();
        let relative = certain.sigma / certain.rho;
        assert!(
            (relative - COMMON_ERROR * 0.01).abs() < 0.002,
            "{certain:?}"
        );
    }

    #[test]
    fn a_place_that_other_keyframes_look_through_is_dropped() {
        let (camera, poses) = (camera(), poses());
        let [column, row] = [20, 15];
        // Nearer than the wall, and nobody measured the wall behind it.
        let own = wall(&poses[0], 0.8, |it| it == column);
        let truth = wall(&poses[0], 0.0, |_| true).get(column, row).unwrap();
        let depth = 1.0 / f64::from(truth.rho);
        let pixel = own.pixel(column, row);
        let point = poses[0] * camera.point_at_depth(&pixel, depth).unwrap();
        let others = poses[1..].iter().map(|pose| {
            let hidden = camera
                .project(&pose.inverse_transform_point(&point))
                .unwrap();
            let hidden = hidden.x / f64::from(STEP) - 0.5;
            wall(pose, 0.0, |it| (it as f64 - hidden).abs() > 1.5)
        });
        let surfaces: Vec<SurfaceSamples> = std::iter::once(own).chain(others).collect();
        assert!(fused(&surfaces[..1], &[]).get(column, row).is_some());
        assert!(fused(&surfaces, &[]).get(column, row).is_none());
    }

    #[test]
    fn places_without_texture_are_closed_where_there_is_no_edge() {
        let surface = wall(&poses()[0], 0.0, |column| !(12..28).contains(&column));
        let missing = surface.known_count();
        let all_open = vec![true; COLUMNS * ROWS];
        let closed = fused(std::slice::from_ref(&surface), &all_open);
        assert!(
            closed.known_count() > COLUMNS * ROWS * 9 / 10,
            "{}",
            closed.known_count()
        );
        assert!(
            shares_of_truth(&closed)
                .iter()
                .all(|share| (share - 1.0).abs() < 0.01)
        );
        let all_edges = vec![false; COLUMNS * ROWS];
        assert_eq!(fused(&[surface], &all_edges).known_count(), missing);
    }

    #[test]
    fn a_wall_seen_from_behind_or_no_wall_adds_nothing() {
        let poses = poses();
        let camera = camera();
        let (own, seen) = (
            wall(&poses[0], 0.0, |_| false),
            wall(&poses[1], 0.0, |_| true),
        );
        let behind = Isometry3::new(
            Vector3::new(0.0, 0.0, 6.0),
            Vector3::new(0.0, std::f64::consts::PI, 0.0),
        );
        let view = |samples, world_from_camera| SurfaceView {
            samples,
            camera: &camera,
            world_from_camera,
        };
        let none = fuse_surfaces(&view(&own, &behind), &[view(&seen, &poses[1])], &[]);
        assert_eq!(none.known_count(), 0);
        let empty = SurfaceSamples::default();
        let fused = fuse_surfaces(&view(&empty, &poses[0]), &[view(&seen, &poses[1])], &[]);
        assert_eq!(fused.known_count(), 0);
    }
}
