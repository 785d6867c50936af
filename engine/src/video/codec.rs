//! What a decoder of one kind of video does.

use super::picture::Picture;

/// Largest picture in pixels: a damaged header may claim more than there is memory for.
pub(super) const MAX_PIXELS: u64 = 1 << 26;

/// A picture that was decoded, and its place in the order of display.
#[derive(Debug)]
pub(super) struct Decoded {
    /// Number of the group of pictures whose counters belong together.
    pub(super) group: u32,
    /// Counter in the group.
    pub(super) count: i32,
    /// `None` when the planes of a damaged stream have not the size of the picture.
    pub(super) picture: Option<Picture>,
}

/// A decoder of samples.
pub(super) trait Codec {
    /// Decodes a sample, which is shown at a time, and appends the pictures that ended. An error concerns this sample only.
    fn decode(
        &mut self,
        sample: &[u8],
        time_ns: i64,
        decoded: &mut Vec<Decoded>,
    ) -> Result<(), String>;

    /// The picture that has not ended with the last sample.
    fn finish(&mut self) -> Option<Decoded>;
}
