//! ORB features of an image.

use linecarve_lines::image::GrayImage;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::describe::{REACH_PX, describe, direction};
use super::descriptor::Descriptor;
use super::fast::{FastCorner, fast_corners, local_maxima, strongest};
use super::options::MapPointOptions;
use super::pyramid::{resize, smooth};
use super::spread::{Corner, spread};

/// Corners whose patch would leave a level are not described; a level needs room for one inside this border.
const BORDER_PX: usize = REACH_PX + 1;

/// Smallest side of a pyramid level.
const MIN_SIDE_PX: usize = 2 * BORDER_PX + 8;

/// Corners are spread over a level without this border.
const SPREAD_BORDER_PX: u32 = 16;

/// A level with fewer corners than this is searched again with a lower threshold.
const MIN_CORNERS: usize = 10;

/// A weaker corner must be further than this from all others, in rows or in columns.
const WEAK_CORNER_GAP_PX: usize = 3;

/// Samples along a side of a [`Patch`].
pub const PATCH_SIDE: usize = 16;

/// Grey values around a feature in its pyramid level, row by row; the feature is at column and row 8.
pub type Patch = [u8; PATCH_SIDE * PATCH_SIDE];

/// Features of an image, the finest pyramid level first.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub struct Features {
    /// Positions in pixels; the centre of the top-left pixel is (0, 0).
    pub pixels: Vec<[f32; 2]>,
    /// Pyramid level of each.
    pub octaves: Vec<u8>,
    /// Orientation of each, from +x towards +y.
    pub angles_rad: Vec<f32>,
    /// Descriptor of each.
    pub descriptors: Vec<Descriptor>,
    /// Grey value of the image at each.
    pub grey: Vec<u8>,
}

impl Features {
    /// Number of features.
    pub fn len(&self) -> usize {
        self.pixels.len()
    }

    /// Whether there are no features.
    pub fn is_empty(&self) -> bool {
        self.pixels.is_empty()
    }
}

/// Features of a pyramid level.
struct LevelFeatures {
    corners: Vec<Corner>,
    angles_rad: Vec<f32>,
    descriptors: Vec<Descriptor>,
    /// As many, where they are asked for.
    patches: Vec<Patch>,
}

/// Finds ORB features.
///
/// FAST-9 corners of each pyramid level are spread over the level and described by ORB. The same image gives the same features
/// for any number of threads. An image without corners, or with a side below 48 pixels, has no features.
///
/// # Reference
/// Rublee, Rabaud, Konolige, Bradski, "ORB: an efficient alternative to SIFT or SURF", ICCV 2011; spread over the image as
/// in Mur-Artal and Tardos, "ORB-SLAM2", T-RO 2017.
#[derive(Debug, Clone, Copy)]
pub struct FeatureDetector {
    options: MapPointOptions,
    has_only_maxima: bool,
}

impl FeatureDetector {
    /// A detector with these options.
    pub fn new(options: MapPointOptions) -> Self {
        Self {
            options,
            has_only_maxima: false,
        }
    }

    /// Leaves out corners beside a stronger one. There are fewer features where an image has few corners, and no two of one corner,
    /// which could be taken for each other.
    pub fn with_only_maxima(self) -> Self {
        Self {
            has_only_maxima: true,
            ..self
        }
    }

    /// The features of an image.
    pub fn detect(&self, image: &GrayImage) -> Features {
        self.detect_levels(image, false).0
    }

    /// The features of an image, and the patch around each.
    pub fn detect_with_patches(&self, image: &GrayImage) -> (Features, Vec<Patch>) {
        self.detect_levels(image, true)
    }

    fn detect_levels(&self, image: &GrayImage, has_patches: bool) -> (Features, Vec<Patch>) {
        let (width, height) = (image.width(), image.height());
        let levels = self.levels(width, height);
        if levels == 0 {
            return Default::default();
        }
        let pyramid = self.pyramid(image, levels);
        let wanted = self.features_per_level(levels);
        let described: Vec<LevelFeatures> = pyramid
            .par_iter()
            .zip(wanted)
            .map(|(level, wanted)| self.describe_level(level, wanted, has_patches))
            .collect();

        let mut features = Features::default();
        let mut patches = Vec::new();
        for (octave, found) in described.into_iter().enumerate() {
            // Levels are scaled about the corner of the image, at (-0.5, -0.5).
            let in_image = |at: u32, side: usize| {
                let scale = side as f64 / self.level_side(side, octave) as f64;
                ((f64::from(at) + 0.5) * scale - 0.5) as f32
            };
            for corner in &found.corners {
                let pixel = [in_image(corner.column, width), in_image(corner.row, height)];
                let grey = image.get(pixel[0].round() as usize, pixel[1].round() as usize);
                features.pixels.push(pixel);
                features.grey.push(grey.copied().unwrap_or(0));
                features.octaves.push(octave as u8);
            }
            features.angles_rad.extend(found.angles_rad);
            features.descriptors.extend(found.descriptors);
            patches.extend(found.patches);
        }
        (features, patches)
    }

