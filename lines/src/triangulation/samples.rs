//! Planes fitted to depth windows on a pixel grid.

use nalgebra::Point2;

use super::options::SampleOptions;
use super::packed::PackedSamples;
use super::window::PlaneWindows;
use crate::inverse_depth::InverseDepthMap;

/// The local surface plane at a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceSample {
    /// Inverse depth at the pixel, positive.
    pub rho: f32,
    /// Gradient of the inverse depth per pixel along x and y.
    pub slope: [f32; 2],
    /// Standard deviation of the inverse depth of one pixel, positive; used for the plane because the errors of adjacent pixels are
    /// correlated.
    pub sigma: f32,
}

/// Local surface planes on a pixel grid; windows without a dominant plane have none.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceSamples {
    step_px: u32,
    columns: usize,
    rows: usize,
    /// Row by row.
    samples: Storage,
}

/// Samples in memory.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
enum Storage {
    /// An inverse depth of 0 marks a missing sample.
    Whole(Vec<SurfaceSample>),
    Packed(PackedSamples),
}

impl Default for Storage {
    fn default() -> Self {
        Self::Whole(Vec::new())
    }
}

impl SurfaceSamples {
    /// Samples a dense depth map; semi-dense maps give few samples or none.
    ///
    /// The options are to be [valid](SampleOptions::validate); a step of 0 counts as 1.
    ///
    /// # Complexity
    /// O(samples x pixels of a window).
    pub fn measure(map: &InverseDepthMap, options: &SampleOptions) -> Self {
        let step = options.step_px.max(1) as usize;
        let (columns, rows) = (map.width() / step, map.height() / step);
        let mut windows = PlaneWindows::new(map, options);
        let mut samples = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            let y = row * step + step / 2;
            windows.advance(y);
            let fit = |column| windows.fit(column * step + step / 2, y).unwrap_or_default();
            samples.extend((0..columns).map(fit));
        }
        Self {
            step_px: step as u32,
            columns,
            rows,
            samples: Storage::Whole(samples),
        }
    }

    /// Samples on a grid, row by row; an inverse depth of 0 marks a missing one.
    pub(crate) fn new(
        step_px: u32,
        columns: usize,
        rows: usize,
        samples: Vec<SurfaceSample>,
    ) -> Self {
        debug_assert_eq!(samples.len(), columns * rows);
        Self {
            step_px,
            columns,
            rows,
            samples: Storage::Whole(samples),
        }
    }

    /// Every second sample of every second row, with at most a quarter of the memory and twice the spacing.
    pub fn thinned(&self) -> Self {
        let (columns, rows) = (self.columns / 2, self.rows / 2);
        // From the pixel of a sample to the centre of its new grid square.
        let shift = (self.step_px - self.step_px / 2) as f32;
        let samples = (0..rows)
            .flat_map(|row| (0..columns).map(move |column| (2 * column, 2 * row)))
            .map(|(column, row)| {
                let sample = self.get(column, row).unwrap_or_default();
                let rho = sample.rho + shift * (sample.slope[0] + sample.slope[1]);
                SurfaceSample {
                    // A plane that reaches infinite depth on the way is unknown.
                    rho: if sample.rho > 0.0 { rho.max(0.0) } else { 0.0 },
                    ..sample
                }
            });
        Self {
            step_px: 2 * self.step_px,
            columns,
            rows,
            samples: Storage::Packed(PackedSamples::new(samples)),
        }
    }

    /// Number of grid columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of grid rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Grid spacing in pixels; 0 for an empty grid.
    pub fn step_px(&self) -> u32 {
        self.step_px
    }

    /// Number of samples with a plane.
    pub fn known_count(&self) -> usize {
        match &self.samples {
            Storage::Whole(samples) => samples.iter().filter(|sample| sample.rho > 0.0).count(),
            Storage::Packed(samples) => samples.known_count(),
        }
    }

    /// The sample at a column and row; `None` when missing.
    #[inline]
    pub fn get(&self, column: usize, row: usize) -> Option<SurfaceSample> {
        if column >= self.columns {
            return None;
        }
        let index = row * self.columns + column;
        match &self.samples {
            Storage::Whole(samples) => samples
                .get(index)
                .filter(|sample| sample.rho > 0.0)
                .copied(),
            Storage::Packed(samples) => samples.get(index),
        }
    }

    /// The pixel at the centre of a sample.
    #[inline]
    pub fn pixel(&self, column: usize, row: usize) -> Point2<f64> {
        let step = self.step_px as usize;
        let at = |index: usize| (index * step + step / 2) as f64;
        Point2::new(at(column), at(row))
    }

    /// The surface at a pixel, extrapolated from the nearest sample; `None` without a sample, outside the image and where the plane reaches
    /// infinite depth.
    pub fn near(&self, pixel: &Point2<f64>) -> Option<SurfaceSample> {
        let step = f64::from(self.step_px);
        // The nearest whole number; halves go up. The comparison also rejects NaN.
        let index = |along: f64| {
            let along = along / step;
            if !(along > -0.5 && along < 65535.0) {
                return None;
            }
            let below = along as i64;
            let fraction = along - below as f64;
            Some((below + i64::from(fraction >= 0.5)) as usize)
        };
        let offset = f64::from(self.step_px / 2);
        let (column, row) = (index(pixel.x - offset)?, index(pixel.y - offset)?);
        let sample = self.get(column, row)?;
        let away = pixel - self.pixel(column, row);
        let rho = f64::from(sample.rho)
            + away.x * f64::from(sample.slope[0])
            + away.y * f64::from(sample.slope[1]);
        (rho > 0.0).then_some(SurfaceSample {
            rho: rho as f32,
            ..sample
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inverse_depth::InverseDepth;

    fn map(rho: impl Fn(usize, usize) -> Option<f32>) -> InverseDepthMap {
        let mut map = InverseDepthMap::unknown(64, 48).unwrap();
        for y in 0..48 {
            for x in 0..64 {
                map.set(
                    x,
                    y,
                    rho(x, y).and_then(|rho| InverseDepth::new(rho, 0.002)),
                );
            }
        }
        map
    }

    #[test]
    fn a_plane_is_sampled_exactly_at_every_pixel() {
        let plane = |x: f64, y: f64| 0.5 + 0.001 * x - 0.0005 * y;
        let map = map(|x, y| Some(plane(x as f64, y as f64) as f32));
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default());
        assert_eq!((samples.columns(), samples.rows()), (32, 24));
        // Windows at the corners of the image are cut off: too few pixels.
        assert!(samples.known_count() >= 30 * 22);
        for pixel in [Point2::new(30.0, 20.0), Point2::new(33.7, 21.2)] {
            let sample = samples.near(&pixel).unwrap();
            assert!((f64::from(sample.rho) - plane(pixel.x, pixel.y)).abs() < 1e-6);
            assert!((f64::from(sample.slope[0]) - 0.001).abs() < 1e-6);
        }
    }

    #[test]
    fn a_plane_stays_where_it_is_when_thinned() {
        let plane = |x: f64, y: f64| 0.5 + 0.001 * x - 0.0005 * y;
        let map = map(|x, y| Some(plane(x as f64, y as f64) as f32));
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default()).thinned();
        assert_eq!(
            (samples.columns(), samples.rows(), samples.step_px()),
            (16, 12, 4)
        );
        for pixel in [Point2::new(30.0, 20.0), Point2::new(37.7, 27.2)] {
            let sample = samples.near(&pixel).unwrap();
            // Depth and slopes are rounded.
            assert!((f64::from(sample.rho) - plane(pixel.x, pixel.y)).abs() < 5e-5);
        }
        assert_eq!(SurfaceSamples::default().thinned().known_count(), 0);
    }

    #[test]
    fn samples_keep_to_one_side_of_a_step_and_to_where_depth_is_known() {
        let map = map(|x, _| match x {
            0..30 => Some(0.5),
            30..50 => Some(0.4),
            _ => None,
        });
        let samples = SurfaceSamples::measure(&map, &SampleOptions::default());
        assert_eq!(samples.near(&Point2::new(58.0, 20.0)), None);
        // Windows across the step have the plane of the larger part, never one between.
        for (x, rho) in [(14.0, 0.5), (28.0, 0.5), (31.0, 0.4), (42.0, 0.4)] {
            assert!((samples.near(&Point2::new(x, 20.0)).unwrap().rho - rho).abs() < 1e-6);
        }
        for outside in [-20.0, 1e9, f64::NAN, f64::INFINITY] {
            assert_eq!(samples.near(&Point2::new(outside, 20.0)), None);
        }
    }
}
