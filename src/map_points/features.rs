//! ORB features of an image. The one module that speaks the types of `kornia-imgproc`.

use kornia_image::{Image, ImageSize};
use kornia_imgproc::features::OrbDetector;
use linecarve_lines::image::GrayImage;
use serde::{Deserialize, Serialize};

use super::descriptor::Descriptor;
use super::options::MapPointOptions;

/// Corners whose patch would leave a level are not described; a level needs room for one inside this border.
const BORDER_PX: usize = 20;

/// Smallest side of a pyramid level.
const MIN_SIDE_PX: usize = 2 * BORDER_PX + 8;

/// Features of an image, the finest pyramid level first.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Features {
    /// Places in the image, in pixels; the centre of the top-left pixel is (0, 0).
    pub pixels: Vec<[f32; 2]>,
    /// Pyramid level of each.
    pub octaves: Vec<u8>,
    /// Direction of each, from +x towards +y.
    pub angles_rad: Vec<f32>,
    /// What each looks like.
    pub descriptors: Vec<Descriptor>,
    /// Grey value at each.
    pub grey: Vec<u8>,
}

impl Features {
    /// Number of features.
    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }
}

/// Why an image has no features.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("features cannot be found in an image of {width}x{height} pixels: {reason}")]
pub struct FeatureError {
    /// Width of the image.
    pub width: usize,
    /// Height of the image.
    pub height: usize,
    /// What the detector says.
    pub reason: String,
}

/// Finds ORB features.
///
/// The same image gives the same features, for any number of threads. An image without corners, or one too small for a
/// corner with its patch (below 48 pixels), has none.
///
/// # Reference
/// Rublee, Rabaud, Konolige, Bradski, "ORB: an efficient alternative to SIFT or SURF", ICCV 2011; spread over the image as
/// in Mur-Artal and Tardos, "ORB-SLAM2", T-RO 2017.
#[derive(Debug, Clone, Copy)]
pub struct FeatureDetector {
    options: MapPointOptions,
}

impl FeatureDetector {
    /// A detector with these options.
    pub fn new(options: MapPointOptions) -> Self {
        Self { options }
    }

    /// The features of an image.
    ///
    /// # Errors
    /// When the detector refuses the image, which no size or content is known to bring about.
    pub fn detect(&self, image: &GrayImage) -> Result<Features, FeatureError> {
        let (width, height) = (image.width(), image.height());
        let refused = |reason: String| FeatureError {
            width,
            height,
            reason,
        };
        let levels = (0..self.options.levels)
            .take_while(|&level| self.level_side(width.min(height), level) >= MIN_SIDE_PX)
            .count();
        if levels == 0 {
            return Ok(Features::default());
        }
        let threshold = f32::from(self.options.corner_threshold) / 255.0;
        let detector = OrbDetector {
            n_keypoints: self.options.features,
            n_scales: levels,
            downscale: self.options.scale_factor as f32,
            ini_fast_threshold: threshold,
            // Only for levels with hardly any corner.
            min_fast_threshold: threshold * 0.4,
            ..OrbDetector::default()
        };
        let input = Image::<u8, 1>::from_size_slice(ImageSize { width, height }, image.samples())
            .map_err(|error| refused(error.to_string()))?;
        let found = detector
            .detect_and_extract_u8(&input)
            .map_err(|error| refused(error.to_string()))?;

        let mut features = Features {
            angles_rad: found.orientations,
            descriptors: found
                .descriptors
                .iter()
                .map(Descriptor::from_bytes)
                .collect(),
            octaves: found.octaves,
            ..Features::default()
        };
        features.pixels.reserve(found.keypoints_xy.len());
        features.grey.reserve(found.keypoints_xy.len());
        for (pixel, octave) in found.keypoints_xy.iter().zip(&features.octaves) {
            let level = usize::from(*octave);
            let scale = self.options.scale(*octave) as f32;
            // The detector multiplies a level's pixel by the scale; levels are resampled about the image's corner, which
            // lies at (-0.5, -0.5).
            let place = |at: f32, side: usize| {
                let exact = side as f64 / self.level_side(side, level) as f64;
                ((f64::from((at / scale).round()) + 0.5) * exact - 0.5) as f32
            };
            let pixel = [place(pixel[0], width), place(pixel[1], height)];
            let grey = image.get(pixel[0].round() as usize, pixel[1].round() as usize);
            features.pixels.push(pixel);
            features.grey.push(grey.copied().unwrap_or(0));
        }
        Ok(features)
    }

