//! Semi-dense depth of a keyframe from its neighbours.

use nalgebra::UnitQuaternion;

use super::chain_consistency::check_chains;
use super::chain_matching::{ChainDepths, match_chains};
use super::epipolar_search::EdgePixel;
use super::neighbour_pair::NeighbourPair;
use super::options::{InverseDepthRange, SemiDenseOptions, SemiDenseOptionsError};
use super::pair_calibration::calibrate_pairs;
use super::view::{MatchView, gradient};
use crate::image::ImageError;
use crate::inverse_depth::{InverseDepth, InverseDepthMap};

/// Estimates the inverse depth of the edge pixels of a keyframe from posed neighbours.
///
/// 1. Calibration: depth range, photometric model, rotation correction and epipolar error of each pair, from a few hundred edge pixels.
/// 2. Search: each edge pixel is searched along its epipolar line in each neighbour with a patch of five samples. Up to three minima
///    with a fitting gradient are refined to sub-pixel positions. The standard deviation of a match combines the intensity slope, the
///    residual sigma of the pair and the epipolar error.
/// 3. Fusion: the best supported depth is taken; ambiguous pixels are rejected.
/// 4. Consistency: depths must agree with their neighbours along the edge chain; short gaps are filled.
///
/// *Differs from Mur-Artal & Tardos*: a patch along the line instead of one grey level and gradient magnitude; several matches per
/// neighbour, so that agreement resolves repeated edges; epipolar lines of any direction; support weighted by residual; rejection of
/// ambiguous depths; residual and epipolar error measured per pair; a small rotation correction per neighbour.
#[derive(Debug, Clone)]
pub struct SemiDense {
    options: SemiDenseOptions,
}

/// Calibration of the pair of the reference and one neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairReport {
    /// Index of the neighbour in the given slice.
    pub neighbour: usize,
    /// Distance of the two camera centres, in units of the poses.
    pub baseline: f64,
    /// Photometric gain: neighbour level = `gain` * reference level + `offset`.
    pub gain: f64,
    /// Photometric offset in grey levels; `None` when too few patches matched for a calibration.
    pub offset: Option<f64>,
    /// Standard deviation of the residual of a sample, in grey levels.
    pub residual_sigma: f64,
    /// Angle of the rotation correction in radians.
    pub correction_rad: f64,
    /// Standard deviation of the position of an epipolar line, in pixels.
    pub epipolar_sigma_px: f64,
}

/// The semi-dense depth of a keyframe with the calibration of its pairs.
#[derive(Debug, Clone)]
pub struct SemiDenseDepth {
    /// Inverse depth at edge pixels, valid at the sub-pixel position of the edge.
    pub map: InverseDepthMap,
    /// The searched range of inverse depths; `None` without a usable neighbour.
    pub range: Option<InverseDepthRange>,
    /// Calibration of each usable neighbour.
    pub pairs: Vec<PairReport>,
    /// Rotation correction of each usable neighbour about its centre, parallel to `pairs`.
    pub corrections: Vec<UnitQuaternion<f64>>,
    /// Number of edge pixels with a fused depth, before the check along the chains.
    pub fused: usize,
}

