//! Points of the surface between the edges of a keyframe.
//!
//! A Delaunay triangulation of the known edge depths in the image predicts planes between the edges. At grid pixels away from edges, a
//! patch is warped through the predicted plane into the neighbours, and a plane sweep along the view ray maximises the correlation. A pixel
//! gets a point when enough neighbours agree and the maximum is unique within the swept range. Pixels without texture get none.
//!
//! # Reference
//! R. T. Collins, A Space-Sweep Approach to True Multi-Image Matching, CVPR 1996.
//!
//! Plane predictions from a triangulation of known depths follow A. Geiger, M. Roser, R. Urtasun, Efficient Large-Scale Stereo Matching,
//! ACCV 2010. *Differs from both*: the swept planes have the slope of the triangle,
//! and only a short range around it is swept.

mod options;
mod plane_hypotheses;
mod sweep;

pub use options::SweepOptions;

use rayon::prelude::*;

use self::plane_hypotheses::plane_hypotheses;
use self::sweep::{PlaneSweep, SourceView};
use super::estimate::{SemiDense, SemiDenseDepth};
use super::view::MatchView;
use crate::depth::map::InverseDepth;

/// A surface point away from edges.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Its pixel in the reference image.
    pub pixel: [u16; 2],
    /// Its inverse depth in the reference camera.
    pub depth: InverseDepth,
}

/// Number of pixels per task.
const CHUNK: usize = 32;

impl SemiDense {
    /// Measures surface points between the edges of `reference`, row by row, at most one per grid pixel.
    ///
    /// `depth` is the result of [`estimate`](Self::estimate) with the same `neighbours`, before or after
    /// [`enforce_consistency`](super::enforce_consistency). The standard deviations include matching and pose errors. Empty with a spacing of 0
    /// or fewer than two calibrated neighbours.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Complexity
    /// O(grid pixels x neighbours x sweep steps x samples of a patch).
    pub fn surface_points(
        &self,
        reference: &MatchView,
        depth: &SemiDenseDepth,
        neighbours: &[&MatchView],
        options: &SweepOptions,
    ) -> Vec<SurfacePoint> {
        let sources: Vec<SourceView<'_>> = depth
            .pairs
            .iter()
            .zip(&depth.corrections)
            .filter(|(pair, _)| pair.offset.is_some())
            .filter_map(|(pair, correction)| {
                let view = neighbours.get(pair.neighbour)?;
                SourceView::new(reference, view, correction)
            })
            .take(options.neighbours.min(MAX_SOURCES))
            .collect();
        if options.spacing_px == 0 || sources.len() < MIN_SOURCES {
            return Vec::new();
        }
        let hypotheses = plane_hypotheses(reference, &depth.map, options.spacing_px);
        let hidden = self.options().hidden_pose_error as f32;
        let sweep = PlaneSweep::new(reference, sources, hidden, options);
        hypotheses
            .par_chunks(CHUNK)
            .map(|chunk| -> Vec<SurfacePoint> {
                chunk
                    .iter()
                    .filter_map(|hypothesis| sweep.measure(hypothesis))
                    .collect()
            })
            .flatten_iter()
            .collect()
    }
}

/// Minimum number of neighbours for a measurement.
const MIN_SOURCES: usize = 2;
/// Maximum number of neighbours.
const MAX_SOURCES: usize = 16;

#[cfg(test)]
mod tests;
