//! `report.html`: surfaces over keyframes, tables and plots on one page that needs nothing else.
//!
//! A [`SurfaceHistory`] follows a surface through a run and keeps what came and went, not one mesh a keyframe. A
//! [`Page`] holds one or two of them with tables and texts; [`write_page`] puts it, as JSON with binary parts in
//! base64, beside the viewer of `assets/report` into a single HTML file. The file works from disk, without a network.

mod data;
mod encode;
mod errors;
mod history;
mod images;
mod life_spans;
mod write;

pub use data::{
    CountPlot, ErrorScale, OutsideView, Page, PageCamera, PageKeyframe, PageSurface, PageTable,
    Series, StageTiming,
};
pub use errors::triangle_errors;
pub use history::{Elements, HistoryLimits, SurfaceHistory};
pub use images::{KeyframeImage, keyframe_image};
pub use write::write_page;

#[cfg(test)]
mod tests;
