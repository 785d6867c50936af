//! A row of depth pixels seen by the colour camera.

use nalgebra::Vector3;

use super::{NearestSurface, Registration};

/// Number of columns processed together: few enough to stay in registers and the first cache, too many to be unrolled before
/// they are vectorised.
pub(super) const BLOCK: usize = 32;
/// A block with its right neighbour.
const WIDE: usize = BLOCK + 1;

/// Largest slope between adjacent depth pixels of one surface, relative to the image plane: tan 80 degrees.
const MAX_SLOPE: f64 = 5.671;
/// Differences of adjacent depths within this many standard deviations are noise.
const NOISE_GATE: f64 = 4.0;

/// The projection of depth pixels to the colour image, in single precision: errors are about 1e-4 pixels and a relative 1e-7
/// of the depth.
pub(super) struct DepthToColor<'a> {
    registration: &'a Registration<'a>,
    /// Pixel coordinates times depth, per unit of depth and column.
    along: Vector3<f32>,
    /// Pixel coordinates times depth of the origin of the depth camera.
    shift: Vector3<f32>,
    /// Largest difference of inverse depth between adjacent pixels, relative to it.
    slope: f32,
    noise_gate: f32,
}

/// A row of depth pixels projected into the colour camera, as one array per quantity. Beyond its end follow unknown pixels.
#[derive(Debug, Clone, Default)]
pub(super) struct ProjectedRow {
    len: usize,
    x: Vec<f32>,
    y: Vec<f32>,
    rho: Vec<f32>,
    rho_in_depth: Vec<f32>,
    tolerance: Vec<f32>,
    /// Index of the nearest colour pixel; [`OUTSIDE`] beyond the image.
    nearest: Vec<u32>,
}

/// A depth pixel of a row, and the colour pixel nearest to it.
pub(super) struct NearestPixel {
    /// Index of the colour pixel; [`OUTSIDE`] beyond the image.
    pub(super) index: u32,
    /// Inverse depth; 0 where unknown.
    pub(super) rho: f32,
    /// Largest difference of inverse depth to an adjacent pixel of the same surface.
    pub(super) tolerance: f32,
}

/// Index of no pixel: sides have at most 65535 pixels.
const OUTSIDE: u32 = u32::MAX;

/// A block of a row and the pixel to its right.
pub(super) struct RowBlock<'a> {
    /// Pixel coordinates; NaN where unknown.
    pub(super) x: &'a [f32; WIDE],
    pub(super) y: &'a [f32; WIDE],
    /// Inverse depth in the colour camera; 0 when unknown or behind it.
    pub(super) rho: &'a [f32; WIDE],
    /// Inverse depth in the depth camera, for the continuity test.
    pub(super) rho_in_depth: &'a [f32; WIDE],
    /// Largest difference of inverse depth to an adjacent pixel of the same surface.
    pub(super) tolerance: &'a [f32; WIDE],
}

impl<'a> DepthToColor<'a> {
    pub(super) fn new(registration: &'a Registration<'a>) -> Self {
        let focal_px = registration.depth_camera.mean_focal_px();
        let mut to_color = Self {
            registration,
            along: Vector3::zeros(),
            shift: Vector3::zeros(),
            slope: (MAX_SLOPE / focal_px) as f32,
            noise_gate: (NOISE_GATE * std::f64::consts::SQRT_2) as f32,
        };
        let step = Vector3::new(1.0 / registration.depth_camera.fx(), 0.0, 0.0);
        to_color.along = to_color.direction(step);
        to_color.shift = to_color.to_pixels(registration.color_from_depth.translation.vector);
        to_color
    }

    /// Rows of the intrinsic matrix are multiplied in: (x, y, z) -> (z * pixel x, z * pixel y, z).
    fn to_pixels(&self, v: Vector3<f64>) -> Vector3<f32> {
        let color = self.registration.color_camera;
        let x = color.fx() * v.x + color.cx() * v.z;
        let y = color.fy() * v.y + color.cy() * v.z;
        Vector3::new(x, y, v.z).map(|c| c as f32)
    }

    fn direction(&self, in_depth: Vector3<f64>) -> Vector3<f32> {
        let rotation = self.registration.color_from_depth.rotation;
        self.to_pixels(rotation.to_rotation_matrix() * in_depth)
    }

    /// The ray of the first pixel of a row.
    fn row_start(&self, y: usize) -> Vector3<f32> {
        let camera = self.registration.depth_camera;
        let v = (y as f64 - camera.cy()) / camera.fy();
        self.direction(Vector3::new(-camera.cx() / camera.fx(), v, 1.0))
    }
}

