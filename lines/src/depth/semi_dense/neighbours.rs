//! Which keyframes measure the depth of another one best.

use nalgebra::{Isometry3, Matrix2, Point2, Point3, Vector2};

use crate::camera::Camera;

/// Camera, pose and image size of a keyframe.
#[derive(Debug, Clone)]
pub struct ViewGeometry {
    /// The pinhole camera.
    pub camera: Camera,
    /// Its pose.
    pub world_from_camera: Isometry3<f64>,
    /// Width of the image in pixels.
    pub width: usize,
    /// Height of the image in pixels.
    pub height: usize,
}

/// Settings of [`choose_neighbours`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct NeighbourOptions {
    /// N: neighbours that are used at most.
    pub count: usize,
    /// Least share of the reference image that a neighbour sees.
    pub least_overlap: f64,
    /// Least angle between the views of a place at the median depth.
    pub least_parallax_rad: f64,
    /// Largest such angle: beyond it the same place looks too different.
    pub largest_parallax_rad: f64,
    /// Relative precision of depth that is sought: neighbours are added where it is not reached.
    pub precision: f64,
    /// Standard deviation of a match in pixels that the choice reckons with.
    pub match_sigma_px: f64,
}

impl Default for NeighbourOptions {
    fn default() -> Self {
        Self {
            count: 10,
            least_overlap: 0.3,
            least_parallax_rad: 1.0_f64.to_radians(),
            largest_parallax_rad: 35.0_f64.to_radians(),
            precision: 0.01,
            match_sigma_px: 1.0,
        }
    }
}

/// Places of the reference image that are looked at, across and down.
const GRID: [usize; 2] = [8, 6];
/// Depths there, in median depths.
const DEPTHS: [f64; 3] = [0.6, 1.0, 1.8];
const PLACES: usize = GRID[0] * GRID[1] * DEPTHS.len();

/// Positions among `candidates` of the neighbours to measure the depth of `reference` with, best first.
///
/// A neighbour tells about the depth of a place as far as its image moves with it, along the epipolar line, and thereby only about
/// edges across that line. The neighbours are chosen one by one so that the information on all directions and places together grows most, as
/// in a D-optimal design: with logarithms, a second baseline in a new direction counts more than one more in the same.
///
/// `median_depth` is that of the scene, or of what is known of the reference.
///
/// # Complexity
/// O(candidates x count).
pub fn choose_neighbours(
    reference: &ViewGeometry,
    candidates: &[&ViewGeometry],
    median_depth: f64,
    options: &NeighbourOptions,
) -> Vec<usize> {
    if !(median_depth > 0.0 && median_depth.is_finite()) {
        return Vec::new();
    }
    let mut usable: Vec<(usize, Vec<Vector2<f64>>)> = candidates
        .iter()
        .enumerate()
        .filter_map(|(index, view)| Some((index, motions(reference, view, median_depth, options)?)))
        .collect();
    let mut information: Vec<Matrix2<f64>> = vec![Matrix2::identity(); PLACES];
    let mut chosen = Vec::with_capacity(options.count);
    while chosen.len() < options.count && !usable.is_empty() {
        let gain = |motions: &[Vector2<f64>]| -> f64 {
            information
                .iter()
                .zip(motions)
                .map(|(known, motion)| {
                    // det(A + m m') / det(A) = 1 + m' A^-1 m
                    let adjugate =
                        Matrix2::new(known[(1, 1)], -known[(0, 1)], -known[(1, 0)], known[(0, 0)]);
                    (motion.dot(&(adjugate * motion)) / known.determinant()).ln_1p()
                })
                .sum()
        };
        let best = usable
            .iter()
            .enumerate()
            .map(|(position, (index, motions))| (gain(motions), *index, position))
            .max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let Some((_, index, position)) = best else {
            break;
        };
        let (_, motions) = usable.remove(position);
        for (known, motion) in information.iter_mut().zip(&motions) {
            *known += motion * motion.transpose();
        }
        chosen.push(index);
    }
    chosen
}

/// How a neighbour's image of each place moves when its depth changes by the sought precision, in standard deviations of a match,
/// along the epipolar line in the reference; zero where it does not see the place. `None` of a neighbour that is of no use.
fn motions(
    reference: &ViewGeometry,
    view: &ViewGeometry,
    median_depth: f64,
    options: &NeighbourOptions,
) -> Option<Vec<Vector2<f64>>> {
    let view_from_reference = view.world_from_camera.inverse() * reference.world_from_camera;
    let center = Point3::from(view_from_reference.inverse().translation.vector);
    let mut result = Vec::with_capacity(PLACES);
    let (mut seen, mut looked_at, mut parallax) = (0.0, 0.0, 0.0);
    for row in 0..GRID[1] {
        for column in 0..GRID[0] {
            let pixel = Point2::new(
                (column as f64 + 0.5) / GRID[0] as f64 * reference.width as f64 - 0.5,
                (row as f64 + 0.5) / GRID[1] as f64 * reference.height as f64 - 0.5,
            );
            for share in DEPTHS {
                looked_at += 1.0;
                let motion = motion(
                    reference,
                    view,
                    &view_from_reference,
                    &center,
                    &pixel,
                    share * median_depth,
                    options,
                );
                let Some((motion, angle)) = motion else {
                    result.push(Vector2::zeros());
                    continue;
                };
                seen += 1.0;
                parallax += angle;
                result.push(motion);
            }
        }
    }
    let is_useful =
        seen >= options.least_overlap * looked_at && parallax >= options.least_parallax_rad * seen;
    (is_useful && seen > 0.0).then_some(result)
}

