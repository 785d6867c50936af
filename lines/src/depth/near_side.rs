//! The surface at a point of an inverse depth map: one plane, or one of the sides of a step.

use crate::inverse_depth::{InverseDepth, InverseDepthMap, UNKNOWN};

/// Rows of a window that is clamped to the image, and the columns of each.
struct Bounds {
    left: usize,
    right: usize,
    top: usize,
    bottom: usize,
}

/// A window around a pixel, and the point of that pixel at which planes are evaluated.
pub(super) struct Window<'a> {
    pub(super) map: &'a InverseDepthMap,
    pub(super) center: (usize, usize),
    /// Offset of the point from the centre of the pixel.
    pub(super) offset: [f32; 2],
}

/// A known pixel of a window, relative to the centre of the window.
#[derive(Debug, Clone, Copy)]
pub(super) struct WindowPixel {
    offset: [f32; 2],
    rho: f32,
}

/// Smallest difference of inverse depths at a depth jump.
#[derive(Debug, Clone, Copy)]
pub(super) struct JumpLimits {
    pub(super) radius_px: usize,
    pub(super) sigmas: f32,
    pub(super) relative: f32,
}

impl Window<'_> {
    fn bounds(&self, radius: usize) -> Bounds {
        let (x, y) = self.center;
        Bounds {
            left: x.saturating_sub(radius),
            right: (x + radius).min(self.map.width() - 1),
            top: y.saturating_sub(radius),
            bottom: (y + radius).min(self.map.height() - 1),
        }
    }

    /// Nearest pixel and farthest inverse depth within a radius, a fast test for windows without a jump; unknown and infinity when all
    /// pixels are unknown.
    fn extremes(&self, radius: usize) -> (InverseDepth, f32) {
        let bounds = self.bounds(radius);
        let (mut nearest, mut farthest) = (UNKNOWN, f32::INFINITY);
        for row in bounds.top..=bounds.bottom {
            for sample in &self.map.row(row)[bounds.left..=bounds.right] {
                let rho = sample.rho;
                nearest = if rho > nearest.rho { *sample } else { nearest };
                farthest = if (rho < farthest) & (rho > 0.0) {
                    rho
                } else {
                    farthest
                };
            }
        }
        (nearest, farthest)
    }

    /// The known pixels within a radius.
    fn collect(&self, radius: usize, pixels: &mut Vec<WindowPixel>) {
        let bounds = self.bounds(radius);
        let (x, y) = (self.center.0 as f32, self.center.1 as f32);
        pixels.clear();
        for row in bounds.top..=bounds.bottom {
            let samples = &self.map.row(row)[bounds.left..=bounds.right];
            for (column, sample) in samples.iter().enumerate() {
                if sample.rho > 0.0 {
                    pixels.push(WindowPixel {
                        offset: [(bounds.left + column) as f32 - x, row as f32 - y],
                        rho: sample.rho,
                    });
                }
            }
        }
    }

    /// Inverse depths of the window and two pixels around it; 0 where unknown and outside of the image.
    fn surroundings(&self, radius: usize) -> Surroundings {
        let mut rho = [[0.0; SURROUNDINGS]; SURROUNDINGS];
        let reach = radius + 2;
        let bounds = self.bounds(reach);
        let left = bounds.left + reach - self.center.0;
        for row in bounds.top..=bounds.bottom {
            let samples = &self.map.row(row)[bounds.left..=bounds.right];
            let slots = &mut rho[row + reach - self.center.1][left..];
            for (slot, sample) in slots.iter_mut().zip(samples) {
                *slot = sample.rho;
            }
        }
        Surroundings { rho, reach }
    }

    /// The inverse depth at the point without a jump: that of the plane through all pixels within a radius. Where one of them lies off
    /// that plane by more than a share of `bend`, as beside a small step or at a crease, the plane lies on neither surface: the `own` inverse
    /// depth of the pixel is then continued along the slope of its side, three pixels that are collinear within `bend`. `None` with fewer than
    /// `least` pixels, or too few beside each other.
    pub(super) fn surface(
        &self,
        own: f32,
        radius: usize,
        least: usize,
        bend: f32,
        pixels: &mut Vec<WindowPixel>,
    ) -> Option<f32> {
        self.collect(radius, pixels);
        if pixels.len() < least {
            return None;
        }
        let plane = Plane::fit(pixels)?;
        if plane.is_within(pixels, FLAT_SHARE * bend) {
            return plane.at(self.offset);
        }
        let slope = self.surroundings(0).slopes([0.0; 2], bend);
        let slope = slope.map(|slope| if slope.is_nan() { 0.0 } else { slope });
        Some(own + dot(slope, self.offset))
    }

    /// The inverse depth of the near side of a depth jump at the point, and its standard deviation; `None` without a jump.
    ///
    /// In the row and in the column of the pixel, lines through three pixels on either side of two adjacent ones are compared at these two. At a jump
    /// the same line is nearer at both. The lines of a crease meet in between, and those of one surface are the same, at any angle. Of several
    /// jumps the largest counts.
    pub(super) fn near_side(&self, limits: &JumpLimits) -> Option<(f32, f32)> {
        let (nearest, farthest) = self.extremes(limits.radius_px);
        let difference = nearest.rho - farthest;
        let relative = limits.relative * nearest.rho;
        let noise = limits.sigmas * std::f32::consts::SQRT_2 * nearest.sigma;
        let jump = relative.max(noise);
        if difference <= jump {
            return None;
        }
        let straight = STRAIGHT_SHARE * jump;
        let around = self.surroundings(limits.radius_px);
        let (mut largest, mut near) = (STEP_SHARE * jump, None);
        for axis in 0..2 {
            let line = around.line(axis);
            // The last pixel before the jump, and the first after it.
            for (last, first) in (2..2 * limits.radius_px + 2).map(|last| (last, last + 1)) {
                let before = extended(&[line[last - 2], line[last - 1], line[last]], straight);
                let after = extended(&[line[first + 2], line[first + 1], line[first]], straight);
                let (Some(before), Some(after)) = (before, after) else {
                    continue;
                };
                let [at_last, at_first] = [before[0] - after[1], before[1] - after[0]];
                let least = at_last.abs().min(at_first.abs());
                if at_last * at_first <= 0.0 || least <= largest {
                    continue;
                }
                let (side, rise, at) = match at_last > 0.0 {
                    true => (before, before[1] - before[0], last),
                    false => (after, after[0] - after[1], first),
                };
                let mut offset = [0.0; 2];
                offset[axis] = at as f32 - around.reach as f32;
                let mut slope = around.slopes(offset, straight);
                slope[axis] = rise;
                let slope = slope.map(|slope| if slope.is_nan() { 0.0 } else { slope });
                let to_point = [0, 1].map(|axis| self.offset[axis] - offset[axis]);
                largest = least;
                near = Some(side[0] + dot(slope, to_point));
            }
        }
        near.map(|rho| (rho, nearest.sigma))
    }
}

