//! `report.html`: surfaces over keyframes, tables and plots in one self-contained page.
//!
//! A [`SurfaceHistory`] records the changes of a surface during a run. A [`Page`] holds one or two histories with tables and
//! texts. [`write_page`] writes it as JSON, with binary parts in base64, and the viewer of `assets/report` into one HTML file
//! that works offline.

mod data;
mod element_history;
mod encode;
mod errors;
mod history;
mod images;
mod texture;
mod triangle_history;
mod write;

pub use data::{
    CountPlot, ErrorScale, OutsideView, Page, PageCamera, PageKeyframe, PageStructure, PageSurface,
    PageTable, Series, StageTiming,
};
pub use errors::triangle_errors;
pub use history::{Elements, HistoryLimits, SurfaceHistory};
pub use images::{KeyframeImage, keyframe_image};
pub use texture::PageTexture;
pub use write::write_page;

pub(crate) use encode::{Base64, Positions};
pub(crate) use write::{live_page, page_json};

#[cfg(test)]
mod tests;