/// The motion at one place and the angle between the two views of it; `None` when the neighbour does not see it or too differently.
fn motion(
    reference: &ViewGeometry,
    view: &ViewGeometry,
    view_from_reference: &Isometry3<f64>,
    center: &Point3<f64>,
    pixel: &Point2<f64>,
    depth: f64,
    options: &NeighbourOptions,
) -> Option<(Vector2<f64>, f64)> {
    let point = reference.camera.point_at_depth(pixel, depth).ok()?;
    let place = |depth_factor: f64| -> Option<Point2<f64>> {
        view.camera
            .project(&(view_from_reference * Point3::from(point.coords * depth_factor)))
    };
    let at = place(1.0)?;
    let (right, bottom) = (view.width as f64 - 1.0, view.height as f64 - 1.0);
    if !(at.x >= 0.0 && at.y >= 0.0 && at.x <= right && at.y <= bottom) {
        return None;
    }
    let angle = point.coords.angle(&(point - center));
    if !(angle <= options.largest_parallax_rad) {
        return None;
    }
    let moved = (place(1.0 + options.precision)? - at).norm() / options.match_sigma_px;
    // Towards the epipole: where the neighbour's centre appears.
    let homogeneous = Vector2::new(
        reference.camera.fx() * center.x + reference.camera.cx() * center.z,
        reference.camera.fy() * center.y + reference.camera.cy() * center.z,
    ) - pixel.coords * center.z;
    let direction = homogeneous.try_normalize(0.0)?;
    // The closer to the limit, the less alike the views.
    let fading = 1.0 - (angle / options.largest_parallax_rad).powi(2);
    Some((direction * moved * fading, angle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn at(x: f64, y: f64, z: f64, turn: f64) -> ViewGeometry {
        ViewGeometry {
            camera: Camera::pinhole(500.0, 500.0, 319.5, 239.5).unwrap(),
            world_from_camera: Isometry3::from_parts(
                Vector3::new(x, y, z).into(),
                UnitQuaternion::from_scaled_axis(Vector3::new(0.0, turn, 0.0)),
            ),
            width: 640,
            height: 480,
        }
    }

    fn choose(candidates: &[ViewGeometry], options: &NeighbourOptions) -> Vec<usize> {
        let views: Vec<&ViewGeometry> = candidates.iter().collect();
        choose_neighbours(&at(0.0, 0.0, 0.0, 0.0), &views, 2.0, options)
    }

    #[test]
    fn views_without_baseline_or_overlap_are_left_out() {
        let candidates = [
            at(0.0, 0.0, 0.0, 0.1),
            at(0.001, 0.0, 0.0, 0.0),
            at(0.3, 0.0, 0.0, 3.1),
            at(0.3, 0.0, 0.0, 0.0),
            at(5.0, 0.0, 0.0, 0.0),
            at(f64::NAN, 0.0, 0.0, 0.0),
        ];
        assert_eq!(choose(&candidates, &NeighbourOptions::default()), [3]);
    }

    #[test]
    fn a_second_direction_is_worth_more_than_the_same_again() {
        let candidates = [
            at(0.30, 0.0, 0.0, 0.0),
            at(0.28, 0.0, 0.0, 0.0),
            at(0.0, 0.2, 0.0, 0.0),
        ];
        let options = NeighbourOptions {
            count: 2,
            precision: 0.05,
            ..NeighbourOptions::default()
        };
        let chosen = choose(&candidates, &options);
        assert_eq!(chosen.len(), 2);
        assert!(chosen.contains(&2), "{chosen:?}");
    }

    #[test]
    fn scale_of_the_scene_changes_nothing() {
        let scaled = |s: f64| -> Vec<usize> {
            let candidates: Vec<ViewGeometry> = (1..9)
                .map(|i| {
                    at(
                        0.1 * s * f64::from(i),
                        0.03 * s * f64::from(i % 3),
                        0.0,
                        0.0,
                    )
                })
                .collect();
            let views: Vec<&ViewGeometry> = candidates.iter().collect();
            choose_neighbours(
                &at(0.0, 0.0, 0.0, 0.0),
                &views,
                2.0 * s,
                &NeighbourOptions {
                    count: 7,
                    ..NeighbourOptions::default()
                },
            )
        };
        let chosen = scaled(1.0);
        assert_eq!(chosen.len(), 7);
        assert_eq!(
            (scaled(1024.0), scaled(1.0 / 1024.0)),
            (chosen.clone(), chosen)
        );
    }
}