impl SemiDense {
    /// An estimator with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: SemiDenseOptions) -> Result<Self, SemiDenseOptionsError> {
        options.validate()?;
        Ok(Self { options })
    }

    /// The settings.
    pub fn options(&self) -> &SemiDenseOptions {
        &self.options
    }

    /// Estimates the inverse depth of the edge pixels of `reference`.
    ///
    /// `prior` bounds the searched inverse depths; without it the largest parallax bounds them. Neighbours without a baseline or overlap
    /// contribute nothing. Without [`least_agreeing`](SemiDenseOptions::least_agreeing) useful neighbours no pixel gets a depth.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// [`ImageError`] when the image is too large for a depth map.
    ///
    /// # Complexity
    /// O(edge pixels x neighbours x length of the searched epipolar lines in pixels).
    pub fn estimate(
        &self,
        reference: &MatchView,
        neighbours: &[&MatchView],
        prior: Option<InverseDepthRange>,
    ) -> Result<SemiDenseDepth, ImageError> {
        let options = &self.options;
        let image = reference.smoothed();
        let (width, height) = (image.width(), image.height());
        let mut map = InverseDepthMap::unknown(width, height)?;
        let (used, mut pairs) = self.neighbour_pairs(reference, neighbours);
        let widest = self.widest_range(&pairs);
        let Some(range) = prior.or(widest) else {
            return Ok(SemiDenseDepth {
                map,
                range: None,
                pairs: Vec::new(),
                corrections: Vec::new(),
                fused: 0,
            });
        };
        let pixels = edge_pixels(reference, options.least_gradient as f32);
        let matchable: Vec<EdgePixel> = pixels.iter().flatten().copied().collect();
        let range = calibrate_pairs(reference, &matchable, &mut pairs, range, options).range;
        let ChainDepths {
            mut samples,
            mut pose_sigmas,
        } = match_chains(reference, &pixels, &pairs, &range, options);
        let fused = samples.iter().filter(|sample| sample.rho > 0.0).count();
        check_chains(reference.chains(), &mut samples, &mut pose_sigmas, options);
        let largest = options.largest_relative_sigma as f32;
        let hidden = options.hidden_pose_error as f32;
        for ((&[x, y], sample), pose_sigma) in reference
            .chains()
            .pixels()
            .iter()
            .zip(&samples)
            .zip(&pose_sigmas)
        {
            // Adjacent pixels share the pose error, so that the check along the chains excludes it.
            if sample.sigma.hypot(*pose_sigma) <= largest * sample.rho {
                let sigma = sample.sigma.hypot(hidden * pose_sigma);
                let measured = InverseDepth::new(sample.rho, sigma);
                map.set(usize::from(x), usize::from(y), measured);
            }
        }
        let reports = used
            .iter()
            .zip(&pairs)
            .map(|(&neighbour, pair)| {
                let target = &pair.target;
                PairReport {
                    neighbour,
                    baseline: target.geometry.baseline,
                    gain: f64::from(target.photometry.gain),
                    offset: target.photometry.offset.map(f64::from),
                    residual_sigma: f64::from(target.photometry.sigma),
                    correction_rad: pair.correction.angle(),
                    epipolar_sigma_px: f64::from(target.epipolar_sigma),
                }
            })
            .collect();
        Ok(SemiDenseDepth {
            map,
            range: Some(range),
            pairs: reports,
            corrections: pairs.iter().map(|c| c.correction).collect(),
            fused,
        })
    }

    /// Median depth of a few hundred edge pixels of `reference`, in units of the poses; `None` when too few can be measured. The baselines
    /// need no particular length.
    pub fn median_depth(&self, reference: &MatchView, neighbours: &[&MatchView]) -> Option<f64> {
        let (_, mut pairs) = self.neighbour_pairs(reference, neighbours);
        let range = self.widest_range(&pairs)?;
        let pixels: Vec<EdgePixel> = edge_pixels(reference, self.options.least_gradient as f32)
            .into_iter()
            .flatten()
            .collect();
        let calibration = calibrate_pairs(reference, &pixels, &mut pairs, range, &self.options);
        calibration.median_rho.map(f64::recip)
    }

    /// Indices and uncalibrated pairs of the neighbours with a baseline.
    fn neighbour_pairs<'a>(
        &self,
        reference: &MatchView,
        neighbours: &[&'a MatchView],
    ) -> (Vec<usize>, Vec<NeighbourPair<'a>>) {
        neighbours
            .iter()
            .enumerate()
            .filter_map(|(index, view)| {
                Some((index, NeighbourPair::new(reference, view, &self.options)?))
            })
            .unzip()
    }

    /// Range from infinity to the nearest depth at which `least_agreeing` neighbours keep within the largest parallax.
    fn widest_range(&self, pairs: &[NeighbourPair<'_>]) -> Option<InverseDepthRange> {
        let mut baselines: Vec<f64> = pairs.iter().map(|c| c.target.geometry.baseline).collect();
        baselines.sort_by(f64::total_cmp);
        let baseline = baselines.get(self.options.least_agreeing.max(1) - 1)?;
        InverseDepthRange::new(0.0, self.options.largest_parallax / baseline)
    }
}

/// The chain pixels with their gradients; `None` where the gradient is too weak or the pixel lies on the image border.
fn edge_pixels(view: &MatchView, least_gradient: f32) -> Vec<Option<EdgePixel>> {
    let image = view.smoothed();
    let (width, height) = (image.width(), image.height());
    let chains = view.chains();
    chains
        .pixels()
        .iter()
        .zip(chains.positions())
        .map(|(&[x, y], &position)| {
            let (x, y) = (usize::from(x), usize::from(y));
            if x < 1 || y < 1 || x + 1 >= width || y + 1 >= height {
                return None;
            }
            let gradient = gradient(image.samples(), width, x, y);
            (gradient[0].hypot(gradient[1]) >= least_gradient)
                .then_some(EdgePixel { position, gradient })
        })
        .collect()
}
