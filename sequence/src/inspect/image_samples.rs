//! Samples of the colour images. Each image is decoded only once, since decoding dominates the run time.

use std::collections::{BTreeMap, BTreeSet};

use rayon::prelude::*;

use super::corners::{self, Corners};
use super::{InspectOptions, evenly_spaced, skip_unreadable};
use crate::keyframes::sharpness;
use crate::{FrameError, Sequence};

/// Measurements of one image.
pub(super) struct ImageSample {
    /// Mean grey level.
    pub(super) mean_gray: f64,
    /// See [`sharpness`].
    pub(super) sharpness: f64,
    /// Corners, if the image is to be matched.
    pub(super) corners: Option<Corners>,
}

/// Measurements of a selection of the images.
pub(super) struct ImageSamples {
    /// By frame; `None` for undecodable images.
    of_frame: BTreeMap<usize, Option<ImageSample>>,
    /// Frames sampled for brightness and blur, ascending.
    sampled: Vec<usize>,
    /// Pairs of frames to be matched.
    pairs: Vec<(usize, usize)>,
}

impl ImageSamples {
    /// Decodes and measures the images that the options ask for.
    ///
    /// # Errors
    /// If an image makes the whole sequence unusable.
    pub(super) fn measure(
        sequence: &Sequence,
        options: &InspectOptions,
    ) -> Result<Self, FrameError> {
        let count = sequence.frames().len();
        let sampled = evenly_spaced(count, options.samples);
        let gaps = options.gaps.iter().copied().filter(|gap| *gap > 0);
        let pairs: Vec<(usize, usize)> = gaps
            .flat_map(|gap| {
                let starts = evenly_spaced(count.saturating_sub(gap), options.matched_pairs);
                starts.into_iter().map(move |from| (from, from + gap))
            })
            .collect();
        let mut is_matched: BTreeMap<usize, bool> =
            sampled.iter().map(|&frame| (frame, false)).collect();
        is_matched.extend(pairs.iter().flat_map(|&(a, b)| [(a, true), (b, true)]));
        let of_frame = is_matched
            .into_par_iter()
            .map(|(frame, is_matched)| {
                let image = skip_unreadable(sequence.load_gray(frame))?;
                let sample = image.map(|image| {
                    let sum: u64 = image.samples().iter().map(|&v| u64::from(v)).sum();
                    ImageSample {
                        mean_gray: sum as f64 / image.samples().len().max(1) as f64,
                        sharpness: sharpness(&image),
                        corners: is_matched.then(|| corners::find(&image)),
                    }
                });
                Ok((frame, sample))
            })
            .collect::<Result<_, FrameError>>()?;
        Ok(Self {
            of_frame,
            sampled,
            pairs,
        })
    }

    fn of(&self, frame: usize) -> Option<&ImageSample> {
        self.of_frame.get(&frame)?.as_ref()
    }

    /// The frames sampled for brightness and blur, with their measurements.
    pub(super) fn sampled(&self) -> impl Iterator<Item = (usize, Option<&ImageSample>)> {
        self.sampled.iter().map(|&frame| (frame, self.of(frame)))
    }

    /// The pairs of decoded images to be matched.
    pub(super) fn pairs(&self) -> Vec<CornerPair<'_>> {
        let corners = |frame| self.of(frame)?.corners.as_ref();
        let pairs = self.pairs.iter();
        pairs
            .filter_map(|&(a, b)| {
                Some(CornerPair {
                    frames: [a, b],
                    corners: [corners(a)?, corners(b)?],
                })
            })
            .collect()
    }
}

/// The corners of some images.
pub(super) struct FrameCorners(BTreeMap<usize, Corners>);

impl FrameCorners {
    /// Decodes the images of some pairs; those that cannot be decoded are left out.
    ///
    /// # Errors
    /// If an image makes the whole sequence unusable.
    pub(super) fn find(sequence: &Sequence, pairs: &[[usize; 2]]) -> Result<Self, FrameError> {
        let frames: BTreeSet<usize> = pairs.iter().flatten().copied().collect();
        let found = frames
            .into_par_iter()
            .map(|frame| {
                let image = skip_unreadable(sequence.load_gray(frame))?;
                Ok(image.map(|image| (frame, corners::find(&image))))
            })
            .collect::<Result<Vec<_>, FrameError>>()?;
        Ok(Self(found.into_iter().flatten().collect()))
    }

    /// The pairs whose images are decoded.
    pub(super) fn pairs(&self, pairs: &[[usize; 2]]) -> Vec<CornerPair<'_>> {
        pairs
            .iter()
            .filter_map(|&frames| {
                let [a, b] = frames.map(|frame| self.0.get(&frame));
                Some(CornerPair {
                    frames,
                    corners: [a?, b?],
                })
            })
            .collect()
    }
}

/// Two frames with their corners.
pub(super) struct CornerPair<'a> {
    pub(super) frames: [usize; 2],
    pub(super) corners: [&'a Corners; 2],
}
