//! Surfaces from the same keyframes beside each other: what they are made of, how near they come to a ground truth, how
//! they look.
//!
//! A [`ComparedSurface`] is what a run leaves, [`Comparison`] the numbers as they stand in `compare.json`,
//! [`score_table`] the same as text, [`Gallery`] the pictures.

mod grid;
mod pictures;
mod result;
mod table;

pub use grid::panel_grid;
pub use pictures::{ErrorPaint, Gallery, GalleryView};
pub use result::{
    ComparedSurface, Comparison, GroundTruthSummary, SurfaceSummary, distance_within,
};
pub use table::{ScoreTable, score_table};
