//! Where the results of a reconstruction go: files, report, page, picture.

mod empty;
mod feature_edges;
mod growth;
mod keyframe_reports;
mod live;
mod output;
mod output_file;
mod output_folder;
mod page;
mod page_run;
mod picture;
mod report;
mod results;
mod session;
mod simplified;
mod structure;
mod surface_files;
mod surface_page;
mod temporary_folder;
mod tracked;
mod tracked_page;

pub(crate) use empty::{model_left_out, reason_for_nothing};
pub(crate) use feature_edges::final_mesh_edges;
pub use growth::Growth;
pub(crate) use growth::GrowthFiles;
pub(crate) use keyframe_reports::KeyframeReports;
pub(crate) use live::LiveSink;
pub use output::Format;
pub(crate) use output::{
    clusters_part, feature_edges_part, segments_part, surface_part, write_geometry, write_part,
    write_poses,
};
pub(crate) use output_file::{check_ending, check_outputs, folder_of, keep_sequence};
pub(crate) use output_folder::{OutputError, OutputFolder, keep_apart, lock_folder};
pub(crate) use page::{
    GrowingView, PageRecorder, grouped, growth_plots, last_surface, page_of, page_surface,
    with_elements,
};
pub(crate) use page_run::PageRun;
pub(crate) use picture::{RichestKeyframe, crosses};
pub(crate) use report::{RunLog, print_object, print_text};
pub(crate) use results::{ResultSettings, write_results};
pub(crate) use session::{SessionPage, last_page};
pub(crate) use simplified::final_mesh;
pub(crate) use simplified::{DEFAULT_TOLERANCE_TEXT, line_ends};
pub(crate) use structure::{StructureInput, keep_structure_inputs, write_structure};
pub(crate) use surface_files::SurfaceFiles;
pub(crate) use temporary_folder::TemporaryFolder;
pub(crate) use tracked::{write_tracked, write_tracked_poses};
pub(crate) use tracked_page::LiveTracking;
