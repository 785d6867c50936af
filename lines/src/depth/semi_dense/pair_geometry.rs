//! Two-view geometry: the position of a reference pixel in the neighbour as a function of its inverse depth.

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

use super::options::InverseDepthRange;
use super::view::MatchView;
use crate::camera::Camera;

/// Width of the unused border of the neighbour's image, in pixels; patches and their derivatives need it.
pub(super) const MARGIN_PX: f32 = 6.0;
/// Largest ratio of the depths of a point in the two cameras, and so of its scale in the images.
const MAX_SCALE: f32 = 2.5;

/// Relative geometry of two keyframes: homogeneous pixel in the neighbour = `rotation (x, y, 1) + rho translation`.
#[derive(Debug, Clone)]
pub(super) struct PairGeometry {
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    /// The neighbour's camera centre in the reference image, as a homogeneous pixel of norm about 1.
    epipole: [f32; 3],
    /// Width of the neighbour's image in pixels.
    pub(super) width: usize,
    /// Height of the neighbour's image in pixels.
    pub(super) height: usize,
    /// Largest inverse depth at which the parallax is still acceptable.
    largest_rho: f32,
    /// Distance of the camera centres in units of the poses.
    pub(super) baseline: f64,
}

/// The searched section of an epipolar line, sampled once per pixel along its major image axis: sample k lies at `start + k step`.
#[derive(Debug, Clone, Copy)]
pub(super) struct EpipolarLine {
    /// Homogeneous pixel at infinite depth.
    at_infinity: [f32; 3],
    /// Major axis: 0 for x, 1 for y.
    pub(super) axis: usize,
    /// Sample 0, at a whole number along the major axis.
    pub(super) start: [f32; 2],
    /// Step between samples, towards larger inverse depth: 1 or -1 along the major axis, at most that along the other.
    pub(super) step: [f32; 2],
    /// Unit direction of the step.
    pub(super) direction: [f32; 2],
    /// Length of a step in pixels, from 1 to sqrt(2).
    pub(super) step_px: f32,
    /// Number of samples.
    pub(super) sample_count: usize,
    /// Inverse depth in the middle of the section.
    middle_rho: f32,
}

/// The intrinsic matrix.
pub(super) fn intrinsic_matrix(camera: &Camera) -> Matrix3<f64> {
    Matrix3::new(
        camera.fx(),
        0.0,
        camera.cx(),
        0.0,
        camera.fy(),
        camera.cy(),
        0.0,
        0.0,
        1.0,
    )
}

fn rows(m: &Matrix3<f64>) -> [[f32; 3]; 3] {
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}

impl PairGeometry {
    /// The geometry of two keyframes with the neighbour rotated by `correction` in its camera frame; `None` unless the baseline is
    /// positive and finite.
    pub(super) fn new(
        reference: &MatchView,
        neighbour: &MatchView,
        correction: &UnitQuaternion<f64>,
        largest_parallax: f64,
    ) -> Option<Self> {
        let relative: Isometry3<f64> =
            neighbour.world_from_camera().inverse() * reference.world_from_camera();
        let baseline = relative.translation.vector.norm();
        if !(baseline > 0.0 && baseline.is_finite()) {
            return None;
        }
        let relative = Isometry3::from_parts(
            (correction * relative.translation.vector).into(),
            correction * relative.rotation,
        );
        let rotation = relative.rotation.to_rotation_matrix();
        let own = intrinsic_matrix(reference.camera());
        let other = intrinsic_matrix(neighbour.camera());
        let inverse = own.try_inverse()?;
        let pixels = other * rotation.matrix() * inverse;
        let shift = other * relative.translation.vector;
        let center: Vector3<f64> = -(rotation.inverse() * relative.translation.vector) / baseline;
        let epipole = own * center;
        Some(Self {
            rotation: rows(&pixels),
            translation: shift.map(|c| c as f32).into(),
            epipole: epipole.map(|c| c as f32).into(),
            width: neighbour.smoothed().width(),
            height: neighbour.smoothed().height(),
            largest_rho: (largest_parallax / baseline) as f32,
            baseline,
        })
    }

    /// Unit direction (up to sign) of the epipolar line through a reference pixel; `None` at the epipole.
    #[inline]
    pub(super) fn reference_direction(&self, p: [f32; 2]) -> Option<[f32; 2]> {
        let [ex, ey, ez] = self.epipole;
        let (dx, dy) = (ex - p[0] * ez, ey - p[1] * ez);
        let norm = (dx * dx + dy * dy).sqrt();
        (norm > 1e-3).then(|| [dx / norm, dy / norm])
    }

    #[inline]
    fn at_infinity(&self, p: [f32; 2]) -> [f32; 3] {
        let row = |r: usize| {
            self.rotation[r][0] * p[0] + self.rotation[r][1] * p[1] + self.rotation[r][2]
        };
        [row(0), row(1), row(2)]
    }

    #[inline]
    fn position(&self, at_infinity: &[f32; 3], rho: f32) -> [f32; 2] {
        let z = at_infinity[2] + rho * self.translation[2];
        [
            (at_infinity[0] + rho * self.translation[0]) / z,
            (at_infinity[1] + rho * self.translation[1]) / z,
        ]
    }

    /// Position and inverse depth of a reference pixel in the neighbour; `None` outside its image, behind it or where the change
    /// of scale is too large.
    #[inline]
    pub(super) fn project(&self, p: [f32; 2], rho: f32) -> Option<([f32; 2], f32)> {
        let q = self.at_infinity(p);
        let z = q[2] + rho * self.translation[2];
        if !(z > 1.0 / MAX_SCALE && z < MAX_SCALE) {
            return None;
        }
        let position = self.position(&q, rho);
        self.is_inside(position).then_some((position, rho / z))
    }