    /// The image and its reductions, each from the level before.
    fn pyramid(&self, image: &GrayImage, levels: usize) -> Vec<GrayImage> {
        let mut pyramid = vec![image.clone()];
        for level in 1..levels {
            let side = |side| self.level_side(side, level);
            let smaller = resize(
                &pyramid[level - 1],
                side(image.width()),
                side(image.height()),
            );
            pyramid.push(smaller);
        }
        pyramid
    }

    /// Features per level, in proportion to the side of the level.
    fn features_per_level(&self, levels: usize) -> Vec<usize> {
        let shrink = 1.0 / self.options.scale_factor as f32;
        let features = self.options.features;
        let first = features as f32 * (1.0 - shrink) / (1.0 - shrink.powi(levels as i32));
        let mut level = first;
        let mut wanted = Vec::with_capacity(levels);
        for _ in 1..levels {
            wanted.push(level.round() as usize);
            level *= shrink;
        }
        wanted.push(features.saturating_sub(wanted.iter().sum()));
        wanted
    }

    /// Finds and describes about `wanted` corners of a level.
    fn describe_level(&self, level: &GrayImage, wanted: usize, has_patches: bool) -> LevelFeatures {
        let (width, height) = (level.width() as u32, level.height() as u32);
        let mut corners = spread(
            &self.corners(level, wanted),
            SPREAD_BORDER_PX..width - SPREAD_BORDER_PX,
            SPREAD_BORDER_PX..height - SPREAD_BORDER_PX,
            wanted,
        );
        let border = BORDER_PX as u32;
        corners.retain(|corner| {
            (border..=width - border).contains(&corner.column)
                && (border..=height - border).contains(&corner.row)
        });
        let stride = level.width();
        let angles_rad: Vec<f32> = corners
            .iter()
            .map(|corner| direction(level.samples(), stride, *corner))
            .collect();
        let descriptors = describe(&smooth(level), stride, &corners, &angles_rad);
        let of_patches = if has_patches { &corners[..] } else { &[] };
        let patches = of_patches
            .iter()
            .map(|corner| patch(level, corner))
            .collect();
        LevelFeatures {
            corners,
            angles_rad,
            descriptors,
            patches,
        }
    }

    /// Corners of a level, the strongest first: at most twenty times as many as wanted.
    fn corners(&self, level: &GrayImage, wanted: usize) -> Vec<Corner> {
        let threshold = self.options.corner_threshold;
        let mut corners = self.fast_corners(level, threshold);
        if corners.len() < MIN_CORNERS {
            for weaker in self.fast_corners(level, lower_threshold(threshold)) {
                let is_near = |other: &FastCorner| {
                    other.row.abs_diff(weaker.row) <= WEAK_CORNER_GAP_PX
                        && other.column.abs_diff(weaker.column) <= WEAK_CORNER_GAP_PX
                };
                if !corners.iter().any(is_near) {
                    corners.push(weaker);
                }
            }
        }
        let most = wanted.saturating_mul(20).max(512);
        strongest(corners, most)
            .into_iter()
            .map(|corner| Corner {
                column: corner.column as u32,
                row: corner.row as u32,
            })
            .collect()
    }

    fn fast_corners(&self, level: &GrayImage, threshold: u8) -> Vec<FastCorner> {
        let corners = fast_corners(level, threshold, REACH_PX);
        match self.has_only_maxima {
            true => local_maxima(corners, level.width()),
            false => corners,
        }
    }

    /// Number of levels with room for a patch.
    fn levels(&self, width: usize, height: usize) -> usize {
        (0..self.options.levels)
            .take_while(|&level| self.level_side(width.min(height), level) >= MIN_SIDE_PX)
            .count()
    }

    /// Length of a side of the image at a pyramid level.
    fn level_side(&self, side: usize, level: usize) -> usize {
        let inverse = f64::from(self.options.scale_factor as f32).powi(-(level as i32));
        (side as f64 * inverse).round_ties_even() as usize
    }
}

