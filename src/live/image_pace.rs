//! How often the image of a keyframe is made for live pages.

use std::time::{Duration, Instant};

/// Least time between two images: decoding one takes about as long as a tenth of the work on a keyframe.
const PAUSE: Duration = Duration::from_millis(500);

/// Says when the next image is due.
#[derive(Debug, Default)]
pub(crate) struct ImagePace {
    last: Option<Instant>,
}

impl ImagePace {
    /// Whether an image is due; if so, the next one is due after a pause.
    pub(crate) fn is_due(&mut self) -> bool {
        let now = Instant::now();
        let is_due = self
            .last
            .is_none_or(|last| now.duration_since(last) >= PAUSE);
        if is_due {
            self.last = Some(now);
        }
        is_due
    }
}
