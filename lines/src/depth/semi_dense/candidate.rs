//! A neighbour and what has been learnt about it.

use nalgebra::UnitQuaternion;

use super::options::SemiDenseOptions;
use super::pair::Pair;
use super::search::{Neighbour, Photometry};
use super::view::MatchView;

/// A neighbour and its view.
pub(super) struct Candidate<'a> {
    pub(super) view: &'a MatchView,
    pub(super) correction: UnitQuaternion<f64>,
    pub(super) matched: Neighbour<'a>,
}

impl<'a> Candidate<'a> {
    /// A neighbour of which nothing is known but its pose; `None` when it has no baseline.
    pub(super) fn new(
        reference: &MatchView,
        view: &'a MatchView,
        options: &SemiDenseOptions,
    ) -> Option<Self> {
        let correction = UnitQuaternion::identity();
        let pair = Pair::new(reference, view, &correction, options.largest_parallax)?;
        Some(Self {
            view,
            correction,
            matched: Neighbour {
                pair,
                samples: view.smoothed().samples(),
                photometry: Photometry {
                    gain: 1.0,
                    offset: None,
                    sigma: 2.0 * residual_floor(reference, view),
                },
                epipolar_sigma: options.epipolar_sigma_px as f32,
            },
        })
    }
}

/// Standard deviation of the difference of two matching samples as far as noise and rounding make it.
pub(super) fn residual_floor(reference: &MatchView, neighbour: &MatchView) -> f32 {
    /// Norm of the smoothing kernel: the factor by which it reduces independent noise.
    const SMOOTHING: f64 = 0.29;
    /// Rounding of the smoothed image, twice.
    const ROUNDING: f64 = 0.41;
    let noise = SMOOTHING * reference.noise_sigma().hypot(neighbour.noise_sigma());
    // Interpolation and what differs between two views of one place: never below a level.
    noise.hypot(ROUNDING).max(1.0) as f32
}

/// How far the poses of neighbours err, in pixels: the root mean square of the turns that their matches ask for. 0 of neighbours
/// that were not turned.
pub(super) fn pose_sigma_px(candidates: &[Candidate<'_>]) -> f32 {
    let turned: Vec<f64> = candidates
        .iter()
        .filter(|candidate| candidate.matched.photometry.offset.is_some())
        .map(|candidate| candidate.correction.angle() * candidate.view.camera().mean_focal_px())
        .collect();
    let squares: f64 = turned.iter().map(|turn| turn * turn).sum();
    (squares / turned.len().max(1) as f64).sqrt() as f32
}
