//! Assigns depths to edge pixels.
//!
//! An image edge at a depth discontinuity is the occluding contour of the *near* surface. Edge localisation, registration and the contour
//! in the depth image each err by a pixel or more, so that many pixels of such an edge have the depth of the far surface or none. Raw
//! depths would move or split segments. At a depth jump near an edge pixel, the near side is therefore extrapolated to the edge.
//! Elsewhere the depth is that of a plane through adjacent pixels, or, where these are not on a plane, of the pixel's own side of the step.
//!
//! Both are evaluated at the sub-pixel position of the edge. It lies up to half a pixel from the pixel centre, on the same side
//! for many consecutive pixels, so that depths of pixel centres would be off by half a pixel of slope, which no fit averages out.
//!
//! *Differs from He et al., ICPR 2018*: the paper takes the raw depth of the pixel, as [`EdgeDepthOptions::raw`] does.

use super::near_side::{BEND_SHARE, JumpLimits, LARGEST_RADIUS, Window, WindowPixel};
use crate::edges::EdgeChains;
use crate::inverse_depth::{InverseDepth, InverseDepthMap, UNKNOWN};

/// Options of [`EdgeDepths::compute`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct EdgeDepthOptions {
    /// Radius of the window in which a depth jump is detected, in pixels, at most 4; 0 takes the raw depth of the pixel.
    pub radius_px: usize,
    /// Radius of the plane through adjacent pixels where there is no jump, in pixels; 0 takes the depth of the pixel centre.
    pub smoothing_radius_px: usize,
    /// Least difference of inverse depths at a jump, in standard deviations of a difference; `jump_relative` must hold too.
    pub jump_sigmas: f64,
    /// Least difference of inverse depths at a jump, as a share of the inverse depth.
    pub jump_relative: f64,
    /// Least number of pixels of the plane through adjacent ones.
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
    /// The depth stored at each pixel: for maps that are valid at the edge itself, and for fits to whole pixels, as in the paper.
    pub fn raw() -> Self {
        Self {
            radius_px: 0,
            smoothing_radius_px: 0,
            ..Self::default()
        }
    }
}

/// The inverse depth of each pixel of a set of chains at its sub-pixel position, in the order of [`EdgeChains::pixels`].
#[derive(Debug, Clone, Default)]
pub struct EdgeDepths {
    samples: Vec<InverseDepth>,
    pixels: Vec<WindowPixel>,
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
        let limits = JumpLimits {
            radius_px: options.radius_px.min(LARGEST_RADIUS),
            sigmas: options.jump_sigmas as f32,
            relative: options.jump_relative as f32,
        };
        for (&[x, y], position) in chains.pixels().iter().zip(chains.positions()) {
            let center = (usize::from(x), usize::from(y));
            if center.0 >= map.width() || center.1 >= map.height() {
                self.samples.push(UNKNOWN);
                continue;
            }
            let window = Window {
                map,
                center,
                offset: [position[0] - f32::from(x), position[1] - f32::from(y)],
            };
            let near = (options.radius_px > 0)
                .then(|| window.near_side(&limits))
                .flatten()
                .and_then(|(rho, sigma)| InverseDepth::new(rho, sigma));
            self.samples
                .push(near.unwrap_or_else(|| smoothed(&window, options, &mut self.pixels)));
        }
    }
}