/// The samples around a corner, which is no nearer to the border than [`BORDER_PX`].
fn patch(level: &GrayImage, corner: &Corner) -> Patch {
    let [left, top] = [corner.column, corner.row].map(|at| at as usize - PATCH_SIDE / 2);
    std::array::from_fn(|at| level.row(top + at / PATCH_SIDE)[left + at % PATCH_SIDE])
}

/// Two fifths of a threshold, rounded, at least 1.
fn lower_threshold(threshold: u8) -> u8 {
    ((4 * u16::from(threshold) + 5) / 10).max(1) as u8
}

#[cfg(test)]
mod tests {
    use kornia_image::{Image, ImageSize};
    use kornia_imgproc::features::OrbDetector;
    use linecarve_lines::image::Plane;

    use super::*;
    use crate::tests::{room_images, squares};

    fn bits(features: &Features) -> Vec<(u32, u32, u32, Descriptor)> {
        (0..features.len())
            .map(|i| {
                let [x, y] = features.pixels[i];
                let angle = features.angles_rad[i].to_bits();
                (x.to_bits(), y.to_bits(), angle, features.descriptors[i])
            })
            .collect()
    }

    /// The ORB detector of `kornia-imgproc` is an independent implementation of the same features.
    #[test]
    fn features_are_those_of_the_library() {
        let options = MapPointOptions::default();
        let detector = FeatureDetector::new(options);
        let threshold = f32::from(options.corner_threshold) / 255.0;
        let weak = |image: &GrayImage| {
            let samples = image.samples().iter().map(|grey| 100 + grey / 24).collect();
            Plane::new(image.width(), image.height(), samples).unwrap()
        };
        let mut images = room_images();
        images.extend([
            squares(640, 480),
            squares(701, 103),
            squares(90, 400),
            squares(1500, 1100),
            weak(&squares(320, 240)),
        ]);
        for image in images {
            let (width, height) = (image.width(), image.height());
            let library = OrbDetector {
                n_keypoints: options.features,
                n_scales: detector.levels(width, height),
                downscale: options.scale_factor as f32,
                ini_fast_threshold: threshold,
                min_fast_threshold: threshold * 0.4,
                ..OrbDetector::default()
            };
            let size = ImageSize { width, height };
            let input = Image::<u8, 1>::from_size_slice(size, image.samples()).unwrap();
            let expected = library.detect_and_extract_u8(&input).unwrap();
            let found = detector.detect(&image);
            assert!(found.len() > 50, "{}", found.len());
            assert_eq!(found.octaves, expected.octaves);
            assert_eq!(found.angles_rad, expected.orientations);
            let descriptors = expected.descriptors.iter().map(Descriptor::from_bytes);
            assert_eq!(found.descriptors, descriptors.collect::<Vec<_>>());
            for (i, [x, y]) in expected.keypoints_xy.into_iter().enumerate() {
                // The positions of the library are off by up to half a pixel of the level and by its rounded size.
                let near = 1.5 * options.scale(found.octaves[i]) as f32;
                let [column, row] = found.pixels[i];
                assert!((column - x).abs() < near && (row - y).abs() < near);
            }
        }
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
                    .install(|| bits(&detector.detect(&image)))
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
            assert!(detector.detect(&image).is_empty(), "{width}x{height}");
            detector.detect(&squares(width, height));
        }
    }

    /// Features of an image and of its mirror image must agree at every level: levels shift against each other by up to one and a
    /// half pixels when pixel centres are mistaken for pixel corners.
    #[test]
    fn positions_have_no_offset_between_levels() {
        let image = squares(640, 480);
        let mirrored: Vec<u8> = (0..480)
            .flat_map(|y| image.row(y).iter().rev().copied())
            .collect();
        let mirrored = Plane::new(640, 480, mirrored).unwrap();
        let detector = FeatureDetector::new(MapPointOptions::default());
        let (one, other) = (detector.detect(&image), detector.detect(&mirrored));
        for octave in [0, 3, 7] {
            // Each feature of the image against the nearest of its mirror image, turned back.
            let positions = |features: &Features| -> Vec<[f32; 2]> {
                let of_level = features.pixels.iter().zip(&features.octaves);
                of_level
                    .filter(|(_, o)| **o == octave)
                    .map(|(p, _)| *p)
                    .collect()
            };
            let turned: Vec<_> = positions(&other)
                .into_iter()
                .map(|[x, y]| [639.0 - x, y])
                .collect();
            let scale = 1.2_f32.powi(i32::from(octave));
            let mut offsets: Vec<f32> = positions(&one)
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
