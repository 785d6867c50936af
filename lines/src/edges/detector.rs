//! From an image to its edge chains.

use thiserror::Error;

use super::chains::EdgeChains;
use super::route::Router;
use crate::image::{GradientField, GrayImage, SmoothScratch, smooth_gaussian};

/// Settings of [`EdgeDetector`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(default, deny_unknown_fields))]
pub struct EdgeOptions {
    /// Least gradient strength |gx| + |gy| (Sobel, 0 to 2040) of an edge pixel. At least 1.
    pub gradient_threshold: u16,
    /// By how much an anchor's strength exceeds that of both neighbours across the edge.
    pub anchor_threshold: u16,
    /// Chains with fewer pixels are dropped.
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

/// Why edge options are refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum EdgeOptionsError {
    /// Every pixel would be an edge pixel, the image border included.
    #[error("the gradient threshold of edges must be at least 1")]
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

/// Detects edges by Edge Drawing and owns the memory that is reused from image to image.
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
    pub fn gradient(&self) -> &GradientField {
        &self.field
    }

    /// The edges of an image.
    ///
    /// Anchors are taken by falling strength. From each a walk follows the ridge of the gradient in both directions;
    /// at each pixel it takes the strongest of the three neighbours ahead, where the edge orientation of the pixel and
    /// the last step say what is ahead. It ends below the gradient threshold, at a pixel that is on a chain already, and
    /// where a pixel would fill a 2 x 2 block of edge pixels.
    ///
    /// Deterministic: equal strengths are taken in the order of rows, then columns.
    ///
    /// *Differs from the paper*: a crest half-way between two pixels of nearly equal strength has an anchor too (a perfect
    /// step between two columns has two equal columns and would have none); where the orientation changes, the walk turns to the stronger side and leaves the other
    /// to an anchor of its own, instead of following both and sorting out a tree of paths afterwards; pixels that only
    /// thicken a chain are taken out while walking, and the 2 x 2 rule keeps different chains apart. This is what
    /// makes the guarantees of [`EdgeChains`] hold without a second pass.
    ///
    /// # Complexity
    /// Linear in the number of pixels; no allocation beyond the result once the detector has seen an image of the size.
    pub fn detect(&mut self, image: &GrayImage) -> EdgeChains {
        let mut chains = EdgeChains::default();
        self.detect_into(image, &mut chains);
        chains
    }

    /// As [`EdgeDetector::detect`], into chains whose memory is reused.
    pub fn detect_into(&mut self, image: &GrayImage, chains: &mut EdgeChains) {
        smooth_gaussian(image, &mut self.smooth_scratch, &mut self.smoothed);
        self.field.compute(&self.smoothed);
        self.router.route(&self.field, &self.options, chains);
        chains.refine(&self.field);
    }
}

#[cfg(test)]
mod tests;