/// The depth without a jump: that of the surface through close pixels, or the own depth of the pixel.
fn smoothed(
    window: &Window<'_>,
    options: &EdgeDepthOptions,
    pixels: &mut Vec<WindowPixel>,
) -> InverseDepth {
    let (x, y) = window.center;
    let own = window.map.row(y)[x];
    if options.smoothing_radius_px == 0 || own.rho <= 0.0 {
        return own;
    }
    let bend = (BEND_SHARE * options.jump_relative) as f32 * own.rho;
    let (radius, least) = (options.smoothing_radius_px, options.least_support);
    window
        .surface(own.rho, radius, least, bend, pixels)
        .and_then(|rho| InverseDepth::new(rho, own.sigma))
        .unwrap_or(own)
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

    /// A row of edge pixels whose edge lies `below` the centres of the pixels.
    fn row(y: u32, below: f32) -> EdgeChains {
        let mut chains = EdgeChains::new(SIZE, SIZE);
        let indices: Vec<u32> = (0..SIZE as u32).map(|x| y * SIZE as u32 + x).collect();
        let positions: Vec<[f32; 2]> = (0..SIZE).map(|x| [x as f32, y as f32 + below]).collect();
        chains.push_at(&indices, &positions);
        chains
    }

    /// Largest relative error along a row, without the borders of the image.
    fn worst_error(
        map: &InverseDepthMap,
        chains: &EdgeChains,
        truth: impl Fn(f64, f64) -> f64,
    ) -> f64 {
        let mut depths = EdgeDepths::default();
        depths.compute(map, chains, &EdgeDepthOptions::default());
        (4..SIZE - 4)
            .map(|i| {
                let [x, y] = chains.positions()[i].map(f64::from);
                let found = f64::from(depths.get(i).expect("depth is everywhere").rho);
                (found / truth(x, y) - 1.0).abs()
            })
            .fold(0.0, f64::max)
    }

    #[test]
    fn depth_is_that_of_the_edge_not_of_the_pixel_centre() {
        let slanted = |x: f64, y: f64| 0.5 + 0.001 * x + 0.004 * y;
        let step = |x: f64, y: f64| if y < 20.5 { slanted(x, y) } else { 0.3 };
        for below in [-0.5, -0.2, 0.0, 0.3, 0.5] {
            let without = worst_error(&map(slanted), &row(20, below), slanted);
            let with_jump = worst_error(&map(step), &row(20, below), slanted);
            // Half a pixel of slope is 0.3 %.
            assert!(
                without.max(with_jump) < 1e-5,
                "{below}: {without} {with_jump}"
            );
        }
    }

    #[test]
    fn depth_beside_a_small_step_is_that_of_one_surface() {
        // A step of 1.2 %, less than a jump of this sensor, between surfaces that rise across the rows.
        let near = |x: f64, y: f64| 0.504 + 0.0002 * x + 0.0005 * y;
        let far = |x: f64, y: f64| near(x, y) - 0.006;
        let mut step = map(|_, _| 1.0);
        for (x, y) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))) {
            let surface: &dyn Fn(f64, f64) -> f64 = if y <= 20 { &near } else { &far };
            let rho = surface(x as f64, y as f64) as f32;
            step.set(x, y, InverseDepth::new(rho, 0.002));
        }
        for below in [-0.4, 0.0, 0.4] {
            for (y, own) in [(20, &near as &dyn Fn(f64, f64) -> f64), (21, &far)] {
                let error = worst_error(&step, &row(y, below), own);
                assert!(error < 1e-5, "row {y}, {below}: {error}");
            }
        }
    }

    #[test]
    fn depth_at_a_crease_is_that_of_one_side() {
        // The front edge of a table 2.6 m away, seen at 13 degrees: its top recedes by 0.9 % a row, its front does not.
        let front = |_: f64, _: f64| 0.385;
        let top = |_: f64, y: f64| 0.385 * (1.0 - 0.009 * (20.5 - y));
        let mut table = map(|_, _| 1.0);
        for (x, y) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))) {
            let side: &dyn Fn(f64, f64) -> f64 = if y <= 20 { &top } else { &front };
            let rho = side(x as f64, y as f64) as f32;
            table.set(x, y, InverseDepth::new(rho, 0.0015));
        }
        for below in [-0.4, 0.0, 0.4] {
            for (y, own) in [(20, &top as &dyn Fn(f64, f64) -> f64), (21, &front)] {
                let error = worst_error(&table, &row(y, below), own);
                assert!(error < 1e-5, "row {y}, {below}: {error}");
            }
        }
    }

    #[test]
    fn a_plane_at_a_grazing_angle_has_no_jump() {
        // A floor seen by a camera that looks along it: inverse depth grows from 0 at the horizon. Also tilted, and with the
        // horizon along the columns.
        for below_horizon in [20.0, 50.0, 70.0, 150.0] {
            for tilt in [-0.7, 0.0, 0.1, 1.0] {
                let floor = |x: f64, y: f64| 0.004 * (below_horizon + y - 20.0 + tilt * (x - 20.0));
                if floor(0.0, 0.0).min(floor(SIZE as f64, 0.0)) <= 0.0 {
                    continue;
                }
                let error = worst_error(&map(floor), &row(20, 0.3), floor);
                assert!(
                    error < 1e-5,
                    "{below_horizon} px below the horizon, tilt {tilt}: {error}"
                );
                let wall = |x: f64, y: f64| floor(y, x);
                let error = worst_error(&map(wall), &row(20, 0.3), wall);
                assert!(
                    error < 1e-5,
                    "{below_horizon} px beside, tilt {tilt}: {error}"
                );
            }
        }
    }

    #[test]
    fn the_near_side_of_a_jump_may_be_seen_at_a_grazing_angle() {
        let table = |_: f64, y: f64| 0.004 * (60.0 + y - 20.0);
        let wall = |_: f64, _: f64| 0.15;
        let floor = |_: f64, y: f64| 0.003 * (60.0 + y - 20.0);
        let cupboard = |_: f64, _: f64| 0.4;
        // The near surface starts or ends at row 20; the edge is found up to two rows beyond it.
        for (name, near, far, is_near_above) in [
            (
                "table before wall",
                &table as &dyn Fn(f64, f64) -> f64,
                &wall as &dyn Fn(f64, f64) -> f64,
                false,
            ),
            ("table before floor", &table, &floor, false),
            ("table above floor", &table, &floor, true),
            ("cupboard above floor", &cupboard, &floor, true),
            ("cupboard before floor", &cupboard, &floor, false),
        ] {
            for beyond in 0..=2 {
                let (scene, y): (InverseDepthMap, u32) = if is_near_above {
                    (
                        map(|x, y| if y < 20.5 { near(x, y) } else { far(x, y) }),
                        20 + beyond,
                    )
                } else {
                    (
                        map(|x, y| if y > 19.5 { near(x, y) } else { far(x, y) }),
                        20 - beyond,
                    )
                };
                for below in [-0.4, 0.0, 0.4] {
                    let error = worst_error(&scene, &row(y, below), near);
                    assert!(error < 1e-4, "{name}, {beyond} beyond, {below}: {error}");
                }
            }
        }
    }

    #[test]
    fn the_near_side_of_a_small_jump_is_found_at_a_grazing_angle() {
        // A desk at 2.8 m seen at 15 degrees, and the wall behind it: from one row to the next the desk recedes by half as much as the wall
        // lies behind its rim.
        let desk = |_: f64, y: f64| 0.357 * (1.0 - 0.009 * (20.5 - y));
        let wall = |_: f64, y: f64| 0.3505 + 0.0001 * (y - 20.5);
        for is_desk_below in [true, false] {
            let towards = |y: f64| if is_desk_below { y } else { 41.0 - y };
            let near = |x: f64, y: f64| desk(x, towards(y));
            let mut scene = map(|_, _| 1.0);
            for (x, y) in (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x, y))) {
                let (x_px, y_px) = (x as f64, y as f64);
                let rho = match towards(y_px) > 20.5 {
                    true => near(x_px, y_px),
                    false => wall(x_px, towards(y_px)),
                };
                scene.set(x, y, InverseDepth::new(rho as f32, 0.0004));
            }
            for y in [20, 21] {
                for below in [-0.4, 0.0, 0.4] {
                    let error = worst_error(&scene, &row(y, below), near);
                    assert!(error < 1e-4, "row {y}, {below}: {error}");
                }
            }
        }
    }
}
