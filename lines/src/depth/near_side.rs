//! The near surface in a small window of an inverse depth map, as a plane.

use std::ops::Range;

use super::map::InverseDepthMap;

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
    /// Inverse depth minus that of a plane with some slope through 0.
    rest: f32,
    /// Rise of the inverse depth per pixel along each axis; NaN where the map is not locally linear.
    slope: [f32; 2],
}

/// Smallest gap of inverse depths at a depth jump.
#[derive(Debug, Clone, Copy)]
pub(super) struct JumpLimits {
    pub(super) radius_px: usize,
    pub(super) sigmas: f32,
    pub(super) relative: f32,
    pub(super) least_support: usize,
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

    /// Nearest and farthest inverse depth within a radius, a fast test for windows without a jump; 0 and infinity when all
    /// pixels are unknown.
    fn extremes(&self, radius: usize) -> (f32, f32) {
        let bounds = self.bounds(radius);
        let (mut nearest, mut farthest) = (0.0_f32, f32::INFINITY);
        for row in bounds.top..=bounds.bottom {
            for sample in &self.map.row(row)[bounds.left..=bounds.right] {
                let rho = sample.rho;
                nearest = if rho > nearest { rho } else { nearest };
                farthest = if (rho < farthest) & (rho > 0.0) {
                    rho
                } else {
                    farthest
                };
            }
        }
        (nearest, farthest)
    }

    /// The noise of the nearest pixel within a radius: sigma varies slowly with inverse depth.
    fn sigma_of(&self, radius: usize, nearest: f32) -> f32 {
        let bounds = self.bounds(radius);
        (bounds.top..=bounds.bottom)
            .flat_map(|row| &self.map.row(row)[bounds.left..=bounds.right])
            .find(|sample| sample.rho == nearest)
            .map_or(0.0, |sample| sample.sigma)
    }

    /// The known pixels within a radius, without slopes.
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
                        rest: sample.rho,
                        slope: [f32::NAN; 2],
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

