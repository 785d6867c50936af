//! Choice of the neighbours that constrain the depth of a keyframe best.

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
#[non_exhaustive]
pub struct NeighbourOptions {
    /// Largest number of neighbours.
    pub count: usize,
    /// Least visible share of the sampled points of the reference.
    pub least_overlap: f64,
    /// Least mean parallax angle of the points that the neighbour sees.
    pub least_parallax_rad: f64,
    /// Largest parallax angle of a point; beyond it the appearance changes too much.
    pub largest_parallax_rad: f64,
    /// Target relative precision of depth; sets the weight of a motion in the image.
    pub precision: f64,
    /// Assumed standard deviation of a match in pixels.
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

/// Grid of sampled pixels of the reference, columns and rows.
const GRID: [usize; 2] = [8, 6];
/// Sampled depths, in median depths.
const DEPTHS: [f64; 3] = [0.6, 1.0, 1.8];
const POINTS: usize = GRID[0] * GRID[1] * DEPTHS.len();

/// Indices in `candidates` of the neighbours for estimating the depth of `reference`, best first.
///
/// A neighbour constrains the depth of a point by the motion of its image along the epipolar line, and so only on edges across that line.
/// The choice is greedy and D-optimal: each step adds the neighbour with the largest gain of log-determinant of the information, summed
/// over points. A baseline in a new direction therefore counts more than another one in the same direction.
///
/// `median_depth` is the median depth of the scene or of the reference.
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
    let mut information: Vec<Matrix2<f64>> = vec![Matrix2::identity(); POINTS];
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

/// Motion of each point in the neighbour when its depth changes by the target precision, in standard deviations of a match and directed
/// along the epipolar line in the reference; zero where the point is not visible. `None` for an unsuitable neighbour.
fn motions(
    reference: &ViewGeometry,
    view: &ViewGeometry,
    median_depth: f64,
    options: &NeighbourOptions,
) -> Option<Vec<Vector2<f64>>> {
    let view_from_reference = view.world_from_camera.inverse() * reference.world_from_camera;
    let center = Point3::from(view_from_reference.inverse().translation.vector);
    let mut result = Vec::with_capacity(POINTS);
    let (mut seen, mut total, mut parallax) = (0.0, 0.0, 0.0);
    for row in 0..GRID[1] {
        for column in 0..GRID[0] {
            let pixel = Point2::new(
                (column as f64 + 0.5) / GRID[0] as f64 * reference.width as f64 - 0.5,
                (row as f64 + 0.5) / GRID[1] as f64 * reference.height as f64 - 0.5,
            );
            for share in DEPTHS {
                total += 1.0;
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
        seen >= options.least_overlap * total && parallax >= options.least_parallax_rad * seen;
    (is_useful && seen > 0.0).then_some(result)
}

/// Motion and parallax angle of one point; `None` when it is not visible or the parallax is too large.
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
    let project_at = |depth_factor: f64| -> Option<Point2<f64>> {
        view.camera
            .project(&(view_from_reference * Point3::from(point.coords * depth_factor)))
    };
    let at = project_at(1.0)?;
    let (right, bottom) = (view.width as f64 - 1.0, view.height as f64 - 1.0);
    if !(at.x >= 0.0 && at.y >= 0.0 && at.x <= right && at.y <= bottom) {
        return None;
    }
    let angle = point.coords.angle(&(point - center));
    if !(angle <= options.largest_parallax_rad) {
        return None;
    }
    let moved = (project_at(1.0 + options.precision)? - at).norm() / options.match_sigma_px;
    // Towards the epipole, the image of the neighbour's centre.
    let homogeneous = Vector2::new(
        reference.camera.fx() * center.x + reference.camera.cx() * center.z,
        reference.camera.fy() * center.y + reference.camera.cy() * center.z,
    ) - pixel.coords * center.z;
    let direction = homogeneous.try_normalize(0.0)?;
    // Similarity of appearance falls with the parallax.
    let fading = 1.0 - (angle / options.largest_parallax_rad).powi(2);
    Some((direction * moved * fading, angle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{UnitQuaternion, Vector3};

    fn at(x: f64, y: f64, z: f64, yaw: f64) -> ViewGeometry {
        ViewGeometry {
            camera: Camera::pinhole(500.0, 500.0, 319.5, 239.5).unwrap(),
            world_from_camera: Isometry3::from_parts(
                Vector3::new(x, y, z).into(),
                UnitQuaternion::from_scaled_axis(Vector3::new(0.0, yaw, 0.0)),
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
