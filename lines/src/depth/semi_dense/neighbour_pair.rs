//! A neighbour of the reference with its calibration.

use nalgebra::UnitQuaternion;

use super::epipolar_search::{Photometry, SearchTarget};
use super::options::SemiDenseOptions;
use super::pair_geometry::PairGeometry;
use super::view::MatchView;

/// The pair of the reference and one neighbour.
pub(super) struct NeighbourPair<'a> {
    /// The neighbour.
    pub(super) view: &'a MatchView,
    /// Rotation of the neighbour about its centre that aligns its matches.
    pub(super) correction: UnitQuaternion<f64>,
    /// The calibrated neighbour as the search uses it.
    pub(super) target: SearchTarget<'a>,
}

impl<'a> NeighbourPair<'a> {
    /// An uncalibrated pair; `None` without a baseline.
    pub(super) fn new(
        reference: &MatchView,
        view: &'a MatchView,
        options: &SemiDenseOptions,
    ) -> Option<Self> {
        let correction = UnitQuaternion::identity();
        let geometry = PairGeometry::new(reference, view, &correction, options.largest_parallax)?;
        Some(Self {
            view,
            correction,
            target: SearchTarget {
                geometry,
                samples: view.smoothed().samples(),
                photometry: Photometry {
                    gain: 1.0,
                    offset: None,
                    sigma: 2.0 * min_residual_sigma(reference, view),
                },
                epipolar_sigma: options.epipolar_sigma_px as f32,
            },
        })
    }
}

/// Lower bound of the residual's standard deviation, from image noise and rounding.
pub(super) fn min_residual_sigma(reference: &MatchView, neighbour: &MatchView) -> f32 {
    /// Norm of the smoothing kernel, the factor by which it reduces independent noise.
    const SMOOTHING: f64 = 0.29;
    /// Rounding of both smoothed images.
    const ROUNDING: f64 = 0.41;
    let noise = SMOOTHING * reference.noise_sigma().hypot(neighbour.noise_sigma());
    // At least one grey level, for interpolation and changes of appearance.
    noise.hypot(ROUNDING).max(1.0) as f32
}

/// Standard deviation of the pose error in pixels: root mean square of the rotation corrections of the calibrated pairs; 0 without any.
pub(super) fn pose_sigma_px(pairs: &[NeighbourPair<'_>]) -> f32 {
    let rotations_px: Vec<f64> = pairs
        .iter()
        .filter(|pair| pair.target.photometry.offset.is_some())
        .map(|pair| pair.correction.angle() * pair.view.camera().mean_focal_px())
        .collect();
    let squares: f64 = rotations_px.iter().map(|angle| angle * angle).sum();
    (squares / rotations_px.len().max(1) as f64).sqrt() as f32
}
