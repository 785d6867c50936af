//! The depth of a keyframe from its neighbours.

use nalgebra::UnitQuaternion;

use super::along_chain::check_along_chains;
use super::bootstrap::bootstrap;
use super::candidate::Candidate;
use super::matching::{Matched, match_all};
use super::options::{InverseDepthRange, SemiDenseOptions, SemiDenseOptionsError};
use super::search::Pixel;
use super::view::{MatchView, gradient};
use crate::depth::map::{InverseDepth, InverseDepthMap};
use crate::image::ImageError;

/// Estimates the inverse depth of the edge pixels of a keyframe from posed neighbours.
///
/// Every edge pixel is searched along its epipolar line in each neighbour: a patch of five samples along the line is
/// compared with the neighbour's, up to three best places whose gradient fits are refined to a fraction of a pixel, each
/// with a standard deviation from the slope of the grey levels, the residual measured for the pair, and the error of the epipolar line.
/// The depth on which most neighbours agree is the pixel's, unless another has nearly as much support; it must be confirmed along the
/// edge.
///
/// The range of depths, the exposure of each neighbour and the error of its pose are measured on a few hundred pixels first.
///
/// *Differs from Mur-Artal & Tardos*: a patch along the line in place of one grey level and gradient magnitude; several matches a
/// neighbour, so that repeated edges are told apart by agreement instead of by luck; any direction of epipolar lines; matches
/// support a depth by their residual; ambiguity is rejected; residual and epipolar error are measured for each pair, not assumed;
/// each neighbour is turned by the small rotation that its matches ask for.
#[derive(Debug, Clone)]
pub struct SemiDense {
    options: SemiDenseOptions,
}

/// What was found about one neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairReport {
    /// Its position among the neighbours that were given.
    pub neighbour: usize,
    /// Distance of the two camera centres.
    pub baseline: f64,
    /// Grey levels of the reference times this ...
    pub gain: f64,
    /// ... plus this are those of the neighbour; `None` when too few patches matched to tell.
    pub offset: Option<f64>,
    /// Standard deviation of the difference of matching samples, in grey levels.
    pub residual_sigma: f64,
    /// Angle by which the neighbour was turned, in radians.
    pub correction_rad: f64,
    /// Standard deviation of where its epipolar lines run, in pixels.
    pub epipolar_sigma_px: f64,
}

/// The depth of a keyframe and what it rests on.
#[derive(Debug, Clone)]
pub struct SemiDenseDepth {
    /// Inverse depth at edge pixels: that of the crest of the edge inside the pixel.
    pub map: InverseDepthMap,
    /// The inverse depths that were searched; `None` without any usable neighbour.
    pub range: Option<InverseDepthRange>,
    /// The neighbours that were used.
    pub pairs: Vec<PairReport>,
    /// Rotation of each of those neighbours, about its centre, that its matches ask for.
    pub corrections: Vec<UnitQuaternion<f64>>,
    /// Edge pixels on which enough neighbours agreed, before the check along the edges.
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

    /// The inverse depth of the edge pixels of `reference`, as far as the neighbours tell.
    ///
    /// `prior` bounds the inverse depths searched; without it they are bounded by what the baselines can measure. Neighbours
    /// without baseline, or that see nothing in common, contribute nothing; without three useful ones no pixel is known.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// When the image is too large for a map.
    ///
    /// # Complexity
    /// Edge pixels x neighbours x length of the searched epipolar lines in pixels.
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
        let (used, mut candidates) = self.candidates(reference, neighbours);
        let widest = self.widest_range(&candidates);
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
        let matchable: Vec<Pixel> = pixels.iter().flatten().copied().collect();
        let range = bootstrap(reference, &matchable, &mut candidates, range, options).range;
        let Matched {
            mut samples,
            mut shared,
        } = match_all(reference, &pixels, &candidates, &range, options);
        let fused = samples.iter().filter(|sample| sample.rho > 0.0).count();
        check_along_chains(reference.chains(), &mut samples, &mut shared, options);
        let largest = options.largest_relative_sigma as f32;
        let hidden = options.hidden_pose_error as f32;
        for ((&[x, y], sample), shared) in reference
            .chains()
            .pixels()
            .iter()
            .zip(&samples)
            .zip(&shared)
        {
            // Pixels next to each other share the error of the poses: it was left out of the check between them.
            if sample.sigma.hypot(*shared) <= largest * sample.rho {
                let sigma = sample.sigma.hypot(hidden * shared);
                let measured = InverseDepth::new(sample.rho, sigma);
                map.set(usize::from(x), usize::from(y), measured);
            }
        }
        let pairs = used
            .iter()
            .zip(&candidates)
            .map(|(&neighbour, candidate)| {
                let matched = &candidate.matched;
                PairReport {
                    neighbour,
                    baseline: matched.pair.baseline,
                    gain: f64::from(matched.photometry.gain),
                    offset: matched.photometry.offset.map(f64::from),
                    residual_sigma: f64::from(matched.photometry.sigma),
                    correction_rad: candidate.correction.angle(),
                    epipolar_sigma_px: f64::from(matched.epipolar_sigma),
                }
            })
            .collect();
        Ok(SemiDenseDepth {
            map,
            range: Some(range),
            pairs,
            corrections: candidates.iter().map(|c| c.correction).collect(),
            fused,
        })
    }

    /// The median depth of a few hundred edge pixels of `reference` in units of the poses, from neighbours of whatever baselines;
    /// `None` when too few of them can be measured.
    pub fn median_depth(&self, reference: &MatchView, neighbours: &[&MatchView]) -> Option<f64> {
        let (_, mut candidates) = self.candidates(reference, neighbours);
        let range = self.widest_range(&candidates)?;
        let pixels: Vec<Pixel> = edge_pixels(reference, self.options.least_gradient as f32)
            .into_iter()
            .flatten()
            .collect();
        let survey = bootstrap(reference, &pixels, &mut candidates, range, &self.options);
        survey.median_rho.map(f64::recip)
    }

    /// The neighbours with a baseline, after their positions.
    fn candidates<'a>(
        &self,
        reference: &MatchView,
        neighbours: &[&'a MatchView],
    ) -> (Vec<usize>, Vec<Candidate<'a>>) {
        neighbours
            .iter()
            .enumerate()
            .filter_map(|(index, view)| {
                Some((index, Candidate::new(reference, view, &self.options)?))
            })
            .unzip()
    }

    /// From infinity to the nearest place that as many neighbours as must agree can compare.
    fn widest_range(&self, candidates: &[Candidate<'_>]) -> Option<InverseDepthRange> {
        let mut baselines: Vec<f64> = candidates.iter().map(|c| c.matched.pair.baseline).collect();
        baselines.sort_by(f64::total_cmp);
        let baseline = baselines.get(self.options.least_agreeing.max(1) - 1)?;
        InverseDepthRange::new(0.0, self.options.largest_parallax / baseline)
    }
}

/// The chain pixels with their gradients, `None` where it is too weak or touches the border.
fn edge_pixels(view: &MatchView, least_gradient: f32) -> Vec<Option<Pixel>> {
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
                .then_some(Pixel { position, gradient })
        })
        .collect()
}
