//! Samples of a video track, and their times.

use std::num::NonZeroU32;

/// A sample of the video track, in the order of decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::video) struct Sample {
    pub(in crate::video) offset: u64,
    pub(in crate::video) size: u32,
    /// When it is shown.
    pub(in crate::video) time_ns: i64,
}

/// Units of a second in which a track gives its times.
#[derive(Debug, Clone, Copy)]
pub(super) struct TimeScale(pub(super) NonZeroU32);

impl TimeScale {
    pub(super) fn nanoseconds(self, time: i64) -> i64 {
        let exact = i128::from(time) * 1_000_000_000 / i128::from(self.0.get());
        i64::try_from(exact).unwrap_or(if time < 0 { i64::MIN } else { i64::MAX })
    }
}