/// Inverse depths around a pixel.
struct Surroundings {
    rho: [[f32; SURROUNDINGS]; SURROUNDINGS],
    /// Row and column of the pixel.
    reach: usize,
}

impl Surroundings {
    /// The row (axis 0) or the column of the pixel.
    fn line(&self, axis: usize) -> [f32; SURROUNDINGS] {
        std::array::from_fn(|k| match axis {
            0 => self.rho[self.reach][k],
            _ => self.rho[k][self.reach],
        })
    }

    /// Slopes of the map at an offset along either axis.
    fn slopes(&self, offset: [f32; 2], tolerance: f32) -> [f32; 2] {
        // Of the first of five pixels whose middle is at the offset.
        let x = (offset[0] as isize + self.reach as isize) as usize - 2;
        let y = (offset[1] as isize + self.reach as isize) as usize - 2;
        let row: [f32; 5] = std::array::from_fn(|k| self.rho[y + 2][x + k]);
        let column: [f32; 5] = std::array::from_fn(|k| self.rho[y + k][x + 2]);
        [row, column].map(|line| slope(&line, tolerance))
    }
}

/// Slope at the middle one of five pixels in a row; NaN unless three of them, one of which it is, are collinear within
/// `tolerance`. The straightest such triple is taken, so that the slope beside a jump is that of the own surface.
fn slope(row: &[f32; 5], tolerance: f32) -> f32 {
    let (mut least, mut slope) = (tolerance, f32::NAN);
    for triple in row.windows(3) {
        let bend = (triple[0] - 2.0 * triple[1] + triple[2]).abs();
        let is_known = (triple[0] > 0.0) & (triple[1] > 0.0) & (triple[2] > 0.0);
        if is_known & (bend <= least) {
            (least, slope) = (bend, 0.5 * (triple[2] - triple[0]));
        }
    }
    slope
}

