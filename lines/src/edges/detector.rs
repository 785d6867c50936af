//! Detection of edge chains in an image.

use thiserror::Error;

use super::chains::EdgeChains;
use super::route::Router;
use crate::image::{GradientField, GrayImage, SmoothScratch, smooth_gaussian};

/// Options of [`EdgeDetector`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
#[non_exhaustive]
pub struct EdgeOptions {
    /// Least gradient strength |gx| + |gy| of an edge pixel (Sobel response, 0 to 2040). At least 1.
    pub gradient_threshold: u16,
    /// Least margin of the strength of an anchor over both neighbours across the edge (Sobel response).
    pub anchor_threshold: u16,
    /// Least number of pixels of a chain; shorter chains are removed.
    pub minimum_length_px: usize,
}

impl Default for EdgeOptions {
    /// The thresholds of He et al., ICPR 2018 (public code: Sobel, 36 and 8), minimum path length of Topal & Akinlar.
    fn default() -> Self {
        Self {
            gradient_threshold: 36,
            anchor_threshold: 8,
            minimum_length_px: 10,
        }
    }
}

/// An edge option is out of range.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum EdgeOptionsError {
    /// The gradient threshold is 0.
    #[error("edge option gradient_threshold must be at least 1")]
    GradientThreshold,
}

impl EdgeOptions {
    /// Checks the ranges.
    ///
    /// # Errors
    /// When a field is out of range.
    pub fn validate(&self) -> Result<(), EdgeOptionsError> {
        if self.gradient_threshold == 0 {
            return Err(EdgeOptionsError::GradientThreshold);
        }
        Ok(())
    }
}

/// Detects edges by Edge Drawing; reuses its buffers between images.
///
/// # Reference
/// C. Topal, C. Akinlar, Edge Drawing: A combined real-time edge and segment detector, Journal of Visual Communication
/// and Image Representation, 2012: smoothing, gradient and edge areas, anchors, smart routing.
///
/// *Differs from the paper* in anchors and routing; see [`EdgeDetector::detect`].
///
/// ```
/// use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
/// use linecarve_lines::image::GrayImage;
///
/// let step = GrayImage::new(64, 48, (0..64 * 48).map(|i| if i % 64 < 30 { 40 } else { 200 }).collect())?;
/// let mut detector = EdgeDetector::new(EdgeOptions::default())?;
/// let chains = detector.detect(&step);
/// assert_eq!(chains.len(), 1);
/// assert!(chains.chain(0).iter().all(|&[x, _]| x == 29 || x == 30));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct EdgeDetector {
    options: EdgeOptions,
    smoothed: GrayImage,
    field: GradientField,
    chroma: GrayImage,
    chroma_field: GradientField,
    smooth_scratch: SmoothScratch,
    router: Router,
}

impl EdgeDetector {
    /// A detector with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: EdgeOptions) -> Result<Self, EdgeOptionsError> {
        options.validate()?;
        Ok(Self {
            options,
            ..Self::default()
        })
    }

    /// The settings.
    pub fn options(&self) -> &EdgeOptions {
        &self.options
    }

    /// The smoothed image of the last detection.
    pub fn smoothed(&self) -> &GrayImage {
        &self.smoothed
    }

    /// The gradient of the last detection.
    #[cfg(test)]
    pub(super) fn gradient(&self) -> &GradientField {
        &self.field
    }

    /// Detects the edges of an image.
    ///
    /// Anchors are processed by decreasing strength. From each anchor a walk follows the gradient ridge in both directions: at each pixel
    /// it takes the strongest of the three neighbours ahead; edge orientation and the last step define the direction. The walk ends
    /// below the gradient threshold, at a pixel of an existing chain, and where a pixel would complete a 2 x 2 block of edge pixels.
    ///
    /// Deterministic: anchors of equal strength are processed by row, then column.
    ///
    /// *Differs from the paper*: a ridge between two pixels of nearly equal strength also has an anchor (otherwise a perfect step edge has
    /// none). Where the orientation changes, the walk takes the stronger side only, instead of building a tree of paths. Redundant
    /// pixels of a chain are removed during the walk, and the 2 x 2 rule separates chains. The guarantees of [`EdgeChains`] therefore
    /// hold without a second pass.
    ///
    /// # Complexity
    /// Linear in the number of pixels; allocates only the result after the first image of a size.
    pub fn detect(&mut self, image: &GrayImage) -> EdgeChains {
        let mut chains = EdgeChains::default();
        self.detect_into(image, None, &mut chains);
        chains
    }

    /// [`EdgeDetector::detect`] into existing chains, reusing their memory.
    ///
    /// Edges between colours of one brightness count as well where the interleaved 8-bit colours of the image, `rgb`, are given. At each pixel the
    /// gradient is then the stronger one of the grey image and of half of red minus blue.
    ///
    /// # Panics
    /// When `rgb` has not three samples for each pixel.
    pub fn detect_into(&mut self, image: &GrayImage, rgb: Option<&[u8]>, chains: &mut EdgeChains) {
        let has_chroma = rgb.is_some_and(|rgb| self.chroma.set_red_minus_blue(image, rgb));
        if has_chroma {
            smooth_gaussian(&self.chroma, &mut self.smooth_scratch, &mut self.smoothed);
            self.chroma_field.compute(&self.smoothed);
        }
        smooth_gaussian(image, &mut self.smooth_scratch, &mut self.smoothed);
        self.field.compute(&self.smoothed);
        if has_chroma {
            self.field.strengthen(&self.chroma_field);
        }
        self.router.route(&self.field, &self.options, chains);
        chains.refine(&self.field);
    }
}

#[cfg(test)]
mod tests;
