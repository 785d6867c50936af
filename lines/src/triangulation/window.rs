//! Planes fitted to windows of an inverse depth map.

use std::array::from_fn;

use nalgebra::{Matrix3, Vector3};
use wide::f64x4;

use super::options::SampleOptions;
use super::samples::SurfaceSample;
use crate::inverse_depth::InverseDepthMap;

/// Columns of a window that are summed together.
type Columns = f64x4;
const LANES: usize = 4;

/// Fits planes to the windows around the pixels of one row after the other.
///
/// Sums are kept by column, several columns in a vector, and reduced at the end of a window. Sums of offsets are whole numbers. Sums of inverse depths, which have 24 bits and are of similar size, are exact in
/// double precision, too, so that their order does not matter.
pub(super) struct PlaneWindows<'a> {
    map: &'a InverseDepthMap,
    options: &'a SampleOptions,
    radius: usize,
    /// Width of a padded row.
    stride: usize,
    /// Inverse depths of the last rows of the map, a ring of as many rows as a window has; NaN where unknown and in the
    /// padding of a radius to the left and at least as much to the right.
    rows: Vec<f64>,
    /// Number of rows of the map read so far.
    read: usize,
    window_rows: Vec<WindowRow>,
}

/// Constants of a row of a window.
struct WindowRow {
    /// Offset from the centre.
    offset: Columns,
    /// The whole number 1 + 2^16 (row + 2^16 offset^2). Sums of it have the number of inliers, the sum of their rows and that
    /// of their squared offsets in bits of their own; all fit 52 bits, as a radius has at most 64 pixels.
    code: Columns,
}

/// Normal equations of a plane over pixel offsets.
#[derive(Default)]
struct PlaneSums {
    count: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    r: f64,
    xr: f64,
    yr: f64,
}

impl PlaneSums {
    /// Adds a column at offset `x`, whose rows were counted from `radius` above the centre. `codes` is a sum of
    /// [`WindowRow::code`].
    fn add(&mut self, x: f64, radius: f64, codes: f64, r: f64, yr: f64) {
        let rows = codes as u64;
        let count = (rows & 0xFFFF) as f64;
        let from_top = (rows >> 16 & 0xFFFF) as f64;
        let y = from_top - radius * count;
        self.count += count;
        self.x += x * count;
        self.y += y;
        self.xx += x * x * count;
        self.xy += x * y;
        self.yy += (rows >> 32) as f64;
        self.r += r;
        self.xr += x * r;
        self.yr += yr;
    }

    /// (value at the origin, slopes); `None` for collinear pixels.
    fn plane(&self) -> Option<Vector3<f64>> {
        let normal = Matrix3::new(
            self.count, self.x, self.y, self.x, self.xx, self.xy, self.y, self.xy, self.yy,
        );
        normal
            .try_inverse()
            .map(|inverse| inverse * Vector3::new(self.r, self.xr, self.yr))
    }
}

impl<'a> PlaneWindows<'a> {
    pub(super) fn new(map: &'a InverseDepthMap, options: &'a SampleOptions) -> Self {
        let radius = options.window_radius_px as usize;
        let stride = map.width() + 2 * radius + LANES;
        Self {
            map,
            options,
            radius,
            stride,
            rows: vec![f64::NAN; stride * (2 * radius + 1)],
            read: 0,
            window_rows: (0..=2 * radius)
                .map(|row| {
                    let offset = row as f64 - radius as f64;
                    let code = 1.0 + 65536.0 * (row as f64 + 65536.0 * offset * offset);
                    WindowRow {
                        offset: Columns::splat(offset),
                        code: Columns::splat(code),
                    }
                })
                .collect(),
        }
    }

    /// Reads the map as far as the windows around the pixels of row `y` reach; rows come in increasing order.
    pub(super) fn advance(&mut self, y: usize) {
        let side = 2 * self.radius + 1;
        for row in self.read.max(y.saturating_sub(self.radius))..=y + self.radius {
            let start = row % side * self.stride + self.radius;
            let kept = &mut self.rows[start..start + self.map.width()];
            if row < self.map.height() {
                for (kept, sample) in kept.iter_mut().zip(self.map.row(row)) {
                    let rho = f64::from(sample.rho);
                    *kept = if rho > 0.0 { rho } else { f64::NAN };
                }
            } else {
                kept.fill(f64::NAN);
            }
        }
        self.read = y + self.radius + 1;
    }

    /// The dominant plane of the window around a pixel of the row last [advanced](Self::advance) to; `None` with too few
    /// inliers.
    ///
    /// The first fit gates on the depth of the centre pixel with twice the tolerance; the second on the first plane.
    pub(super) fn fit(&self, x: usize, y: usize) -> Option<SurfaceSample> {
        let center = self.map.get(x, y)?;
        let gate = self.options.gate_sigmas * f64::from(center.sigma);
        let side = 2.0 * f64::from(self.options.window_radius_px) + 1.0;
        let least = self.options.minimum_share * side * side;
        // The wider first gate allows for the slope of the plane.
        let mut plane = Vector3::new(f64::from(center.rho), 0.0, 0.0);
        for gate in [2.0 * gate, gate] {
            let sums = self.inliers(x, y, &plane, gate);
            if sums.count < least {
                return None;
            }
            plane = sums.plane()?;
        }
        let is_positive = plane.x > 0.0 && plane.iter().all(|value| value.is_finite());
        is_positive.then_some(SurfaceSample {
            rho: plane.x as f32,
            slope: [plane.y as f32, plane.z as f32],
            sigma: center.sigma,
        })
    }

    /// Sums of the pixels of a window within `gate` of a plane.
    fn inliers(&self, x: usize, y: usize, plane: &Vector3<f64>, gate: f64) -> PlaneSums {
        let side = 2 * self.radius + 1;
        let radius = self.radius as f64;
        let mut sums = PlaneSums::default();
        // The row y - radius of the ring. Above the image that is an unread one, which is unknown.
        let top = (y + side - self.radius) % side;
        let (value, slope_y) = (Columns::splat(plane.x), Columns::splat(plane.z));
        for first in (0..side).step_by(LANES) {
            let dx: [f64; LANES] = from_fn(|k| (first + k) as f64 - radius);
            let rise = Columns::from(dx) * Columns::splat(plane.y);
            // The last columns of the last group belong to no window.
            let gates = Columns::from(from_fn(|k| if first + k < side { gate } else { -1.0 }));
            let (mut codes, mut r, mut yr) = (Columns::ZERO, Columns::ZERO, Columns::ZERO);
            let mut slot = top;
            for row in &self.window_rows {
                let start = slot * self.stride + x + first;
                slot = if slot + 1 < side { slot + 1 } else { 0 };
                let Some(rho) = self.rows[start..].first_chunk::<LANES>() else {
                    continue;
                };
                let rho = Columns::from(*rho);
                let residual = (rho - value - rise - row.offset * slope_y).abs();
                let is_inlier = residual.simd_le(gates);
                let rho = is_inlier & rho;
                codes += is_inlier & row.code;
                r += rho;
                yr += row.offset * rho;
            }
            let (codes, r, yr) = (codes.to_array(), r.to_array(), yr.to_array());
            for k in 0..LANES {
                sums.add(dx[k], radius, codes[k], r[k], yr[k]);
            }
        }
        sums
    }
}