    /// Length of a side at a pyramid level, as the detector rounds it.
    fn level_side(&self, side: usize, level: usize) -> usize {
        let inverse = f64::from(self.options.scale_factor as f32).powi(-(level as i32));
        (side as f64 * inverse).round_ties_even() as usize
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::image::Plane;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Bright and dark squares at random places.
    fn squares(width: usize, height: usize) -> GrayImage {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut image = Plane::new(width, height, vec![90_u8; width * height]).unwrap();
        for _ in 0..width * height / 300 {
            let (x, y) = (
                random.random_range(0..width),
                random.random_range(0..height),
            );
            let (side, value) = (random.random_range(4..20), random.random_range(0..=255));
            for row in y..(y + side).min(height) {
                for column in x..(x + side).min(width) {
                    image.samples_mut()[row * width + column] = value;
                }
            }
        }
        image
    }

    fn bits(features: &Features) -> Vec<(u32, u32, u32, Descriptor)> {
        (0..features.len())
            .map(|i| {
                let [x, y] = features.pixels[i];
                let angle = features.angles_rad[i].to_bits();
                (x.to_bits(), y.to_bits(), angle, features.descriptors[i])
            })
            .collect()
    }

    #[test]
    fn any_number_of_threads_finds_the_same() {
        let image = squares(640, 480);
        let detector = FeatureDetector::new(MapPointOptions::default());
        let found: Vec<_> = [1, 2, 5]
            .into_iter()
            .map(|threads| {
                rayon::ThreadPoolBuilder::new()
                    .num_threads(threads)
                    .build()
                    .unwrap()
                    .install(|| bits(&detector.detect(&image).unwrap()))
            })
            .collect();
        assert!(found[0].len() > 1000, "{}", found[0].len());
        assert!(found.iter().all(|other| *other == found[0]));
    }

    #[test]
    fn images_without_corners_have_no_features() {
        let detector = FeatureDetector::new(MapPointOptions::default());
        for (width, height) in [(1, 1), (40, 300), (47, 47), (48, 48), (49, 3), (64, 200)] {
            let image = Plane::new(width, height, vec![128; width * height]).unwrap();
            assert!(
                detector.detect(&image).unwrap().is_empty(),
                "{width}x{height}"
            );
            detector.detect(&squares(width, height)).unwrap();
        }
    }

    /// A blob whose centre is known must be found at its place from every level: levels are shifted against each other
    /// by up to one and a half pixels when pixel centres are mistaken for corners.
    #[test]
    fn places_have_no_offset_between_levels() {
        let image = squares(640, 480);
        let mirrored: Vec<u8> = (0..480)
            .flat_map(|y| image.row(y).iter().rev().copied())
            .collect();
        let mirrored = Plane::new(640, 480, mirrored).unwrap();
        let detector = FeatureDetector::new(MapPointOptions::default());
        let (one, other) = (
            detector.detect(&image).unwrap(),
            detector.detect(&mirrored).unwrap(),
        );
        for octave in [0, 3, 7] {
            // Each feature of the image against the nearest of its mirror image, turned back.
            let places = |features: &Features| -> Vec<[f32; 2]> {
                let of_level = features.pixels.iter().zip(&features.octaves);
                of_level
                    .filter(|(_, o)| **o == octave)
                    .map(|(p, _)| *p)
                    .collect()
            };
            let turned: Vec<_> = places(&other)
                .into_iter()
                .map(|[x, y]| [639.0 - x, y])
                .collect();
            let scale = 1.2_f32.powi(i32::from(octave));
            let mut offsets: Vec<f32> = places(&one)
                .into_iter()
                .filter_map(|[x, y]| {
                    turned
                        .iter()
                        .map(|q| [x - q[0], y - q[1]])
                        .find(|d| d[0].abs() < 1.6 * scale && d[1].abs() < 0.1 * scale)
                        .map(|d| d[0])
                })
                .collect();
            assert!(offsets.len() > 20, "level {octave}: {}", offsets.len());
            offsets.sort_by(f32::total_cmp);
            let mean = offsets.iter().sum::<f32>() / offsets.len() as f32;
            assert!(
                mean.abs() < 0.25 * scale,
                "level {octave}: {mean} of {}",
                offsets.len()
            );
        }
    }
}
