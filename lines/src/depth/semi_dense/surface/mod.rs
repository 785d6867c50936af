//! Points of the surface between the edges of a keyframe.
//!
//! Known depths on edges, triangulated in the image, say where the surface between them may lie: inverse depth of a plane is linear
//! in the pixel. At the places of a grid that lie on no edge, a patch of the image is carried through that plane into the
//! neighbours, and the plane is moved along the view ray to where the patches are most alike. A place gets a point when enough
//! neighbours see the same there, and nowhere else along the stretch of the ray that was searched: the triangle alone is a guess,
//! the point is measured. Where the image has no texture there is none.
//!
//! # Reference
//! R. T. Collins, A Space-Sweep Approach to True Multi-Image Matching, CVPR 1996.
//! Guesses from a triangulation of what is known follow A. Geiger, M. Roser, R. Urtasun, Efficient Large-Scale Stereo Matching,
//! ACCV 2010. *Differs from both*: planes are slanted as the triangle is, and only a short stretch around it is swept.

mod guesses;
mod options;
mod sweep;

pub use options::SweepOptions;

use rayon::prelude::*;

use self::guesses::guesses;
use self::sweep::{Eye, Sweep};
use super::estimate::{SemiDense, SemiDenseDepth};
use super::view::MatchView;
use crate::depth::map::InverseDepth;

/// A point of the surface that lies on no edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// The pixel at which the reference sees it.
    pub pixel: [u16; 2],
    /// Its inverse depth there.
    pub depth: InverseDepth,
}

/// Places that one task works on.
const CHUNK: usize = 32;

impl SemiDense {
    /// The points between the edges of `reference` that its neighbours confirm, row by row, at most one for each place of a grid.
    ///
    /// `depth` is what [`estimate`](Self::estimate) found with the same `neighbours`, whether its map was confirmed or not.
    /// The standard deviations are those of the matches and, as there, of the errors of poses. None with a spacing of 0, or when
    /// fewer than two neighbours matched.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Complexity
    /// Places of the grid x neighbours x pixels that the swept stretch of the ray is long x samples of a patch.
    pub fn surface_points(
        &self,
        reference: &MatchView,
        depth: &SemiDenseDepth,
        neighbours: &[&MatchView],
        options: &SweepOptions,
    ) -> Vec<SurfacePoint> {
        let eyes: Vec<Eye<'_>> = depth
            .pairs
            .iter()
            .zip(&depth.corrections)
            .filter(|(pair, _)| pair.offset.is_some())
            .filter_map(|(pair, correction)| {
                let view = neighbours.get(pair.neighbour)?;
                Eye::new(reference, view, correction)
            })
            .take(options.neighbours.min(MOST_EYES))
            .collect();
        if options.spacing_px == 0 || eyes.len() < LEAST_EYES {
            return Vec::new();
        }
        let guesses = guesses(reference, &depth.map, options.spacing_px);
        let hidden = self.options().hidden_pose_error as f32;
        let sweep = Sweep::new(reference, eyes, hidden, options);
        guesses
            .par_chunks(CHUNK)
            .map(|chunk| -> Vec<SurfacePoint> {
                chunk.iter().filter_map(|g| sweep.measure(g)).collect()
            })
            .flatten_iter()
            .collect()
    }
}

/// Fewer neighbours than this confirm nothing.
const LEAST_EYES: usize = 2;
/// More are not asked.
const MOST_EYES: usize = 16;

#[cfg(test)]
mod tests;
