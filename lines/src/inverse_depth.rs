//! Inverse depth and standard deviation per pixel.

use crate::image::{ImageError, Plane};
use crate::median::upper_median;

/// The inverse depth 1/z of a surface at a pixel and its standard deviation, in 1 / unit of the poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InverseDepth {
    /// Inverse depth, positive and finite.
    pub rho: f32,
    /// Its standard deviation, positive and finite.
    pub sigma: f32,
}

impl InverseDepth {
    /// A measurement; `None` unless both values are positive and finite.
    pub fn new(rho: f32, sigma: f32) -> Option<Self> {
        // Without branches, for loops over pixels.
        let is_valid =
            (rho > 0.0) & (rho < f32::INFINITY) & (sigma > 0.0) & (sigma < f32::INFINITY);
        is_valid.then_some(Self { rho, sigma })
    }

    /// The depth z in units of the poses.
    pub fn depth(&self) -> f64 {
        1.0 / f64::from(self.rho)
    }
}

/// Inverse depth per pixel of a pinhole image; pixels may be unknown.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct InverseDepthMap {
    /// Unknown pixels hold [`UNKNOWN`].
    samples: Plane<InverseDepth>,
}

/// Marks an unknown pixel inside the map.
pub(crate) const UNKNOWN: InverseDepth = InverseDepth {
    rho: 0.0,
    sigma: 0.0,
};

impl Default for InverseDepth {
    fn default() -> Self {
        UNKNOWN
    }
}

impl InverseDepthMap {
    /// A map of unknown pixels.
    ///
    /// # Errors
    /// When a side exceeds 65535 pixels.
    pub fn unknown(width: usize, height: usize) -> Result<Self, ImageError> {
        Self::new(width, height, vec![UNKNOWN; width * height])
    }

    /// A map of samples, row by row: measurements or [`UNKNOWN`].
    pub(crate) fn new(
        width: usize,
        height: usize,
        samples: Vec<InverseDepth>,
    ) -> Result<Self, ImageError> {
        Ok(Self {
            samples: Plane::new(width, height, samples)?,
        })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.samples.width()
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.samples.height()
    }

    /// The measurement at a pixel; `None` where it is unknown or outside the image.
    pub fn get(&self, x: usize, y: usize) -> Option<InverseDepth> {
        self.samples
            .get(x, y)
            .copied()
            .filter(|sample| sample.rho > 0.0)
    }

    /// Replaces the measurement at a pixel.
    ///
    /// # Panics
    /// When the pixel lies outside the image.
    pub fn set(&mut self, x: usize, y: usize, measurement: Option<InverseDepth>) {
        assert!(x < self.width(), "pixel x {x} lies outside the map");
        let index = y * self.width() + x;
        self.samples.samples_mut()[index] = measurement.unwrap_or(UNKNOWN);
    }

    /// The known pixels, row by row, as (x, y, measurement).
    pub fn known(&self) -> impl Iterator<Item = (usize, usize, InverseDepth)> {
        let width = self.width().max(1);
        self.samples
            .samples()
            .iter()
            .enumerate()
            .filter(|(_, sample)| sample.rho > 0.0)
            .map(move |(index, &sample)| (index % width, index / width, sample))
    }

    /// Number of known pixels.
    pub fn known_count(&self) -> usize {
        self.known().count()
    }

    /// The median depth z of the known pixels (the smaller one of an even number); `None` when no pixel is known.
    pub fn median_depth(&self) -> Option<f64> {
        let mut all: Vec<f32> = self.known().map(|(_, _, sample)| sample.rho).collect();
        upper_median(&mut all, f32::total_cmp).map(|rho| 1.0 / f64::from(rho))
    }

    /// The samples of a row; unknown pixels have an inverse depth of 0.
    pub(crate) fn row(&self, y: usize) -> &[InverseDepth] {
        self.samples.row(y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_positive_finite_measurements_exist() {
        assert!(InverseDepth::new(0.5, 0.01).is_some());
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert!(InverseDepth::new(bad, 0.1).is_none());
            assert!(InverseDepth::new(0.1, bad).is_none());
        }
    }

    #[test]
    fn unknown_is_none() {
        let mut map = InverseDepthMap::unknown(4, 3).unwrap();
        assert_eq!(
            (map.get(1, 1), map.get(4, 0), map.median_depth()),
            (None, None, None)
        );
        map.set(1, 2, InverseDepth::new(0.5, 0.01));
        map.set(3, 0, InverseDepth::new(0.25, 0.01));
        map.set(0, 0, InverseDepth::new(0.2, 0.01));
        assert_eq!(map.known_count(), 3);
        assert_eq!(
            map.known().last().map(|(x, y, s)| (x, y, s.rho)),
            Some((1, 2, 0.5))
        );
        assert_eq!(map.median_depth(), Some(4.0));
        map.set(1, 2, None);
        assert_eq!(map.get(1, 2), None);
    }
}
