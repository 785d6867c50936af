//! Matching of features along epipolar lines of known poses.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Matrix3, Vector2, Vector3};

use super::features::Features;
use super::grid::FeatureGrid;
use super::options::MapPointOptions;

/// 95 % bound of the distance from an epipolar line in standard deviations: one degree of freedom.
const LINE_SIGMAS: f64 = 1.96;

/// Smallest depth in baselines. Nearer points have more than about 60 degrees of parallax, too much for a descriptor.
const NEAREST_BASELINES: f64 = 0.7;

/// Tolerance of the pyramid level predicted from depth. Corners are also found at neighbouring levels.
pub(super) const LEVEL_TOLERANCE: f64 = 2.0;

/// A match is at most this many levels coarser.
const COARSEST_LEVELS: usize = 4;

/// Candidates within this distance of the best, in pixels of its level, are the same corner and do not compete with it.
const SAME_CORNER_PX: f32 = 3.0;

/// Two features that may observe the same point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FeatureMatch {
    /// Feature of the first keyframe.
    pub first: u32,
    /// Feature of the second.
    pub second: u32,
    /// Hamming distance of their descriptors.
    pub distance: u32,
}

/// Maps pixels of one view of a pinhole camera to another view.
#[derive(Debug, Clone, Copy)]
pub struct TwoViewGeometry {
    /// Homography of the plane at infinity.
    infinity: Matrix3<f64>,
    /// Homogeneous pixel of the first centre, the epipole: added per unit of inverse depth.
    epipole: Vector3<f64>,
    baseline: f64,
}

impl TwoViewGeometry {
    /// Geometry of two views of the same pinhole camera.
    pub fn new(
        camera: &Camera,
        first_from_world: &Isometry3<f64>,
        second_from_world: &Isometry3<f64>,
    ) -> Self {
        let (fx, fy, cx, cy) = (camera.fx(), camera.fy(), camera.cx(), camera.cy());
        let k = Matrix3::new(fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0);
        let k_inverse = Matrix3::new(
            1.0 / fx,
            0.0,
            -cx / fx,
            0.0,
            1.0 / fy,
            -cy / fy,
            0.0,
            0.0,
            1.0,
        );
        let second_from_first = second_from_world * first_from_world.inverse();
        let rotation = second_from_first.rotation.to_rotation_matrix();
        Self {
            infinity: k * rotation.matrix() * k_inverse,
            epipole: k * second_from_first.translation.vector,
            baseline: second_from_first.translation.vector.norm(),
        }
    }

    /// Distance of the camera centres.
    pub fn baseline(&self) -> f64 {
        self.baseline
    }

    /// Maps a direction at a pixel of the first image to the second, by the homography of the plane at infinity.
    pub fn transfer_angle(&self, pixel: [f32; 2], angle_rad: f32) -> f32 {
        let pixel = Vector3::new(f64::from(pixel[0]), f64::from(pixel[1]), 1.0);
        let angle = f64::from(angle_rad);
        let at = self.infinity * pixel;
        // Derivative of the homography along the direction, times the squared depth.
        let along = self.infinity * Vector3::new(angle.cos(), angle.sin(), 0.0);
        let direction = along.xy() * at.z - at.xy() * along.z;
        direction.y.atan2(direction.x) as f32
    }

    /// The epipolar line of a pixel of the first image.
    fn line(&self, pixel: [f32; 2]) -> Option<EpipolarLine> {
        let pixel = Vector3::new(f64::from(pixel[0]), f64::from(pixel[1]), 1.0);
        let far = self.infinity * pixel;
        let line = far.cross(&self.epipole);
        let length = line.xy().norm();
        // Undefined at the epipole and without a baseline.
        (length > 1e-9 * far.norm() * self.epipole.norm()).then(|| EpipolarLine {
            line: line / length,
            far,
            epipole: self.epipole,
            max_rho: 1.0 / (NEAREST_BASELINES * self.baseline),
        })
    }
}

/// Possible positions in the second image of the point at a pixel of the first.
struct EpipolarLine {
    line: Vector3<f64>,
    far: Vector3<f64>,
    epipole: Vector3<f64>,
    max_rho: f64,
}

