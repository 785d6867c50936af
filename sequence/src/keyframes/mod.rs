//! Keyframe selection.
//!
//! `KeyframeSelector` processes frames one by one: after enough translation, rotation or loss of overlap since the last
//! keyframe, the sharpest of the next few frames becomes a keyframe. Alternatives are every n-th frame and a list.

mod list;
mod online;
mod options;
mod overlap;
mod select;
mod selector;
mod sharpness;

pub use list::{KeyframeListError, every_nth, read_keyframe_list};
pub use online::OnlineKeyframes;
pub use options::{KeyframeOptions, KeyframeOptionsError};
pub use select::select_keyframes;
pub(crate) use sharpness::sharpness;
