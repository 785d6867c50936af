//! One item of a plan.

use std::time::Instant;

use crate::error::TilesError;
use crate::file::Writer;
use crate::stage::{Counts, Item, Stage};
use crate::work::Work;
use crate::{carve, frame, giants, label, merge, network, settle, surface};

/// Carries out an item and writes its file and manifest. Done again, it writes the same bytes.
///
/// `peak_mb` is asked for the peak memory of the process at the end.
///
/// # Errors
/// When a file that it needs is missing or damaged, or its own cannot be written.
pub fn run_item(
    work: &Work,
    item: Item,
    peak_mb: impl FnOnce() -> Option<f64>,
) -> Result<(), TilesError> {
    let start = Instant::now();
    let is_known =
        work.stages().contains(&item.stage) && work.items(item.stage).any(|other| other == item);
    if !is_known {
        let tiles = work.plan().tiles.len();
        return Err(TilesError::NoItem { item, tiles });
    }
    let (writer, counts): (Writer, Counts) = match item.stage {
        Stage::Frame => frame::run(work, item),
        Stage::Carve => carve::run(work, item),
        Stage::Giants => giants::run(work, item),
        Stage::Network => network::run(work, item),
        Stage::Label => label::run(work, item),
        Stage::Settle => settle::run(work, item),
        Stage::Surface => surface::run(work, item),
        Stage::Merge => merge::run(work, item),
    }?;
    let measured = (counts, start.elapsed().as_secs_f64(), peak_mb());
    work.finish(item, writer, measured)
}
