//! Surfaces from the same keyframes beside each other: what they are made of, how near they come to a ground truth, how
//! they look.
//!
//! A [`ComparedSurface`] is what a run leaves, [`Comparison`] the numbers as they stand in `compare.json`,
//! [`score_table`] the same as text, [`Gallery`] the pictures.

mod files;
mod grid;
mod ground_truth;
mod page;
mod pictures;
mod result;
mod run;
mod shots;
mod table;
mod warnings;

pub(crate) use files::write_surfaces;
pub use grid::panel_grid;
pub(crate) use ground_truth::GroundTruth;
pub(crate) use page::write_compare_page;
pub use pictures::{ErrorPaint, Gallery, GalleryView};
pub use result::{ComparedSurface, Comparison, GroundTruthSummary, SurfaceSummary};
pub(crate) use run::compared_run;
pub(crate) use shots::write_pictures;
pub use table::{ScoreTable, score_table};
pub(crate) use warnings::Warnings;
