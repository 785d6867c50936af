//! Features of an image with their depths.

use std::sync::Arc;

use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::image::GrayImage;
use linecarve_points::{Descriptor, FeatureDetector, FeatureGrid, Features, Patch};
use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};

use crate::camera::Measurement;
use crate::dense::DenseView;
use crate::options::TrackingOptions;
use crate::saving::{patches, shared};
use crate::stereo::{RightView, stereo_depths};

/// Ratio of the sizes of successive pyramid levels, as in the feature detector.
pub(crate) const SCALE_FACTOR: f64 = 1.2;

/// Number of pyramid levels.
pub(crate) const LEVELS: u8 = 8;

/// Depths within this many pixels of a feature are compared: beside a depth edge the depth of a corner is uncertain.
const DEPTH_REACH_PX: usize = 2;

/// Largest relative standard deviation of a depth that is used.
pub(crate) const MAX_RELATIVE_SIGMA: f32 = 0.1;

/// Largest disparity as a share of the width of an image: nearer points have little in common in both images.
const MAX_DISPARITY_SHARE: f32 = 0.4;

/// Size of a pixel of a pyramid level in pixels of the image.
pub(crate) fn level_scale(octave: u8) -> f64 {
    SCALE_FACTOR.powi(i32::from(octave))
}

/// Standard deviation of the place of a point that was aligned, relative to that of a feature.
const ALIGNED_SIGMA_SHARE: f64 = 0.5;

/// Where a feature sees its point.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
pub(crate) enum Alignment {
    /// At the feature; its patch was not aligned yet.
    #[default]
    Pending,
    /// At the feature; its patch cannot be aligned.
    Failed,
    /// At this distance from the feature, in pixels of its level.
    Found([f32; 2]),
}

/// Finds the features of images.
#[derive(Debug, Clone, Copy)]
pub struct FrameDetector {
    detector: FeatureDetector,
    feature_sigma_px: f64,
    is_dense: bool,
    has_patches: bool,
}

impl FrameDetector {
    /// A detector with the options of tracking.
    pub fn new(options: &TrackingOptions) -> Self {
        Self {
            detector: FeatureDetector::new(options.feature_options()).with_only_maxima(),
            feature_sigma_px: options.feature_sigma_px,
            is_dense: options.dense_weight > 0.0,
            has_patches: options.aligns_matches && options.looks_ahead,
        }
    }

    /// The features of a pinhole image and their depths; `depth` has the size of the image, or is absent.
    pub fn detect(&self, image: &GrayImage, depth: Option<&InverseDepthMap>) -> FrameFeatures {
        let (features, patches) = self.features(image);
        let depth_at = |pixel: &[f32; 2]| depth.and_then(|map| depth_near(map, pixel));
        let inverse_depths = features.pixels.iter().map(depth_at).collect();
        let mut features = self.with_depths(features, inverse_depths);
        features.patches = patches;
        if let Some(map) = depth.filter(|_| self.is_dense) {
            features.dense = Some(Arc::new(DenseView::new(map)));
            features.image = Some(Arc::new(image.clone()));
        }
        features
    }

    /// The features of the left image of a rectified pair, and their depths by disparity. `focal_baseline` is the focal length
    /// in pixels times the baseline. Both images have one size; without a right image no depth is known.
    pub fn detect_stereo(
        &self,
        left: &GrayImage,
        right: Option<&GrayImage>,
        focal_baseline: f64,
    ) -> FrameFeatures {
        let (features, patches) = self.features(left);
        let inverse_depths = match right {
            None => vec![None; features.len()],
            Some(image) => {
                let right = RightView {
                    image,
                    features: &self.detector.detect(image),
                };
                let widest = MAX_DISPARITY_SHARE * left.width() as f32;
                stereo_depths(left, &features, &right, focal_baseline, widest)
            }
        };
        let mut features = self.with_depths(features, inverse_depths);
        features.patches = patches;
        features
    }

    fn features(&self, image: &GrayImage) -> (Features, Vec<Option<Arc<Patch>>>) {
        match self.has_patches {
            true => {
                let (features, patches) = self.detector.detect_with_patches(image);
                let patches = patches.into_iter().map(|patch| Some(Arc::new(patch)));
                (features, patches.collect())
            }
            false => (self.detector.detect(image), Vec::new()),
        }
    }

    pub(crate) fn with_depths(
        &self,
        features: Features,
        inverse_depths: Vec<Option<[f32; 2]>>,
    ) -> FrameFeatures {
        FrameFeatures {
            grid: FeatureGrid::new(&features.pixels),
            alignments: Vec::new(),
            features,
            inverse_depths,
            dense: None,
            image: None,
            patches: Vec::new(),
            feature_sigma_px: self.feature_sigma_px,
        }
    }
}