    /// Homogeneous position of a reference pixel in the neighbour; linear in pixel and inverse depth.
    #[inline]
    pub(super) fn homogeneous(&self, p: [f32; 2], rho: f32) -> [f32; 3] {
        let q = self.at_infinity(p);
        std::array::from_fn(|i| q[i] + rho * self.translation[i])
    }

    /// Change of [`PairGeometry::homogeneous`] per pixel along an axis (0 for x, 1 for y) on a plane with this slope.
    #[inline]
    pub(super) fn homogeneous_slope(&self, axis: usize, slope: f32) -> [f32; 3] {
        std::array::from_fn(|i| self.rotation[i][axis] + slope * self.translation[i])
    }

    fn is_inside(&self, p: [f32; 2]) -> bool {
        let right = self.width as f32 - 1.0 - MARGIN_PX;
        let bottom = self.height as f32 - 1.0 - MARGIN_PX;
        p[0] >= MARGIN_PX && p[0] <= right && p[1] >= MARGIN_PX && p[1] <= bottom
    }

    /// The section of the epipolar line of a reference pixel that covers `range`, extended by `slack_px` at both ends and clipped to the
    /// visible part of the neighbour's image.
    #[inline]
    pub(super) fn line(
        &self,
        p: [f32; 2],
        range: &InverseDepthRange,
        slack_px: f32,
    ) -> Option<EpipolarLine> {
        let q = self.at_infinity(p);
        let mut lower = range.lower() as f32;
        let mut upper = (range.upper() as f32).min(self.largest_rho);
        // Bounds on the ratio of the two depths: 1/S <= q_z + rho t_z <= S.
        let tz = self.translation[2];
        if tz.abs() * upper > 1e-6 {
            let (a, b) = ((1.0 / MAX_SCALE - q[2]) / tz, (MAX_SCALE - q[2]) / tz);
            lower = lower.max(a.min(b));
            upper = upper.min(a.max(b));
        } else if !(q[2] > 1.0 / MAX_SCALE && q[2] < MAX_SCALE) {
            return None;
        }
        if !(lower < upper) {
            return None;
        }
        let (first, last) = (self.position(&q, lower), self.position(&q, upper));
        // The derivative by inverse depth has the same direction along the whole line.
        let (dx, dy) = (
            self.translation[0] - first[0] * tz,
            self.translation[1] - first[1] * tz,
        );
        let norm = (dx * dx + dy * dy).sqrt();
        let direction = [dx / norm, dy / norm];
        let whole = (last[0] - first[0]) * direction[0] + (last[1] - first[1]) * direction[1];
        if !(whole + slack_px > 0.25 && whole.is_finite()) {
            return None;
        }
        let (mut from, mut to) = (-slack_px, whole + slack_px);
        let sides = [
            (self.width as f32 - 1.0 - MARGIN_PX, 0),
            (self.height as f32 - 1.0 - MARGIN_PX, 1),
        ];
        for (far, axis) in sides {
            let (origin, step) = (first[axis], direction[axis]);
            if step.abs() < 1e-6 {
                if !(origin >= MARGIN_PX && origin <= far) {
                    return None;
                }
                continue;
            }
            let (a, b) = ((MARGIN_PX - origin) / step, (far - origin) / step);
            from = from.max(a.min(b));
            to = to.min(a.max(b));
        }
        if !(to - from > 0.25) {
            return None;
        }
        let axis = usize::from(direction[1].abs() > direction[0].abs());
        let step_px = direction[axis].abs().recip();
        let mut step = direction.map(|component| component * step_px);
        step[axis] = direction[axis].signum();
        // Outwards to whole pixels along the axis.
        let begin = (first[axis] + from * direction[axis]) * step[axis];
        let end = (first[axis] + to * direction[axis]) * step[axis];
        let (begin, end) = (begin.floor(), end.ceil());
        let to_start = (begin * step[axis] - first[axis]) * step[axis];
        let mut line = EpipolarLine {
            at_infinity: q,
            axis,
            start: std::array::from_fn(|side| {
                if side == axis {
                    begin * step[axis]
                } else {
                    first[side] + to_start * step[side]
                }
            }),
            step,
            direction,
            step_px,
            sample_count: (end - begin) as usize + 1,
            middle_rho: 0.0,
        };
        line.middle_rho = self
            .inverse_depth(&line, 0.5 * (end - begin))?
            .clamp(lower, upper);
        Some(line)
    }

    /// Translation along the optical axis of the neighbour.
    pub(super) fn forward(&self) -> f32 {
        self.translation[2]
    }

    /// Shift of a match along the line when the reference pixel moves by the vector `shift` at constant inverse depth.
    #[inline]
    pub(super) fn shift_along(&self, line: &EpipolarLine, shift: [f32; 2]) -> f32 {
        let z = line.at_infinity[2] + line.middle_rho * self.translation[2];
        let position = self.position(&line.at_infinity, line.middle_rho);
        let moved = |r: usize| self.rotation[r][0] * shift[0] + self.rotation[r][1] * shift[1];
        let away = moved(2);
        ((moved(0) - position[0] * away) * line.direction[0]
            + (moved(1) - position[1] * away) * line.direction[1])
            / z
    }

    /// Inverse depth at sample `k` of the line, which may be fractional; `None` when it is not finite.
    #[inline]
    pub(super) fn inverse_depth(&self, line: &EpipolarLine, k: f32) -> Option<f32> {
        let axis = line.axis;
        let position = line.start[axis] + k * line.step[axis];
        let denominator = self.translation[axis] - position * self.translation[2];
        let rho = (position * line.at_infinity[2] - line.at_infinity[axis]) / denominator;
        rho.is_finite().then_some(rho)
    }
}
