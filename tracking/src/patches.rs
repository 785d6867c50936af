//! Alignment of a patch around a feature with the image around another, to a fraction of a pixel.

use linecarve_points::{PATCH_SIDE, Patch};
use nalgebra::{Isometry3, Matrix2, Matrix4, Point3, Vector2, Vector4};

use crate::camera::Pinhole;

/// Samples along a side of a template. Its border, and the reach of the search, fit into a patch.
const SIDE: usize = 7;
const BORDERED: usize = SIDE + 2;

/// Position of the feature in a patch.
const CENTRE: f64 = (PATCH_SIDE / 2) as f64;

/// Largest distance in pixels of the level between a feature and where its point is found.
const REACH_PX: f64 = 1.5;

/// Steps of the fit, and the length in pixels of the last.
const STEPS: usize = 8;
const LAST_STEP_PX: f64 = 0.01;

/// Least correlation of a template with the image.
const MIN_CORRELATION: f64 = 0.85;

/// Least standard deviation of the grey values of a template.
const MIN_CONTRAST: f64 = 4.0;

/// Derivative of the pixel of a point in a target image by that in a reference image, on a plane through the point that faces the
/// reference camera. `None` behind a camera.
pub(crate) fn plane_warp(
    camera: &Pinhole,
    target_from_reference: &Isometry3<f64>,
    point_in_reference: &Point3<f64>,
) -> Option<Matrix2<f64>> {
    let normal = &point_in_reference.coords;
    let from = camera.project(point_in_reference)?;
    let to = camera.project(&(target_from_reference * point_in_reference))?;
    let column = |step: Vector2<f64>| {
        let ray = camera.ray(&(from + step));
        let on_plane = Point3::from(ray * (normal.norm_squared() / normal.dot(&ray)));
        Some(camera.project(&(target_from_reference * on_plane))? - to)
    };
    Some(Matrix2::from_columns(&[
        column(Vector2::x())?,
        column(Vector2::y())?,
    ]))
}

/// A patch of a reference image as it should look in a target image.
#[derive(Debug)]
pub(crate) struct Template {
    /// Grey value, one, and the slopes along x and y of each sample.
    samples: [Vector4<f64>; SIDE * SIDE],
    /// Inverse of the sum of their squares.
    inverse: Matrix4<f64>,
    mean: f64,
    /// Sum of squared deviations from the mean.
    variation: f64,
}

impl Template {
    /// The template around a feature plus `shift`, both in pixels of its level. `step` is the motion in the patch for a pixel of the
    /// target's level. `None` where it would leave the patch, or has no texture in two directions.
    pub(crate) fn new(patch: &Patch, shift: [f32; 2], step: &Matrix2<f64>) -> Option<Self> {
        let half = (BORDERED / 2) as f64;
        let centre = Vector2::from(shift.map(|along| CENTRE + f64::from(along)));
        let mut values = [0.0; BORDERED * BORDERED];
        for (at, value) in values.iter_mut().enumerate() {
            let offset = [at % BORDERED, at / BORDERED].map(|along| along as f64 - half);
            *value = sample(patch, &(centre + step * Vector2::from(offset)))?;
        }
        let samples = std::array::from_fn(|at| {
            let at = (at / SIDE + 1) * BORDERED + at % SIDE + 1;
            let slope = |reach: usize| 0.5 * (values[at + reach] - values[at - reach]);
            Vector4::new(values[at], 1.0, slope(1), slope(BORDERED))
        });
        let products = samples.iter().map(|one| one * one.transpose());
        let normal: Matrix4<f64> = products.sum();
        let count = (SIDE * SIDE) as f64;
        let mean = normal[(0, 1)] / count;
        let variation = normal[(0, 0)] - mean * mean * count;
        if variation < MIN_CONTRAST * MIN_CONTRAST * count {
            return None;
        }
        Some(Self {
            samples,
            inverse: normal.try_inverse()?,
            mean,
            variation,
        })
    }

    /// Position of the template relative to a feature of the target, in pixels of its level. `None` when the fit does not converge
    /// nearby, or the two differ too much.
    ///
    /// Inverse compositional: gain, offset and shift are linear in the template and its slopes, so that their normal equations do not change.
    ///
    /// # Reference
    /// Baker and Matthews, "Lucas-Kanade 20 Years On", IJCV 2004, section 3.2.
    pub(crate) fn find(&self, patch: &Patch) -> Option<[f32; 2]> {
        let half = Vector2::repeat((SIDE / 2) as f64);
        let feature = Vector2::repeat(CENTRE);
        let mut at = feature;
        for _ in 0..STEPS {
            if (at - feature).norm() > REACH_PX {
                return None;
            }
            let (sums, squares) = self.products(patch, &(at - half));
            let [gain, _, x, y] = (self.inverse * sums).into();
            if gain <= 0.0 {
                return None;
            }
            let step = Vector2::new(x, y) / gain;
            let length = step.norm();
            if length < LAST_STEP_PX {
                let count = (SIDE * SIDE) as f64;
                let variation = squares - sums[1] * sums[1] / count;
                let correlation =
                    (sums[0] - self.mean * sums[1]) / (variation * self.variation).sqrt();
                let shift = at - step - feature;
                return (correlation >= MIN_CORRELATION).then(|| [shift.x as f32, shift.y as f32]);
            }
            at -= step / length.max(1.0);
        }
        None
    }

