//! One step of the motion of a view, and what it has in common with one of its lens.

use nalgebra::{Isometry3, Point3, SMatrix, SVector, Vector3, Vector6};

use super::super::distortion::{DistortionGrid, GridPosition};
use super::super::types::TextureView;
use super::pyramid::Level;
use super::row_rotation::RowRotation;

/// Unknowns of the motion of a view: rotation and translation of its pose, rotation over its rows.
pub(super) const MOTION: usize = 9;
pub(super) type MotionMatrix = SMatrix<f64, MOTION, MOTION>;
pub(super) type MotionVector = SVector<f64, MOTION>;

/// Fewest points from which a pose is adjusted.
const LEAST_POINTS: usize = 200;
/// Standard deviation of a given pose, in pixels.
const GIVEN_PX: f64 = 3.0;
/// How much a given pose counts, as a share of the number of points. One measurement would not: errors of neighbouring points are not independent.
const GIVEN_SHARE: f64 = 0.001;
/// Standard deviation of the motion from the middle row to the first or the last, in pixels.
const ROWS_PX: f64 = 5.0;
/// Longest step, in pixels of the level.
pub(super) const LONGEST_STEP_PX: f64 = 2.0;
/// Scale of robust errors, in their median. A Cauchy weight halves there.
const SCALE_MEDIANS: f64 = 2.0;
/// Least scale of errors, in grey levels.
const LEAST_SCALE: f64 = 2.0;
/// Least contrast of the expected brightness, in grey levels.
const LEAST_CONTRAST: f64 = 1.0;

/// A view while its pose is adjusted.
pub(super) struct Aligned<'a> {
    view: &'a TextureView,
    given: Isometry3<f64>,
    pub(super) camera_from_world: Isometry3<f64>,
    pub(super) distortion: DistortionGrid,
    rows: RowRotation,
    /// Gain and offset of the brightness of the photograph over that of the surface.
    pub(super) brightness: [f64; 2],
}

/// A point that a view sees, and how bright the others see it.
pub(super) struct Expected<'a> {
    pub(super) position: &'a Point3<f64>,
    pub(super) brightness: f64,
}

/// What a view sees of a point.
pub(super) struct Seen {
    /// Change of the brightness with the motion.
    pub(super) derivative: MotionVector,
    /// Change of the brightness per pixel of the photograph, along x and y.
    pub(super) slopes: [f64; 2],
    /// Where it lies in the grid of the distortion.
    pub(super) position: GridPosition,
    value: f64,
    expected: f64,
    depth: f64,
}

impl<'a> Aligned<'a> {
    pub(super) fn new(view: &'a TextureView, size: (u32, u32)) -> Self {
        let given = view.world_from_camera.inverse();
        Self {
            view,
            given,
            camera_from_world: given,
            distortion: DistortionGrid::none(size),
            rows: RowRotation::none(size.1),
            brightness: [1.0, 0.0],
        }
    }

    /// A point in the frame of the camera, and its pixel; `None` behind the camera.
    #[inline]
    fn project(&self, point: &Point3<f64>) -> Option<(Point3<f64>, [f64; 2])> {
        let point = self.camera_from_world * point;
        let camera = &self.view.camera;
        let inverse = 1.0 / point.z;
        let pixel = [
            camera.fx() * point.x * inverse + camera.cx(),
            camera.fy() * point.y * inverse + camera.cy(),
        ];
        (point.z > 0.0).then_some((point, pixel))
    }

    /// Pixel of the photograph at a pixel of a pinhole camera at rest.
    #[inline]
    fn photo_from_pinhole(&self, pixel: [f64; 2]) -> [f64; 2] {
        let [x, y] = self.distortion.photo_from_pinhole(pixel);
        let [along, down] = self.rows.shift(&self.view.camera, pixel);
        [x + along, y + down]
    }

    /// Displacements of the lens together with those by the motion of the rows.
    pub(super) fn distortion_with_rows(&self) -> DistortionGrid {
        let mut distortion = self.distortion.clone();
        distortion.shift_by(|pixel| self.rows.shift(&self.view.camera, pixel));
        distortion
    }

