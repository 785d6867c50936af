//! Assigns depths to edge pixels.
//!
//! An image edge at a depth discontinuity is the occluding contour of the *near* surface. Edge localisation, registration and the contour
//! in the depth image each err by a pixel or more, so that many pixels of such an edge have the depth of the far surface or none. Raw
//! depths would move or split segments. At a depth jump near an edge pixel, the near side is therefore extrapolated as a plane to the pixel.
//! Elsewhere the pixel keeps its depth, optionally smoothed.
//!
//! *Differs from He et al., ICPR 2018*: the paper takes the raw depth of the pixel, as [`EdgeDepthOptions::raw`] does.

use super::map::{InverseDepth, InverseDepthMap, UNKNOWN};
use crate::edges::EdgeChains;

/// Options of [`EdgeDepths::compute`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct EdgeDepthOptions {
    /// Radius of the window in which a depth jump is detected, in pixels; 0 takes the raw depth of the pixel.
    pub radius_px: usize,
    /// Radius of the plane fit that smooths depths without a jump, in pixels; 0 disables smoothing.
    pub smoothing_radius_px: usize,
    /// Least gap of inverse depths at a jump, in standard deviations of a difference; `jump_relative` must hold too.
    pub jump_sigmas: f64,
    /// Least gap of inverse depths at a jump, as a share of the inverse depth.
    pub jump_relative: f64,
    /// Least number of pixels of the near side; fewer are treated as noise.
    pub least_support: usize,
}

impl Default for EdgeDepthOptions {
    /// Tuned on the kitchen of 7-Scenes (registration error about 2 pixels) and a synthetic living room.
    fn default() -> Self {
        Self {
            radius_px: 2,
            smoothing_radius_px: 1,
            jump_sigmas: 3.0,
            jump_relative: 0.01,
            least_support: 5,
        }
    }
}

impl EdgeDepthOptions {
    /// The raw depth of each pixel, as in the paper.
    pub fn raw() -> Self {
        Self {
            radius_px: 0,
            smoothing_radius_px: 0,
            ..Self::default()
        }
    }
}

/// The inverse depth of each pixel of a set of chains, in the order of [`EdgeChains::pixels`].
#[derive(Debug, Clone, Default)]
pub struct EdgeDepths {
    samples: Vec<InverseDepth>,
    pixels: Vec<WindowPixel>,
}

/// A known pixel of a window, relative to the window centre.
#[derive(Debug, Clone, Copy)]
struct WindowPixel {
    dx: f32,
    dy: f32,
    rho: f32,
}

impl EdgeDepths {
    /// The measurement of a chain pixel, by its index among all chain pixels.
    pub fn get(&self, position: usize) -> Option<InverseDepth> {
        self.samples
            .get(position)
            .copied()
            .filter(|sample| sample.rho > 0.0)
    }

    /// Number of chain pixels.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there is no chain pixel.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Number of chain pixels with a depth.
    pub fn known_count(&self) -> usize {
        self.samples
            .iter()
            .filter(|sample| sample.rho > 0.0)
            .count()
    }

    /// Computes the depth of each chain pixel, reusing the memory. Pixels outside the map have none.
    ///
    /// # Complexity
    /// O(chain pixels x pixels of a window).
    pub fn compute(
        &mut self,
        map: &InverseDepthMap,
        chains: &EdgeChains,
        options: &EdgeDepthOptions,
    ) {
        self.samples.clear();
        self.samples.reserve(chains.pixels().len());
        for &[x, y] in chains.pixels() {
            let (x, y) = (usize::from(x), usize::from(y));
            if x >= map.width() || y >= map.height() {
                self.samples.push(UNKNOWN);
                continue;
            }
            let window = Window {
                map,
                center: (x, y),
            };
            let near = if options.radius_px > 0 {
                let (nearest, farthest) = window.extremes(options.radius_px);
                near_side(&window, nearest, farthest, options, &mut self.pixels)
            } else {
                None
            };
            self.samples
                .push(near.unwrap_or_else(|| smoothed(&window, options, &mut self.pixels)));
        }
    }
}

/// A window around a pixel.
struct Window<'a> {
    map: &'a InverseDepthMap,
    center: (usize, usize),
}

