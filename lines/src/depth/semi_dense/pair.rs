//! Where the neighbour sees a pixel, as a function of its inverse depth.

use nalgebra::{Isometry3, Matrix3, UnitQuaternion, Vector3};

use super::options::InverseDepthRange;
use super::view::MatchView;
use crate::camera::Camera;

/// Of the neighbour's image this many pixels along the border are left out, for patches and their derivative.
pub(super) const MARGIN_PX: f32 = 5.0;
/// The depths of a place in the two cameras differ at most by this factor; so does the size of what they see.
const LARGEST_SCALE: f32 = 2.5;

/// Two keyframes: homogeneous pixel in the neighbour = `rotation (x, y, 1) + rho translation`.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    /// Homogeneous pixel of the neighbour's centre in the reference image, of norm about 1.
    epipole: [f32; 3],
    /// The neighbour's image.
    pub(super) width: usize,
    pub(super) height: usize,
    /// Largest inverse depth that the two views may be compared at.
    largest_rho: f32,
    pub(super) baseline: f64,
}

/// The part of an epipolar line that is searched.
#[derive(Debug, Clone, Copy)]
pub(super) struct EpipolarLine {
    /// Where the pixel lies at infinity, homogeneous, before the translation is added.
    at_infinity: [f32; 3],
    /// First place.
    pub(super) start: [f32; 2],
    /// Unit vector towards growing inverse depth.
    pub(super) direction: [f32; 2],
    /// Length in pixels.
    pub(super) length: f32,
    /// Inverse depth in the middle of the searched range.
    pub(super) middle_rho: f32,
}

/// Intrinsics as a matrix.
pub(super) fn matrix(camera: &Camera) -> Matrix3<f64> {
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

impl Pair {
    /// The pair of two keyframes with a baseline, the neighbour turned by `correction` (a rotation in its camera frame);
    /// `None` when the centres coincide or are infinitely far apart.
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
        let own = matrix(reference.camera());
        let other = matrix(neighbour.camera());
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

    /// Unit direction of the epipolar line through a reference pixel, either way; `None` at the epipole.
    #[inline]
    pub(super) fn reference_direction(&self, p: [f32; 2]) -> Option<[f32; 2]> {
        let [ex, ey, ez] = self.epipole;
        let (dx, dy) = (ex - p[0] * ez, ey - p[1] * ez);
        let norm = dx.hypot(dy);
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
    fn place(&self, at_infinity: &[f32; 3], rho: f32) -> [f32; 2] {
        let z = at_infinity[2] + rho * self.translation[2];
        [
            (at_infinity[0] + rho * self.translation[0]) / z,
            (at_infinity[1] + rho * self.translation[1]) / z,
        ]
    }

    /// Where the neighbour sees a reference pixel of a known inverse depth, and that depth's inverse there; `None` outside
    /// its image or behind it.
    #[inline]
    pub(super) fn project(&self, p: [f32; 2], rho: f32) -> Option<([f32; 2], f32)> {
        let q = self.at_infinity(p);
        let z = q[2] + rho * self.translation[2];
        if !(z > 1.0 / LARGEST_SCALE && z < LARGEST_SCALE) {
            return None;
        }
        let place = self.place(&q, rho);
        self.is_inside(place).then_some((place, rho / z))
    }

    fn is_inside(&self, p: [f32; 2]) -> bool {
        let right = self.width as f32 - 1.0 - MARGIN_PX;
        let bottom = self.height as f32 - 1.0 - MARGIN_PX;
        p[0] >= MARGIN_PX && p[0] <= right && p[1] >= MARGIN_PX && p[1] <= bottom
    }

    /// The part of the epipolar line of a reference pixel that lies in the range, in front of the neighbour and in its image.
    #[inline]
    pub(super) fn line(&self, p: [f32; 2], range: &InverseDepthRange) -> Option<EpipolarLine> {
        let q = self.at_infinity(p);
        let mut lower = range.lower() as f32;
        let mut upper = (range.upper() as f32).min(self.largest_rho);
        // Ratio of the two depths within bounds: 1/S <= q_z + rho t_z <= S.
        let tz = self.translation[2];
        if tz.abs() * upper > 1e-6 {
            let (a, b) = (
                (1.0 / LARGEST_SCALE - q[2]) / tz,
                (LARGEST_SCALE - q[2]) / tz,
            );
            lower = lower.max(a.min(b));
            upper = upper.min(a.max(b));
        } else if !(q[2] > 1.0 / LARGEST_SCALE && q[2] < LARGEST_SCALE) {
            return None;
        }
        if !(lower < upper) {
            return None;
        }
        let (first, last) = (self.place(&q, lower), self.place(&q, upper));
        let (dx, dy) = (last[0] - first[0], last[1] - first[1]);
        let whole = dx.hypot(dy);
        if !(whole > 0.25 && whole.is_finite()) {
            return None;
        }
        let direction = [dx / whole, dy / whole];
        let (mut from, mut to) = (0.0_f32, whole);
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
        let start = [
            first[0] + from * direction[0],
            first[1] + from * direction[1],
        ];
        let mut line = EpipolarLine {
            at_infinity: q,
            start,
            direction,
            length: to - from,
            middle_rho: 0.0,
        };
        line.middle_rho = self
            .inverse_depth(&line, 0.5 * line.length)?
            .clamp(lower, upper);
        Some(line)
    }

    /// Translation along the neighbour's view.
    pub(super) fn forward(&self) -> f32 {
        self.translation[2]
    }

    /// How far the match of `p + step` lies from that of `p` along the line when both have one inverse depth.
    #[inline]
    pub(super) fn shift_along(&self, line: &EpipolarLine, p: [f32; 2], step: [f32; 2]) -> f32 {
        let moved = self.at_infinity([p[0] + step[0], p[1] + step[1]]);
        let (a, b) = (
            self.place(&line.at_infinity, line.middle_rho),
            self.place(&moved, line.middle_rho),
        );
        (b[0] - a[0]) * line.direction[0] + (b[1] - a[1]) * line.direction[1]
    }

    /// Inverse depth at a distance from the start of the line, from the axis along which it runs; `None` when it is not a
    /// number there.
    #[inline]
    pub(super) fn inverse_depth(&self, line: &EpipolarLine, distance: f32) -> Option<f32> {
        let axis = usize::from(line.direction[1].abs() > line.direction[0].abs());
        let place = line.start[axis] + distance * line.direction[axis];
        let denominator = self.translation[axis] - place * self.translation[2];
        let rho = (place * line.at_infinity[2] - line.at_infinity[axis]) / denominator;
        rho.is_finite().then_some(rho)
    }
}
