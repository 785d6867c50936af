//! The page of a run while it goes on, on the loopback address.
//!
//! A [`LiveView`] keeps the [state](state) of the page and serves the page of `report.html` without data, and `/events`: a stream of
//! server-sent events. The first message has the whole state, the others what each keyframe changed; the surface comes as the bytes of
//! `keyframes/NNNNNN.delta`. A client that connects again begins with the whole state.
//!
//! **The run never waits for a client.** Messages wait in a [queue](clients) of each client. One that becomes too long is emptied, and its
//! client gets the whole state in place of them.

mod clients;
mod image_pace;
mod state;
mod surface_copy;
#[cfg(test)]
mod tests;
mod view;

pub(crate) use image_pace::ImagePace;
pub(crate) use state::{KeyframeRow, LiveUpdate};
pub(crate) use view::LiveView;