impl EpipolarLine {
    /// Bounding box of the line between infinity and the smallest depth; unbounded when one end is behind the camera.
    fn bounds(&self, margin: f64) -> ([f32; 2], [f32; 2]) {
        let near = self.far + self.epipole * self.max_rho;
        if !(self.far.z > 1e-6 && near.z > 1e-6) {
            return ([f32::NEG_INFINITY; 2], [f32::INFINITY; 2]);
        }
        let (a, b) = (self.far.xy() / self.far.z, near.xy() / near.z);
        let low = a.inf(&b) - Vector2::repeat(margin);
        let high = a.sup(&b) + Vector2::repeat(margin);
        (low.map(|x| x as f32).into(), high.map(|x| x as f32).into())
    }

    fn distance(&self, pixel: [f32; 2]) -> f64 {
        (self.line.x * f64::from(pixel[0]) + self.line.y * f64::from(pixel[1]) + self.line.z).abs()
    }

    /// Ratio of the depths in the second and the first camera, of the point whose projection is nearest to a pixel; `None`
    /// behind a camera.
    fn depth_ratio(&self, pixel: [f32; 2]) -> Option<f64> {
        let pixel = Vector2::new(f64::from(pixel[0]), f64::from(pixel[1]));
        let moved = self.epipole.xy() - pixel * self.epipole.z;
        let still = pixel * self.far.z - self.far.xy();
        // The axis along which depth moves the projection more.
        let axis = usize::from(moved.y.abs() > moved.x.abs());
        let rho = (still[axis] / moved[axis]).clamp(0.0, self.max_rho);
        let ratio = self.far.z + rho * self.epipole.z;
        (ratio > 0.0).then_some(ratio)
    }
}

/// Matches of features that agree with the epipolar geometry and in orientation, scale and descriptor. Each feature has at most
/// one match; matches are sorted by the first feature. Only features that pass the filters `is_free_in_first` and
/// `is_free_in_second` take part.
///
/// A feature is matched with the best candidate in a band around its epipolar line, when it passes the ratio test against the
/// second best. Of several features with the same best candidate the one with the smallest distance is matched.
///
/// # Complexity
/// Linear, per feature, in the features of the grid cells along its line.
#[allow(clippy::too_many_arguments)] // three arguments per image
pub fn match_along_epipolar_lines(
    geometry: &TwoViewGeometry,
    options: &MapPointOptions,
    first: &Features,
    is_free_in_first: impl Fn(usize) -> bool,
    second: &Features,
    grid_of_second: &FeatureGrid,
    is_free_in_second: impl Fn(usize) -> bool,
    pairs: &mut Vec<FeatureMatch>,
) {
    pairs.clear();
    let rotation = options.rotation_degrees.to_radians() as f32;
    let level = options.scale_factor.ln();
    let bands = bands(options, first, second);
    let mut candidates: Vec<(u32, u32)> = Vec::new();
    // The best feature of the first image for each of the second.
    let mut best: Vec<Option<FeatureMatch>> = vec![None; second.len()];
    for index in (0..first.len()).filter(|&index| is_free_in_first(index)) {
        let pixel = first.pixels[index];
        let Some(line) = geometry.line(pixel) else {
            continue;
        };
        let octave = first.octaves[index];
        let bands_here = &bands[usize::from(octave)];
        // The coarsest admissible level bounds the width of the band.
        let widest = bands_here[usize::from(octave) + COARSEST_LEVELS];
        let (low, high) = line.bounds(widest);
        let expected_angle = geometry.transfer_angle(pixel, first.angles_rad[index]);
        candidates.clear();
        let coefficients = line.line.map(|x| x as f32).into();
        grid_of_second.near_line(coefficients, widest as f32, low, high, |other| {
            let other_index = other as usize;
            if !is_free_in_second(other_index) {
                return;
            }
            let at = second.pixels[other_index];
            let in_box = (0..2).all(|axis| at[axis] >= low[axis] && at[axis] <= high[axis]);
            let band = bands_here[usize::from(second.octaves[other_index])];
            if !in_box || line.distance(at) > band {
                return;
            }
            if angle_between(second.angles_rad[other_index], expected_angle) > rotation {
                return;
            }
            let Some(ratio) = line.depth_ratio(at) else {
                return;
            };
            let expected_octave = f64::from(octave) - ratio.ln() / level;
            if (f64::from(second.octaves[other_index]) - expected_octave).abs() > LEVEL_TOLERANCE {
                return;
            }
            let distance = first.descriptors[index].distance(&second.descriptors[other_index]);
            candidates.push((distance, other));
        });
        let chosen = ratio_test(&candidates, second, options, options.ratio);
        if let Some((distance, other)) = chosen
            && distance <= options.new_descriptor_distance
        {
            let slot = &mut best[other as usize];
            if slot.is_none_or(|pair| distance < pair.distance) {
                *slot = Some(FeatureMatch {
                    first: index as u32,
                    second: other,
                    distance,
                });
            }
        }
    }
    pairs.extend(best.into_iter().flatten());
    pairs.sort_unstable_by_key(|pair| pair.first);
}