/// The line through three pixels at the last of them and at the pixel after it; `None` unless they are known and collinear within `tolerance`.
fn extended(pixels: &[f32; 3], tolerance: f32) -> Option<[f32; 2]> {
    let [a, b, c] = pixels;
    let is_known = pixels.iter().all(|rho| *rho > 0.0);
    let rise = 0.5 * (c - a);
    let last = (a + b + c) / 3.0 + rise;
    (is_known && (a - 2.0 * b + c).abs() <= tolerance).then_some([last, last + rise])
}

/// Largest radius of a window.
pub(super) const LARGEST_RADIUS: usize = 4;
/// Pixels along a side of the surroundings of the largest window.
const SURROUNDINGS: usize = 2 * (LARGEST_RADIUS + 2) + 1;

/// Lines that differ by more than this share of a jump lie on two surfaces. Tuned on the kitchen of 7-Scenes and a synthetic living room.
const STEP_SHARE: f32 = 0.75;

/// Share of a step that remains in the middle of three pixels after a plane is fitted to them.
pub(super) const BEND_SHARE: f64 = 1.0 / 3.0;

/// Pixels within this share of a bend of their plane lie on one surface. With twice as much, planes pass over the front edge of a table that is seen at
/// 15 degrees, half a pixel off either side.
const FLAT_SHARE: f32 = 0.25;

/// Three pixels that are collinear within this share of a jump are a line. With more, small steps within a surface pass for slopes,
/// which hide jumps.
const STRAIGHT_SHARE: f32 = 0.25;

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

/// The least-squares plane through the inverse depths of some pixels.
struct Plane {
    pixels: f32,
    center: [f32; 2],
    /// Value at the centre.
    rho: f32,
    slope: [f32; 2],
    /// Sums of squares xx, xy and yy about the centre.
    squares: [f32; 3],
    determinant: f32,
}

impl Plane {
    /// `None` when all pixels lie on a line.
    fn fit(pixels: &[WindowPixel]) -> Option<Self> {
        let n = pixels.len() as f32;
        let (mut x, mut y, mut rho) = (0.0_f32, 0.0_f32, 0.0_f32);
        for p in pixels {
            x += p.offset[0];
            y += p.offset[1];
            rho += p.rho;
        }
        let (x, y, rho) = (x / n, y / n, rho / n);
        let (mut xx, mut xy, mut yy) = (0.0_f32, 0.0_f32, 0.0_f32);
        let (mut xr, mut yr) = (0.0_f32, 0.0_f32);
        for p in pixels {
            let (dx, dy, dr) = (p.offset[0] - x, p.offset[1] - y, p.rho - rho);
            xx += dx * dx;
            xy += dx * dy;
            yy += dy * dy;
            xr += dx * dr;
            yr += dy * dr;
        }
        let determinant = xx * yy - xy * xy;
        (determinant > 0.0).then(|| Self {
            pixels: n,
            center: [x, y],
            rho,
            slope: [
                (yy * xr - xy * yr) / determinant,
                (xx * yr - xy * xr) / determinant,
            ],
            squares: [xx, xy, yy],
            determinant,
        })
    }

    /// The value at an offset; `None` where its variance exceeds twice that of a single pixel, as beside a single row.
    fn at(&self, offset: [f32; 2]) -> Option<f32> {
        let [xx, xy, yy] = self.squares;
        let (dx, dy) = (offset[0] - self.center[0], offset[1] - self.center[1]);
        // Variance of the plane in units of one pixel's: 1/n + d' S^-1 d. Offsets of pixels are small whole numbers.
        let lever = yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy;
        let is_far = lever > (2.0 - 1.0 / self.pixels) * self.determinant;
        (!is_far).then(|| self.rho + self.slope[0] * dx + self.slope[1] * dy)
    }

    /// Whether all pixels lie within `limit` of the plane.
    fn is_within(&self, pixels: &[WindowPixel], limit: f32) -> bool {
        pixels.iter().all(|p| {
            let from_center = [p.offset[0] - self.center[0], p.offset[1] - self.center[1]];
            (p.rho - self.rho - dot(self.slope, from_center)).abs() <= limit
        })
    }
}