    /// Brightness of a point without gain and offset of the photograph; `None` outside of the photograph.
    #[inline]
    pub(super) fn brightness_of(&self, level: &Level, point: &Point3<f64>) -> Option<f32> {
        let (_, pixel) = self.project(point)?;
        let [x, y] = self.photo_from_pinhole(pixel);
        let [gain, offset] = self.brightness.map(|value| value as f32);
        Some((level.value(x, y)? - offset) / gain)
    }

    /// Adjusts gain, offset and pose by one Gauss-Newton step of robust errors; `None` where the points are too few or say too little.
    pub(super) fn step<'b>(
        &mut self,
        level: &Level,
        points: impl Iterator<Item = Expected<'b>>,
    ) -> Option<()> {
        let (seen, scale) = self.fit_brightness(level, points)?;
        let (mut normal, mut right) = (MotionMatrix::zeros(), MotionVector::zeros());
        for point in &seen {
            let (error, weight) = self.error(point, scale);
            normal.syger(weight, &point.derivative, &point.derivative, 1.0);
            right.axpy(weight * error, &point.derivative, 1.0);
        }
        normal.fill_upper_triangle_with_lower_triangle();
        self.add_given((&mut normal, &mut right), &seen, scale);
        self.advance(level, &normal, &right, Self::median_depth(&seen))
    }

    /// Adjusts gain and offset. What is seen of the points, and the scale of robust errors.
    pub(super) fn fit_brightness<'b>(
        &mut self,
        level: &Level,
        points: impl Iterator<Item = Expected<'b>>,
    ) -> Option<(Vec<Seen>, f64)> {
        let seen: Vec<Seen> = points
            .filter_map(|point| self.seen(level, &point))
            .collect();
        if seen.len() < LEAST_POINTS {
            return None;
        }
        self.brightness = fitted(&seen, self.brightness)?;
        let scale = scale(&seen, self.brightness);
        Some((seen, scale))
    }

    /// Error of the brightness of a point, and its weight.
    #[inline]
    pub(super) fn error(&self, point: &Seen, scale: f64) -> (f64, f64) {
        let [gain, offset] = self.brightness;
        let error = point.value - gain * point.expected - offset;
        (error, 1.0 / (1.0 + (error / scale).powi(2)))
    }

    pub(super) fn median_depth(seen: &[Seen]) -> f64 {
        median(seen.iter().map(|point| point.depth).collect())
    }

    /// Adds the given pose, and rows at rest, to the equations of the motion.
    pub(super) fn add_given(
        &self,
        (normal, right): (&mut MotionMatrix, &mut MotionVector),
        seen: &[Seen],
        scale: f64,
    ) {
        let unit = self.units(Self::median_depth(seen));
        let deviation = deviation(&self.camera_from_world, &self.given);
        let information =
            |deviation_px: f64| GIVEN_SHARE * seen.len() as f64 * (scale / deviation_px).powi(2);
        for axis in 0..6 {
            let information = information(GIVEN_PX) * unit[axis].powi(2);
            normal[(axis, axis)] += information;
            right[axis] += information * deviation[axis];
        }
        for axis in 0..3 {
            let information = information(ROWS_PX) * (0.5 * unit[axis]).powi(2);
            normal[(6 + axis, 6 + axis)] += information;
            right[6 + axis] += information * self.rows.rotation()[axis];
        }
    }

    /// Moves the pose and its rows by the solution of their equations, shortened if it is long; `None` when there is none.
    pub(super) fn advance(
        &mut self,
        level: &Level,
        normal: &MotionMatrix,
        right: &MotionVector,
        depth: f64,
    ) -> Option<()> {
        let mut step = -normal.cholesky()?.solve(right);
        let focal = self.view.camera.fx() / level.factor;
        let pixels =
            focal * (step.fixed_rows::<3>(0).norm() + step.fixed_rows::<3>(3).norm() / depth);
        if !pixels.is_finite() {
            return None;
        }
        step *= f64::min(1.0, LONGEST_STEP_PX / pixels);
        let [rotation, translation, over_rows] =
            [0, 3, 6].map(|at| step.fixed_rows::<3>(at).into_owned());
        self.rows.add(&over_rows);
        self.camera_from_world = Isometry3::new(translation, rotation) * self.camera_from_world;
        Some(())
    }

    /// Pixels of the photograph that a unit of each component of a motion moves points at this depth, about.
    fn units(&self, depth: f64) -> [f64; 6] {
        let focal = self.view.camera.fx();
        let shift = focal / depth;
        [focal, focal, focal, shift, shift, shift]
    }

    /// Squared distance between where a point is in the given pose and where it is now, in pixels of the photograph.
    pub(super) fn moved_px(&self, point: &Point3<f64>) -> f64 {
        let camera = &self.view.camera;
        let [given, now] = [&self.given, &self.camera_from_world].map(|pose| {
            let at = pose * point;
            [
                camera.fx() * at.x / at.z + camera.cx(),
                camera.fy() * at.y / at.z + camera.cy(),
            ]
        });
        let now = self.photo_from_pinhole(now);
        (now[0] - given[0]).powi(2) + (now[1] - given[1]).powi(2)
    }

    #[inline]
    fn seen(&self, level: &Level, point: &Expected<'_>) -> Option<Seen> {
        let (at, pixel) = self.project(point.position)?;
        let [x, y] = self.photo_from_pinhole(pixel);
        let [value, along, down] = level.sample(x, y)?;
        let slopes = [along, down].map(|slope| slope / level.factor);
        let camera = &self.view.camera;
        let (along, down) = (slopes[0] * camera.fx(), slopes[1] * camera.fy());
        let inverse = 1.0 / at.z;
        // Change of the brightness with the point in the frame of the camera.
        let with_point =
            Vector3::new(along, down, -(along * at.x + down * at.y) * inverse) * inverse;
        let with_rotation = at.coords.cross(&with_point);
        let over_rows = with_rotation * self.rows.share(pixel[1]);
        let mut derivative = MotionVector::zeros();
        for (at, part) in [(0, with_rotation), (3, with_point), (6, over_rows)] {
            derivative.fixed_rows_mut::<3>(at).copy_from(&part);
        }
        Some(Seen {
            derivative,
            slopes,
            position: self.distortion.position(pixel),
            value,
            expected: point.brightness,
            depth: at.z,
        })
    }
}