    /// Whether inverse depths within a radius may have a gap; false only when there is none.
    fn may_have_gap(&self, radius: usize, nearest: f32, gap: f32) -> bool {
        // One bit for each half gap that has a pixel. The last one has all farther pixels.
        let (mut occupied, per_gap) = (0_u64, 2.0 / gap);
        let bounds = self.bounds(radius);
        for row in bounds.top..=bounds.bottom {
            for sample in &self.map.row(row)[bounds.left..=bounds.right] {
                if sample.rho > 0.0 {
                    occupied |= 1 << (((nearest - sample.rho) * per_gap) as u32).min(63);
                }
            }
        }
        let is_contiguous = occupied & occupied.wrapping_add(1) == 0;
        !is_contiguous || occupied >> 63 == 1
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

    /// The plane of the near side of a depth jump at the point, and its standard deviation; `None` without a jump.
    ///
    /// A surface seen at a grazing angle rises from pixel to pixel as much as a jump does. Gaps are therefore judged after the
    /// slope of the surface is subtracted, first the usual slope in the window, then that of the near side. Groups of few
    /// pixels in front of the near side are flying pixels and are ignored.
    pub(super) fn near_side(
        &self,
        limits: &JumpLimits,
        pixels: &mut Vec<WindowPixel>,
    ) -> Option<(f32, f32)> {
        let (nearest, farthest) = self.extremes(limits.radius_px);
        let relative = limits.relative * nearest;
        if nearest - farthest <= relative {
            return None;
        }
        let sigma = self.sigma_of(limits.radius_px, nearest);
        let jump = relative.max(limits.sigmas * std::f32::consts::SQRT_2 * sigma);
        let gap = GAP_SHARE * jump;
        if nearest - farthest <= jump || !self.may_have_gap(limits.radius_px, nearest, gap) {
            return None;
        }
        self.collect(limits.radius_px, pixels);
        let straight = STRAIGHT_SHARE * jump;
        let surroundings = self.surroundings(limits.radius_px);
        for pixel in pixels.iter_mut() {
            pixel.slope = surroundings.slopes(pixel.offset, straight);
        }
        let slope = usual_slope(pixels);
        detrend(pixels, slope);
        let seed = first_group(pixels, gap, limits.least_support)?;
        if seed.end == pixels.len() {
            return None;
        }
        let slope = usual_slope(&pixels[seed.clone()]);
        let inside = pixels[seed.start + seed.len() / 2].offset;
        detrend(pixels, slope);
        let member = pixels.iter().position(|pixel| pixel.offset == inside)?;
        let near = group_around(pixels, member, gap);
        if near.end == pixels.len() || near.len() < limits.least_support {
            return None;
        }
        let near = &pixels[near];
        // Thin objects have no slope across.
        let plane = Plane::fit(near).and_then(|plane| plane.at(self.offset));
        let rest = plane.unwrap_or_else(|| mean_rest(near));
        Some((rest + dot(slope, self.offset), sigma))
    }
}

/// Inverse depths around a pixel.
struct Surroundings {
    rho: [[f32; SURROUNDINGS]; SURROUNDINGS],
    /// Row and column of the pixel.
    reach: usize,
}

impl Surroundings {
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

/// Largest radius of a window.
pub(super) const LARGEST_RADIUS: usize = 4;
/// Pixels along a side of the surroundings of the largest window.
const SURROUNDINGS: usize = 2 * (LARGEST_RADIUS + 2) + 1;

/// Gaps of this share of a jump separate two surfaces. Tuned on the kitchen of 7-Scenes and a synthetic living room.
const GAP_SHARE: f32 = 0.75;

/// Share of a step that remains in the middle of three pixels after a plane is fitted to them.
pub(super) const BEND_SHARE: f64 = 1.0 / 3.0;

/// Pixels within this share of a bend of their plane lie on one surface. With twice as much, planes pass over the front edge of a table that is seen at
/// 15 degrees, half a pixel off either side.
const FLAT_SHARE: f32 = 0.25;

/// Three pixels that are collinear within this share of a jump give a slope. With more, small steps within a surface pass for slopes,
/// which hide jumps.
const STRAIGHT_SHARE: f32 = 0.25;

fn dot(a: [f32; 2], b: [f32; 2]) -> f32 {
    a[0] * b[0] + a[1] * b[1]
}

/// Subtracts a slope from the inverse depths and sorts the pixels from near to far.
fn detrend(pixels: &mut [WindowPixel], slope: [f32; 2]) {
    for pixel in pixels.iter_mut() {
        pixel.rest = pixel.rho - dot(slope, pixel.offset);
    }
    pixels.sort_unstable_by(|a, b| b.rest.total_cmp(&a.rest));
}

/// The median slope along each axis; 0 where fewer than [`LEAST_SLOPES`] pixels have one.
fn usual_slope(pixels: &[WindowPixel]) -> [f32; 2] {
    [0, 1].map(|axis| {
        let mut slopes = [0.0; MOST_PIXELS];
        let mut count = 0;
        let known = pixels.iter().map(|pixel| pixel.slope[axis]);
        let known = known.filter(|slope| !slope.is_nan());
        for (slot, slope) in slopes.iter_mut().zip(known) {
            *slot = slope;
            count += 1;
        }
        if count < LEAST_SLOPES {
            return 0.0;
        }
        *slopes[..count]
            .select_nth_unstable_by(count / 2, f32::total_cmp)
            .1
    })
}

/// A slope of fewer pixels is that of noise or of a small step.
const LEAST_SLOPES: usize = 3;

/// A median takes at most so many pixels: those of the largest window.
const MOST_PIXELS: usize = (2 * LARGEST_RADIUS + 1) * (2 * LARGEST_RADIUS + 1);

/// Whether a gap follows the pixel at `index`, which is not the last one.
fn is_gap_after(pixels: &[WindowPixel], index: usize, gap: f32) -> bool {
    pixels[index].rest - pixels[index + 1].rest > gap
}

/// The first group of at least `least` sorted pixels between gaps.
fn first_group(pixels: &[WindowPixel], gap: f32, least: usize) -> Option<Range<usize>> {
    let mut start = 0;
    while start < pixels.len() {
        let group = group_around(pixels, start, gap);
        if group.len() >= least {
            return Some(group);
        }
        start = group.end;
    }
    None
}

/// The sorted pixels around one of them, as far as the next gaps.
fn group_around(pixels: &[WindowPixel], member: usize, gap: f32) -> Range<usize> {
    let start = (0..member)
        .rev()
        .find(|&index| is_gap_after(pixels, index, gap))
        .map_or(0, |index| index + 1);
    let end = (member..pixels.len() - 1)
        .find(|&index| is_gap_after(pixels, index, gap))
        .map_or(pixels.len(), |index| index + 1);
    start..end
}

fn mean_rest(pixels: &[WindowPixel]) -> f32 {
    pixels.iter().map(|pixel| pixel.rest).sum::<f32>() / pixels.len() as f32
}

/// The least-squares plane through `rest` of some pixels.
struct Plane {
    pixels: f32,
    center: [f32; 2],
    /// Value at the centre.
    rest: f32,
    slope: [f32; 2],
    /// Sums of squares xx, xy and yy about the centre.
    squares: [f32; 3],
    determinant: f32,
}

impl Plane {
    /// `None` when all pixels lie on a line.
    fn fit(pixels: &[WindowPixel]) -> Option<Self> {
        let n = pixels.len() as f32;
        let (mut x, mut y, mut rest) = (0.0_f32, 0.0_f32, 0.0_f32);
        for p in pixels {
            x += p.offset[0];
            y += p.offset[1];
            rest += p.rest;
        }
        let (x, y, rest) = (x / n, y / n, rest / n);
        let (mut xx, mut xy, mut yy) = (0.0_f32, 0.0_f32, 0.0_f32);
        let (mut xr, mut yr) = (0.0_f32, 0.0_f32);
        for p in pixels {
            let (dx, dy, dr) = (p.offset[0] - x, p.offset[1] - y, p.rest - rest);
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
            rest,
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
        (!is_far).then(|| self.rest + self.slope[0] * dx + self.slope[1] * dy)
    }

    /// Whether all pixels lie within `limit` of the plane.
    fn is_within(&self, pixels: &[WindowPixel], limit: f32) -> bool {
        pixels.iter().all(|p| {
            let from_center = [p.offset[0] - self.center[0], p.offset[1] - self.center[1]];
            (p.rest - self.rest - dot(self.slope, from_center)).abs() <= limit
        })
    }
}