/// Half widths of the band around an epipolar line, by the levels of both features.
fn bands(options: &MapPointOptions, first: &Features, second: &Features) -> Vec<Vec<f64>> {
    let octaves = first.octaves.iter().chain(&second.octaves);
    let coarsest = octaves.copied().max().unwrap_or(0);
    let sigmas: Vec<f64> = (0..=coarsest.saturating_add(COARSEST_LEVELS as u8))
        .map(|octave| options.sigma_px(octave, options.pose_sigma_px))
        .collect();
    let band = |a: f64, b: f64| LINE_SIGMAS * a.hypot(b);
    let against = |a: f64| sigmas.iter().map(move |b| band(a, *b)).collect();
    sigmas[..=usize::from(coarsest)]
        .iter()
        .map(|sigma| against(*sigma))
        .collect()
}

/// Ratio test: the best of some candidates (distance, feature) when it is clearly better than the second best that is another
/// corner.
pub(super) fn ratio_test(
    candidates: &[(u32, u32)],
    features: &Features,
    options: &MapPointOptions,
    ratio: f64,
) -> Option<(u32, u32)> {
    let &(distance, feature) = candidates.iter().min()?;
    let at = features.pixels[feature as usize];
    let reach = SAME_CORNER_PX * options.scale(features.octaves[feature as usize]) as f32;
    let second = candidates
        .iter()
        .filter(|(_, other)| {
            let other = features.pixels[*other as usize];
            (other[0] - at[0]).hypot(other[1] - at[1]) > reach
        })
        .map(|(distance, _)| *distance)
        .min();
    second
        .is_none_or(|second| f64::from(distance) < ratio * f64::from(second))
        .then_some((distance, feature))
}