/// The motion from one pose to another: rotation vector, then translation.
fn deviation(to: &Isometry3<f64>, from: &Isometry3<f64>) -> Vector6<f64> {
    let motion = to * from.inverse();
    let mut deviation = Vector6::zeros();
    deviation
        .fixed_rows_mut::<3>(0)
        .copy_from(&motion.rotation.scaled_axis());
    deviation
        .fixed_rows_mut::<3>(3)
        .copy_from(&motion.translation.vector);
    deviation
}

/// Scale of robust errors.
fn scale(seen: &[Seen], [gain, offset]: [f64; 2]) -> f64 {
    let error = |point: &Seen| (point.value - gain * point.expected - offset).abs();
    (SCALE_MEDIANS * median(seen.iter().map(error).collect())).max(LEAST_SCALE)
}

/// Gain and offset that fit the brightness of points, by robust least squares from the last ones; `None` when all are equally bright.
fn fitted(seen: &[Seen], last: [f64; 2]) -> Option<[f64; 2]> {
    let scale = scale(seen, last);
    let [mut n, mut x, mut y, mut xx, mut xy] = [0.0; 5];
    for point in seen {
        let error = point.value - last[0] * point.expected - last[1];
        let weight = 1.0 / (1.0 + (error / scale).powi(2));
        n += weight;
        x += weight * point.expected;
        y += weight * point.value;
        xx += weight * point.expected * point.expected;
        xy += weight * point.expected * point.value;
    }
    let variance = xx - x * x / n;
    if variance.is_nan() || variance <= LEAST_CONTRAST * LEAST_CONTRAST * n {
        return None;
    }
    let gain = (xy - x * y / n) / variance;
    (gain > 0.1 && gain < 10.0).then(|| [gain, (y - gain * x) / n])
}

fn median(mut values: Vec<f64>) -> f64 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}