/// Inverse depth and standard deviation at a pixel; the variation around it counts as uncertainty.
fn depth_near(map: &InverseDepthMap, pixel: &[f32; 2]) -> Option<[f32; 2]> {
    let [x, y] = pixel.map(|at| at.round().max(0.0) as usize);
    let at = map.get(x, y)?;
    let (mut count, mut sum) = (0.0_f32, 0.0_f32);
    for row in y.saturating_sub(DEPTH_REACH_PX)..=y + DEPTH_REACH_PX {
        for column in x.saturating_sub(DEPTH_REACH_PX)..=x + DEPTH_REACH_PX {
            if let Some(other) = map.get(column, row) {
                sum += (other.rho - at.rho) * (other.rho - at.rho);
                count += 1.0;
            }
        }
    }
    let sigma = (at.sigma * at.sigma + sum / count).sqrt();
    (sigma <= MAX_RELATIVE_SIGMA * at.rho).then_some([at.rho, sigma])
}

/// Features of an image with their depths.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct FrameFeatures {
    pub(crate) features: Features,
    pub(crate) grid: FeatureGrid,
    /// Inverse depth and standard deviation of each feature.
    pub(crate) inverse_depths: Vec<Option<[f32; 2]>>,
    /// The depth image, reduced, where there is one.
    #[serde(with = "shared")]
    pub(crate) dense: Option<Arc<DenseView>>,
    /// The image, where there is depth, for its lines; old keyframes and frames without a pose lose it.
    #[serde(with = "shared")]
    pub(crate) image: Option<Arc<GrayImage>>,
    /// The image around each feature that can be aligned; empty when matches are not aligned.
    #[serde(with = "patches")]
    pub(crate) patches: Vec<Option<Arc<Patch>>>,
    /// Empty until the first is known.
    alignments: Vec<Alignment>,
    feature_sigma_px: f64,
}

impl FrameFeatures {
    /// Number of features.
    pub fn len(&self) -> usize {
        self.features.len()
    }

    /// Whether there are no features.
    pub fn is_empty(&self) -> bool {
        self.features.is_empty()
    }

    /// Number of features whose depth is known.
    pub fn with_depth(&self) -> usize {
        self.inverse_depths.iter().flatten().count()
    }

    /// Standard deviation of a feature at the finest level.
    pub(crate) fn sigma_px(&self) -> f64 {
        self.feature_sigma_px
    }

    pub(crate) fn set_sigma_px(&mut self, sigma_px: f64) {
        self.feature_sigma_px = sigma_px;
    }

    /// Where a feature sees its point.
    pub(crate) fn pixel(&self, feature: u32) -> Point2<f64> {
        self.pixel_at(feature, self.alignment(feature))
    }

    fn pixel_at(&self, feature: u32, alignment: Alignment) -> Point2<f64> {
        let pixel = Point2::from(self.features.pixels[feature as usize]).cast();
        match alignment {
            Alignment::Found(shift) => {
                pixel + Vector2::from(shift).cast() * level_scale(self.octave(feature))
            }
            _ => pixel,
        }
    }

    pub(crate) fn alignment(&self, feature: u32) -> Alignment {
        self.alignments
            .get(feature as usize)
            .copied()
            .unwrap_or_default()
    }

    pub(crate) fn set_alignment(&mut self, feature: u32, alignment: Alignment) {
        if self.alignment(feature) != alignment {
            self.alignments.resize(self.len(), Alignment::Pending);
            self.alignments[feature as usize] = alignment;
        }
    }

    /// The image around a feature, when it is known.
    pub(crate) fn patch(&self, feature: u32) -> Option<&Patch> {
        self.patches.get(feature as usize)?.as_deref()
    }

    pub(crate) fn octave(&self, feature: u32) -> u8 {
        self.features.octaves[feature as usize]
    }

    pub(crate) fn descriptor(&self, feature: u32) -> &Descriptor {
        &self.features.descriptors[feature as usize]
    }

    pub(crate) fn measurement(&self, feature: u32) -> Measurement {
        self.measurement_at(feature, self.alignment(feature))
    }

    /// The measurement of a feature whose point is where an alignment says.
    pub(crate) fn measurement_at(&self, feature: u32, alignment: Alignment) -> Measurement {
        let share = match alignment {
            Alignment::Found(_) => ALIGNED_SIGMA_SHARE,
            _ => 1.0,
        };
        Measurement {
            pixel: self.pixel_at(feature, alignment),
            sigma_px: share * self.feature_sigma_px * level_scale(self.octave(feature)),
            inverse_depth: self.inverse_depths[feature as usize].map(|pair| pair.map(f64::from)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::depth::InverseDepth;

    #[test]
    fn depths_beside_an_edge_are_uncertain() {
        let mut map = InverseDepthMap::unknown(20, 10).unwrap();
        for y in 0..10 {
            for x in 0..18 {
                let rho = if x < 10 { 1.0 } else { 0.5 };
                map.set(x, y, InverseDepth::new(rho, 0.001));
            }
        }
        assert_eq!(depth_near(&map, &[4.0, 4.0]), Some([1.0, 0.001]));
        assert_eq!(depth_near(&map, &[9.0, 4.0]), None);
        assert_eq!(depth_near(&map, &[19.0, 4.0]), None);
        assert_eq!(depth_near(&map, &[-0.5, 40.0]), None);
    }
}