/// Angle between two directions, from 0 to pi.
pub(super) fn angle_between(a: f32, b: f32) -> f32 {
    use std::f32::consts::{PI, TAU};
    let turn = (a - b).rem_euclid(TAU);
    if turn > PI { TAU - turn } else { turn }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Translation3, UnitQuaternion};
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::super::descriptor::Descriptor;
    use super::*;

    fn camera() -> Camera {
        Camera::pinhole(520.0, 525.0, 319.5, 239.5).unwrap()
    }

    fn view(x: f64, y: f64, z: f64, turn: f64, roll: f64) -> Isometry3<f64> {
        Isometry3::from_parts(
            Translation3::new(x, y, z),
            UnitQuaternion::from_euler_angles(0.0, turn, roll),
        )
        .inverse()
    }

    fn seen(
        points: &[(Point3<f64>, Descriptor)],
        camera_from_world: &Isometry3<f64>,
        roll: f32,
    ) -> Features {
        let mut features = Features::default();
        for (point, descriptor) in points {
            let pixel = camera().project(&(camera_from_world * point)).unwrap();
            features.pixels.push([pixel.x as f32, pixel.y as f32]);
            features.octaves.push(1);
            features.angles_rad.push(0.4 - roll);
            features.descriptors.push(*descriptor);
            features.grey.push(0);
        }
        features
    }

    fn scene(count: usize) -> Vec<(Point3<f64>, Descriptor)> {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        (0..count)
            .map(|_| {
                let point = Point3::new(
                    random.random_range(-1.0..1.0),
                    random.random_range(-0.8..0.8),
                    random.random_range(2.0..4.0),
                );
                (point, Descriptor([(); 4].map(|()| random.random())))
            })
            .collect()
    }

    #[test]
    fn points_find_themselves_in_any_direction_of_motion() {
        let points = scene(300);
        let options = MapPointOptions::default();
        for (x, y, z, turn, roll) in [
            (0.3, 0.0, 0.0, 0.05, 0.0),
            (0.0, 0.3, 0.0, 0.0, 0.3),
            (0.02, 0.0, 0.4, 0.0, -0.2),
            (-0.2, 0.2, -0.3, -0.1, 1.5),
        ] {
            let (first, second) = (view(0.0, 0.0, 0.0, 0.0, 0.0), view(x, y, z, turn, roll));
            let geometry = TwoViewGeometry::new(&camera(), &first, &second);
            let (a, b) = (
                seen(&points, &first, 0.0),
                seen(&points, &second, roll as f32),
            );
            let grid = FeatureGrid::new(&b.pixels);
            let mut pairs = Vec::new();
            match_along_epipolar_lines(
                &geometry,
                &options,
                &a,
                |_| true,
                &b,
                &grid,
                |index| index % 10 != 0,
                &mut pairs,
            );
            assert!(pairs.len() >= 265, "{} for {x} {y} {z}", pairs.len());
            assert!(
                pairs
                    .iter()
                    .all(|p| p.first == p.second && p.distance == 0 && p.second % 10 != 0)
            );
        }
    }

    #[test]
    fn without_a_baseline_there_is_no_line() {
        let points = scene(50);
        let (first, second) = (view(0.0, 0.0, 0.0, 0.0, 0.0), view(0.0, 0.0, 0.0, 0.1, 0.0));
        let geometry = TwoViewGeometry::new(&camera(), &first, &second);
        let (a, b) = (seen(&points, &first, 0.0), seen(&points, &second, 0.0));
        let mut pairs = vec![];
        let grid = FeatureGrid::new(&b.pixels);
        let options = MapPointOptions::default();
        match_along_epipolar_lines(
            &geometry,
            &options,
            &a,
            |_| true,
            &b,
            &grid,
            |_| true,
            &mut pairs,
        );
        assert_eq!((pairs.len(), geometry.baseline()), (0, 0.0));
    }

    #[test]
    fn a_repeated_pattern_is_not_matched_but_the_same_corner_twice_is() {
        let mut points = scene(1);
        let twin = (points[0].0 + Vector3::new(0.2, 0.0, 0.0), points[0].1);
        points.push(twin);
        let (first, second) = (view(0.0, 0.0, 0.0, 0.0, 0.0), view(0.3, 0.0, 0.0, 0.0, 0.0));
        let geometry = TwoViewGeometry::new(&camera(), &first, &second);
        let options = MapPointOptions::default();
        let mut pairs = Vec::new();
        let (a, mut b) = (seen(&points, &first, 0.0), seen(&points, &second, 0.0));
        let mut count = |b: &Features| {
            let grid = FeatureGrid::new(&b.pixels);
            match_along_epipolar_lines(
                &geometry,
                &options,
                &a,
                |_| true,
                b,
                &grid,
                |_| true,
                &mut pairs,
            );
            pairs.len()
        };
        assert_eq!(count(&b), 0);
        b.pixels[1] = [b.pixels[0][0] + 2.0, b.pixels[0][1]];
        assert_eq!(count(&b), 1);
    }

    #[test]
    fn angles_wrap() {
        use std::f32::consts::PI;
        assert!((angle_between(PI - 0.1, -PI + 0.1) - 0.2).abs() < 1e-5);
        assert!((angle_between(0.3, 0.5) - 0.2).abs() < 1e-6);
    }
}
