//! Which frames become keyframes, and how sharp a frame is.
//!
//! Frames are looked at one by one, as they would come from a camera: `KeyframeSelector` asks for each whether the camera has
//! moved or turned far enough since the last keyframe; the sharpest of the few frames from there on wins. A list given
//! by the user or every n-th frame take the place of that.

mod list;
mod options;
mod overlap;
mod select;
mod selector;
mod sharpness;

pub use list::{KeyframeListError, every_nth, read_keyframe_list};
pub use options::{KeyframeOptions, KeyframeOptionsError};
pub use select::select_keyframes;
pub(crate) use sharpness::sharpness;
