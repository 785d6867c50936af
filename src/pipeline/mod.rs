//! One keyframe after another through lines, landmarks and carver.
//!
//! The [`FrontEnd`] finds a keyframe's segments and depends on nothing else; the [`BackEnd`] joins them to the map in
//! order. [`run`] drives both, so that the front end of the next keyframes works beside the back end of these.

mod back_end;
mod front_end;
mod labels;
pub mod landmarks;
mod options;
mod run;
pub mod scale;
pub mod segment_map;
pub mod segment_points;
pub mod surface_points;

pub use back_end::{BackEnd, BackEndError, MapUpdate};
pub use front_end::{FrontEnd, FrontEndError, Keyframe};
pub use labels::{CutSettings, LabelKind};
pub use options::{Options, OptionsError};
pub use run::run;
