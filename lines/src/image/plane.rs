//! A plane of samples.

use thiserror::Error;

/// A rectangular plane of samples, row by row without gaps.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Plane<T> {
    width: usize,
    height: usize,
    samples: Vec<T>,
}

/// An 8-bit grey image.
pub type GrayImage = Plane<u8>;

/// An image or plane has an invalid size.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ImageError {
    /// The number of samples does not match the size.
    #[error(
        "an image of {width} x {height} with {channels} channel(s) needs {expected} samples, got {actual}"
    )]
    SampleCount {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Samples per pixel.
        channels: usize,
        /// Expected number of samples.
        expected: usize,
        /// Actual number of samples.
        actual: usize,
    },
    /// A side exceeds the range of 16-bit pixel coordinates.
    #[error("an image of {width} x {height} is larger than {limit} pixels a side")]
    TooLarge {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Largest side.
        limit: usize,
    },
}

/// Pixel coordinates are stored in 16 bits.
const LARGEST_SIDE: usize = u16::MAX as usize;

impl<T> Plane<T> {
    /// A plane from its samples, row by row.
    ///
    /// # Errors
    /// When the number of samples is not `width * height`, or a side exceeds 65535.
    pub fn new(width: usize, height: usize, samples: Vec<T>) -> Result<Self, ImageError> {
        if width > LARGEST_SIDE || height > LARGEST_SIDE {
            return Err(ImageError::TooLarge {
                width,
                height,
                limit: LARGEST_SIDE,
            });
        }
        if samples.len() != width * height {
            return Err(ImageError::SampleCount {
                width,
                height,
                channels: 1,
                expected: width * height,
                actual: samples.len(),
            });
        }
        Ok(Self {
            width,
            height,
            samples,
        })
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All samples, row by row.
    pub fn samples(&self) -> &[T] {
        &self.samples
    }

    /// All samples, row by row.
    pub fn samples_mut(&mut self) -> &mut [T] {
        &mut self.samples
    }

    /// One row of samples.
    ///
    /// # Panics
    /// When the row does not exist.
    pub fn row(&self, y: usize) -> &[T] {
        &self.samples[y * self.width..(y + 1) * self.width]
    }

    /// The sample at a pixel, `None` outside the image.
    pub fn get(&self, x: usize, y: usize) -> Option<&T> {
        if x < self.width {
            self.samples.get(y * self.width + x)
        } else {
            None
        }
    }
}

impl<T: Clone> Plane<T> {
    /// Resizes the plane and sets all samples to `value`, reusing the memory.
    pub(crate) fn reset(&mut self, width: usize, height: usize, value: T) {
        self.width = width;
        self.height = height;
        self.samples.clear();
        self.samples.resize(width * height, value);
    }
}

impl<T: Clone + Default> Plane<T> {
    /// Resizes the plane, reusing the memory; old samples keep stale values.
    pub(crate) fn resize_stale(&mut self, width: usize, height: usize) {
        self.width = width;
        self.height = height;
        self.samples.resize(width * height, T::default());
    }
}

impl Plane<u8> {
    /// The luma of an interleaved 8-bit RGB image (weights of ITU-R BT.601).
    ///
    /// # Errors
    /// When the number of samples is not `3 * width * height`, or a side exceeds 65535.
    pub fn from_rgb8(width: usize, height: usize, rgb: &[u8]) -> Result<Self, ImageError> {
        if width > LARGEST_SIDE || height > LARGEST_SIDE {
            return Err(ImageError::TooLarge {
                width,
                height,
                limit: LARGEST_SIDE,
            });
        }
        check_rgb8(width, height, rgb)?;
        // Fixed point with 14 bits; the weights sum to 1 << 14.
        let luma = |p: &[u8]| {
            let sum = 4899 * u32::from(p[0]) + 9617 * u32::from(p[1]) + 1868 * u32::from(p[2]);
            ((sum + (1 << 13)) >> 14) as u8
        };
        Self::new(width, height, rgb.chunks_exact(3).map(luma).collect())
    }

    /// Becomes half of red minus blue, from 128 on, of an interleaved 8-bit RGB image of the size of `image`, reusing the memory. Whether it is not
    /// the same everywhere, as that of a grey image is.
    ///
    /// # Panics
    /// When `rgb` has not three samples for each pixel.
    pub(crate) fn set_red_minus_blue(&mut self, image: &Self, rgb: &[u8]) -> bool {
        assert_eq!(rgb.len(), 3 * image.samples.len(), "colours of the image");
        let difference = |p: &[u8]| (128 + (i16::from(p[0]) - i16::from(p[2])) / 2) as u8;
        (self.width, self.height) = (image.width, image.height);
        self.samples.clear();
        self.samples.extend(rgb.chunks_exact(3).map(difference));
        self.samples.iter().any(|sample| *sample != self.samples[0])
    }
}

/// Checks that there are three samples for each pixel.
pub(crate) fn check_rgb8(width: usize, height: usize, rgb: &[u8]) -> Result<(), ImageError> {
    let (expected, actual) = (3 * width * height, rgb.len());
    if expected == actual {
        return Ok(());
    }
    Err(ImageError::SampleCount {
        width,
        height,
        channels: 3,
        expected,
        actual,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_count_is_checked() {
        assert!(GrayImage::new(3, 2, vec![0; 6]).is_ok());
        let error = GrayImage::new(3, 2, vec![0; 5]).unwrap_err();
        assert!(error.to_string().contains("needs 6 samples, got 5"));
        assert!(GrayImage::new(70_000, 0, Vec::new()).is_err());
        assert!(GrayImage::from_rgb8(2, 1, &[0; 5]).is_err());
    }

    #[test]
    fn luma_of_grey_is_itself() {
        for value in 0..=255 {
            assert_eq!(
                GrayImage::from_rgb8(1, 1, &[value; 3]).unwrap().samples(),
                &[value]
            );
        }
    }

    #[test]
    fn get_is_bounded() {
        let plane = Plane::new(2, 2, vec![1, 2, 3, 4]).unwrap();
        assert_eq!(plane.get(1, 1), Some(&4));
        assert_eq!(plane.get(2, 0), None);
        assert_eq!(plane.get(0, 2), None);
    }
}