    /// Sums of the products of the samples with those of a patch from a corner on, which lies inside, and of the squares of the latter.
    fn products(&self, patch: &Patch, corner: &Vector2<f64>) -> (Vector4<f64>, f64) {
        let (column, row) = (corner.x as usize, corner.y as usize);
        let (ax, ay) = (corner.x - column as f64, corner.y - row as f64);
        let (mut sums, mut squares) = (Vector4::zeros(), 0.0);
        for (y, samples) in self.samples.chunks_exact(SIDE).enumerate() {
            let from = (row + y) * PATCH_SIDE + column;
            let (above, below) = (&patch[from..], &patch[from + PATCH_SIDE..]);
            for (x, sample) in samples.iter().enumerate() {
                let value = blend([above[x], above[x + 1], below[x], below[x + 1]], ax, ay);
                sums += sample * value;
                squares += value * value;
            }
        }
        (sums, squares)
    }
}

/// Bilinear interpolation between two samples of a row and the two below.
fn blend(samples: [u8; 4], ax: f64, ay: f64) -> f64 {
    let [a, b, c, d] = samples.map(f64::from);
    (a * (1.0 - ax) + b * ax) * (1.0 - ay) + (c * (1.0 - ax) + d * ax) * ay
}

/// Value of a patch between its samples; `None` outside.
fn sample(patch: &Patch, at: &Vector2<f64>) -> Option<f64> {
    let inside = 0.0..(PATCH_SIDE - 1) as f64;
    if !inside.contains(&at.x) || !inside.contains(&at.y) {
        return None;
    }
    let (column, row) = (at.x as usize, at.y as usize);
    let from = row * PATCH_SIDE + column;
    let below = from + PATCH_SIDE;
    let samples = [patch[from], patch[from + 1], patch[below], patch[below + 1]];
    Some(blend(samples, at.x - column as f64, at.y - row as f64))
}

#[cfg(test)]
mod tests {
    use linecarve_lines::camera::Camera;
    use nalgebra::Vector3;

    use super::*;
    use crate::stereo::tests::wall;

    /// The patch around a position whose neighbours are `step` apart.
    fn patch(at: [f64; 2], step: &Matrix2<f64>, gain: f64, offset: f64) -> Patch {
        std::array::from_fn(|sample| {
            let along = [sample % PATCH_SIDE, sample / PATCH_SIDE];
            let from = Vector2::from(along.map(|along| along as f64 - CENTRE));
            let position = Vector2::from(at) + step * from;
            (gain * wall(position.x, position.y) + offset).round() as u8
        })
    }

    #[test]
    fn shifts_are_found_to_a_tenth_of_a_pixel() {
        let turn = nalgebra::Rotation2::new(0.2).matrix() * 1.15;
        for (step, gain, offset) in [
            (Matrix2::identity(), 1.0, 0.0),
            (Matrix2::identity(), 0.6, 40.0),
            (turn, 0.8, 10.0),
        ] {
            let mut errors = Vec::new();
            for number in 0..40 {
                let at = [31.0 * f64::from(number), 17.0 * f64::from(number)];
                let shift = Vector2::new(0.37, -0.81);
                let seen_at = Vector2::from(at) - step * shift;
                let target = patch(seen_at.into(), &step, gain, offset);
                let reference = patch(at, &Matrix2::identity(), 1.0, 0.0);
                let found =
                    Template::new(&reference, [0.0; 2], &step).and_then(|t| t.find(&target));
                errors.extend(found.map(|found| (Vector2::from(found).cast() - shift).norm()));
            }
            assert!(errors.len() > 20, "{}", errors.len());
            let wrong = errors.iter().filter(|error| **error > 0.1).count();
            assert!(10 * wrong <= errors.len(), "{errors:?}");
        }
    }

    #[test]
    fn other_pictures_and_flat_ones_are_not_found() {
        let identity = Matrix2::identity();
        let reference = patch([0.0, 0.0], &identity, 1.0, 0.0);
        let template = Template::new(&reference, [0.0; 2], &identity).unwrap();
        assert_eq!(template.find(&reference), Some([0.0; 2]));
        for far in [[3.0, 0.0], [500.0, 80.0], [900.0, 10.0]] {
            assert_eq!(template.find(&patch(far, &identity, 1.0, 0.0)), None);
        }
        assert_eq!(template.find(&[7; PATCH_SIDE * PATCH_SIDE]), None);
        let is_none =
            |patch: &Patch, step: &Matrix2<f64>| Template::new(patch, [0.0; 2], step).is_none();
        assert!(is_none(&[7; PATCH_SIDE * PATCH_SIDE], &identity));
        let stripes = std::array::from_fn(|at| (at % PATCH_SIDE * 15) as u8);
        assert!(is_none(&stripes, &identity));
        assert!(is_none(&reference, &(2.0 * identity)));
        assert!(is_none(&reference, &Matrix2::repeat(f64::NAN)));
    }

    #[test]
    fn nearer_cameras_see_larger_patches() {
        let camera = Camera::pinhole(500.0, 510.0, 320.0, 240.0).unwrap();
        let camera = Pinhole::new(&camera, 640, 480);
        let nearer = Isometry3::translation(0.0, 0.0, -1.0);
        let warp: Matrix2<f64> = plane_warp(&camera, &nearer, &Point3::new(0.0, 0.0, 2.0)).unwrap();
        assert!(
            (warp - Matrix2::from_diagonal_element(2.0)).norm() < 0.01,
            "{warp}"
        );
        let turned = Isometry3::rotation(Vector3::z() * 0.3);
        let warp = plane_warp(&camera, &turned, &Point3::new(0.0, 0.0, 2.0)).unwrap();
        assert!(
            (warp - nalgebra::Rotation2::new(0.3).matrix()).norm() < 0.02,
            "{warp}"
        );
        let behind = Isometry3::translation(0.0, 0.0, -3.0);
        assert!(plane_warp(&camera, &behind, &Point3::new(0.0, 0.0, 2.0)).is_none());
    }
}