impl Window<'_> {
    /// Nearest and farthest inverse depth within a radius, a fast test for windows without a jump; 0 and infinity when all
    /// pixels are unknown.
    fn extremes(&self, radius: usize) -> (f32, f32) {
        let (x, y) = self.center;
        let (width, height) = (self.map.width(), self.map.height());
        let (left, right) = (x.saturating_sub(radius), (x + radius).min(width - 1));
        let (top, bottom) = (y.saturating_sub(radius), (y + radius).min(height - 1));
        let (mut nearest, mut farthest) = (0.0_f32, f32::INFINITY);
        for row in top..=bottom {
            for sample in &self.map.row(row)[left..=right] {
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

    /// Calls `visit` with the offset and the inverse depth of each known pixel within a radius.
    fn for_each(&self, radius: usize, mut visit: impl FnMut(WindowPixel)) {
        let (x, y) = self.center;
        let (width, height) = (self.map.width(), self.map.height());
        let (left, right) = (x.saturating_sub(radius), (x + radius).min(width - 1));
        let (top, bottom) = (y.saturating_sub(radius), (y + radius).min(height - 1));
        for row in top..=bottom {
            let samples = &self.map.raw()[row * width + left..=row * width + right];
            let dy = row as f32 - y as f32;
            let first = left as f32 - x as f32;
            for (column, sample) in samples.iter().enumerate() {
                if sample.rho > 0.0 {
                    visit(WindowPixel {
                        dx: first + column as f32,
                        dy,
                        rho: sample.rho,
                    });
                }
            }
        }
    }

    /// Standard deviation at a pixel of the window.
    fn sigma(&self, pixel: &WindowPixel) -> f32 {
        let x = (self.center.0 as f32 + pixel.dx) as usize;
        let y = (self.center.1 as f32 + pixel.dy) as usize;
        self.map.raw()[y * self.map.width() + x].sigma
    }
}

/// The depth without a jump: a plane fit to close pixels, or the own depth of the pixel.
fn smoothed(
    window: &Window<'_>,
    options: &EdgeDepthOptions,
    pixels: &mut Vec<WindowPixel>,
) -> InverseDepth {
    let (x, y) = window.center;
    let own = window.map.raw()[y * window.map.width() + x];
    if options.smoothing_radius_px == 0 || own.rho <= 0.0 {
        return own;
    }
    pixels.clear();
    window.for_each(options.smoothing_radius_px, |pixel| pixels.push(pixel));
    if pixels.len() < options.least_support {
        return own;
    }
    InverseDepth::new(plane_at_centre(pixels), own.sigma).unwrap_or(own)
}

/// The depth at a jump: the plane of the near side at the window centre; `None` without a jump.
///
/// The near side comes from a histogram of inverse depths with bins of half a jump, from near to far: it ends at the first empty bin after
/// enough pixels. Smaller groups in front of it are flying pixels and are ignored.
fn near_side(
    window: &Window<'_>,
    nearest: f32,
    farthest: f32,
    options: &EdgeDepthOptions,
    pixels: &mut Vec<WindowPixel>,
) -> Option<InverseDepth> {
    const BINS: usize = 64;
    let relative = options.jump_relative as f32 * nearest;
    if nearest - farthest <= relative {
        return None;
    }
    // The noise of the nearest pixel: sigma varies slowly with inverse depth.
    let mut sigma = 0.0_f32;
    window.for_each(options.radius_px, |pixel| {
        if pixel.rho == nearest {
            sigma = window.sigma(&pixel);
        }
    });
    let jump = relative.max(options.jump_sigmas as f32 * std::f32::consts::SQRT_2 * sigma);
    if nearest - farthest <= jump {
        return None;
    }
    let per_bin = 2.0 / jump;
    // The last bin takes all farther pixels.
    let bin = |rho: f32| (((nearest - rho) * per_bin) as usize).min(BINS - 1);
    let mut counts = [0_usize; BINS];
    window.for_each(options.radius_px, |pixel| counts[bin(pixel.rho)] += 1);
    let (mut first, mut support) = (0, 0);
    for (index, &pixels_in_bin) in counts.iter().enumerate() {
        if pixels_in_bin > 0 {
            support += pixels_in_bin;
            continue;
        }
        if support >= options.least_support {
            if counts[index..].iter().sum::<usize>() == 0 {
                return None;
            }
            pixels.clear();
            window.for_each(options.radius_px, |pixel| {
                if (first..index).contains(&bin(pixel.rho)) {
                    pixels.push(pixel);
                }
            });
            return InverseDepth::new(plane_at_centre(pixels), sigma);
        }
        first = index + 1;
        support = 0;
    }
    None
}

/// The value of the least-squares plane `rho = a + b dx + c dy` at the window centre; the mean when the variance of the plane there exceeds
/// twice that of a single pixel.
fn plane_at_centre(pixels: &[WindowPixel]) -> f32 {
    let n = pixels.len() as f32;
    let (mut x, mut y, mut rho) = (0.0_f32, 0.0_f32, 0.0_f32);
    for p in pixels {
        x += p.dx;
        y += p.dy;
        rho += p.rho;
    }
    let (x, y, rho) = (x / n, y / n, rho / n);
    let (mut xx, mut xy, mut yy, mut xr, mut yr) = (0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32, 0.0_f32);
    for p in pixels {
        let (dx, dy, dr) = (p.dx - x, p.dy - y, p.rho - rho);
        xx += dx * dx;
        xy += dx * dy;
        yy += dy * dy;
        xr += dx * dr;
        yr += dy * dr;
    }
    let determinant = xx * yy - xy * xy;
    // Variance of the plane at the centre in units of one pixel's: 1/n + d' S^-1 d. Offsets are small whole numbers.
    let lever = yy * x * x - 2.0 * xy * x * y + xx * y * y;
    if determinant <= 0.0 || lever > (2.0 - 1.0 / n) * determinant {
        return rho;
    }
    let slope_x = (yy * xr - xy * yr) / determinant;
    let slope_y = (xx * yr - xy * xr) / determinant;
    rho - slope_x * x - slope_y * y
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 40;

    fn map(rho: impl Fn(f64, f64) -> f64) -> InverseDepthMap {
        let mut map = InverseDepthMap::unknown(SIZE, SIZE).unwrap();
        for y in 0..SIZE {
            for x in 0..SIZE {
                map.set(
                    x,
                    y,
                    InverseDepth::new(rho(x as f64, y as f64) as f32, 0.001),
                );
            }
        }
        map
    }

    fn column(x: u32) -> EdgeChains {
        let mut chains = EdgeChains::new(SIZE, SIZE);
        let indices: Vec<u32> = (0..SIZE as u32).map(|y| y * SIZE as u32 + x).collect();
        chains.push(&indices);
        chains
    }

    fn depths(map: &InverseDepthMap, x: u32, options: &EdgeDepthOptions) -> Vec<Option<f32>> {
        let mut depths = EdgeDepths::default();
        depths.compute(map, &column(x), options);
        (0..depths.len())
            .map(|i| depths.get(i).map(|d| d.rho))
            .collect()
    }

    #[test]
    fn edge_beside_a_jump_belongs_to_the_near_side() {
        // Near (slanted) up to column 19, far beyond: an edge drawn a pixel into the far side is still near.
        let near = |x: f64, y: f64| 0.8 + 0.002 * x - 0.003 * y;
        let map = map(|x, y| if x < 19.5 { near(x, y) } else { 0.4 });
        for x in [17, 19, 20] {
            let found = depths(&map, x, &EdgeDepthOptions::default());
            // At the image border half of the window is missing.
            for (y, rho) in found.iter().enumerate().skip(3).take(SIZE - 6) {
                let expected = near(f64::from(x), y as f64) as f32;
                assert!(
                    (rho.unwrap() - expected).abs() < 2e-3,
                    "column {x}, row {y}: {rho:?} against {expected}"
                );
            }
        }
        // Out of reach it is far.
        assert!(
            depths(&map, 24, &EdgeDepthOptions::default())
                .iter()
                .all(|r| (r.unwrap() - 0.4).abs() < 1e-6)
        );
    }

    #[test]
    fn raw_option_takes_what_lies_there() {
        let map = map(|x, _| if x < 19.5 { 0.8 } else { 0.4 });
        assert!(
            depths(&map, 20, &EdgeDepthOptions::raw())
                .iter()
                .all(|&r| r == Some(0.4))
        );
    }

    #[test]
    fn a_slanted_plane_is_no_jump_and_stays_exact() {
        let plane = |x: f64, y: f64| 0.5 + 0.004 * x + 0.001 * y;
        let found = depths(&map(plane), 20, &EdgeDepthOptions::default());
        for (y, rho) in found.iter().enumerate() {
            assert!((rho.unwrap() - plane(20.0, y as f64) as f32).abs() < 1e-5);
        }
    }

    #[test]
    fn a_few_flying_pixels_are_no_near_side() {
        let mut map = map(|_, _| 0.5);
        map.set(21, 20, InverseDepth::new(0.9, 0.001));
        map.set(21, 21, InverseDepth::new(0.95, 0.001));
        let found = depths(
            &map,
            20,
            &EdgeDepthOptions {
                smoothing_radius_px: 0,
                ..EdgeDepthOptions::default()
            },
        );
        assert!(found.iter().all(|r| (r.unwrap() - 0.5).abs() < 1e-6));
    }

    #[test]
    fn unknown_stays_unknown_without_a_near_side() {
        let empty = InverseDepthMap::unknown(SIZE, SIZE).unwrap();
        for options in [EdgeDepthOptions::default(), EdgeDepthOptions::raw()] {
            assert!(depths(&empty, 20, &options).iter().all(Option::is_none));
        }
        // A map smaller than the image has no depth for the rest.
        let small = InverseDepthMap::unknown(10, 10).unwrap();
        assert!(
            depths(&small, 20, &EdgeDepthOptions::default())
                .iter()
                .all(Option::is_none)
        );
    }
}