impl ProjectedRow {
    pub(super) fn new(len: usize) -> Self {
        let padded = len.next_multiple_of(BLOCK) + 1;
        let (zeros, nowhere) = (vec![0.0; padded], vec![f32::NAN; padded]);
        Self {
            len,
            x: nowhere.clone(),
            y: nowhere,
            rho: zeros.clone(),
            rho_in_depth: zeros.clone(),
            tolerance: zeros,
            nearest: vec![OUTSIDE; len],
        }
    }

    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// The block from a column on; `None` beyond the end.
    pub(super) fn block(&self, start: usize) -> Option<RowBlock<'_>> {
        Some(RowBlock {
            x: self.x[start..].first_chunk()?,
            y: self.y[start..].first_chunk()?,
            rho: self.rho[start..].first_chunk()?,
            rho_in_depth: self.rho_in_depth[start..].first_chunk()?,
            tolerance: self.tolerance[start..].first_chunk()?,
        })
    }

    /// The pixels of the row.
    pub(super) fn pixels(&self) -> impl Iterator<Item = NearestPixel> {
        let row = self.nearest.iter().zip(&self.rho).zip(&self.tolerance);
        row.map(|((&index, &rho), &tolerance)| NearestPixel {
            index,
            rho,
            tolerance,
        })
    }

    /// Projects the depths of row `y` of an image to the colour image that `surface` belongs to.
    pub(super) fn project(
        &mut self,
        row: &[f32],
        y: usize,
        to_color: &DepthToColor<'_>,
        surface: &NearestSurface,
    ) {
        let (width, height) = (surface.width as f32, surface.height as f32);
        let stride = surface.width as u32;
        let start = to_color.row_start(y);
        let (along, shift) = (to_color.along, to_color.shift);
        let (slope, noise_gate) = (to_color.slope, to_color.noise_gate);
        let sigma = to_color.registration.noise.in_single_precision();
        let n = row.len();
        let (xs, ys, rhos) = (&mut self.x[..n], &mut self.y[..n], &mut self.rho[..n]);
        let (in_depth, tolerances) = (&mut self.rho_in_depth[..n], &mut self.tolerance[..n]);
        let nearest = &mut self.nearest[..n];
        for x in 0..n {
            let z = row[x];
            let column = x as f32;
            let seen_z = (start.z + along.z * column) * z + shift.z;
            let rho = 1.0 / seen_z;
            let rho_in_depth = 1.0 / z;
            // Infinite and NaN depths have an inverse that is not positive.
            let is_known = (rho_in_depth > 0.0) & (rho > 0.0) & (rho < f32::INFINITY);
            rhos[x] = if is_known { rho } else { 0.0 };
            // Unknown corners are NaN, which the minimum and maximum of a cell ignore.
            let shown = if is_known { rho } else { f32::NAN };
            let seen_x = ((start.x + along.x * column) * z + shift.x) * shown;
            let seen_y = ((start.y + along.y * column) * z + shift.y) * shown;
            (xs[x], ys[x]) = (seen_x, seen_y);
            let (left, top) = (seen_x + 0.5, seen_y + 0.5);
            in_depth[x] = rho_in_depth;
            let is_inside = (left >= 0.0) & (top >= 0.0) & (left < width) & (top < height);
            let at = whole(floor(top))
                .wrapping_mul(stride)
                .wrapping_add(whole(floor(left)));
            nearest[x] = if is_inside { at } else { OUTSIDE };
            let (noise, tilt) = (noise_gate * sigma(rho_in_depth), slope * rho_in_depth);
            tolerances[x] = if noise > tilt { noise } else { tilt };
        }
    }
}

/// Added to a number below 2^22, it leaves no room for a fraction.
const NO_FRACTION: f32 = 12_582_912.0;

/// The largest whole number that is not above a number from 0 to 2^22, without a library call. Others give a number of the
/// same sign and order of magnitude, or NaN.
pub(super) fn floor(value: f32) -> f32 {
    let nearest = (value + NO_FRACTION) - NO_FRACTION;
    nearest - if nearest > value { 1.0 } else { 0.0 }
}

/// The smallest whole number that is not below a number; otherwise as [`floor`].
pub(super) fn ceil(value: f32) -> f32 {
    let nearest = (value + NO_FRACTION) - NO_FRACTION;
    nearest + if nearest < value { 1.0 } else { 0.0 }
}

/// A whole number from 0 to 2^22 as an integer; anything for others.
pub(super) fn whole(value: f32) -> u32 {
    // The last bits of a number from 2^23 to 2^24 count ones.
    (value + 8_388_608.0).to_bits() & 0x7F_FFFF
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_agrees_with_the_library() {
        let fractions = [
            0.0, 1e-7, 0.25, 0.49999997, 0.5, 0.50000006, 0.75, 0.99999994,
        ];
        for start in [0.0, 1.0, 2.0, 639.0, 4095.0, 65534.0] {
            for value in fractions.map(|fraction| start + fraction) {
                assert_eq!(floor(value), value.floor(), "{value}");
                assert_eq!(ceil(value), value.ceil(), "{value}");
                assert_eq!(whole(value.floor()), value as u32, "{value}");
            }
        }
        for value in [1e8_f32, 1e30, f32::INFINITY] {
            assert!(floor(value) > 1e7 && ceil(-value) < -1e7);
        }
    }
}
