//! Images reduced by whole factors.

/// Sums over blocks of `factor` x `factor` pixels, row by row, for `CHANNELS` interleaved channels. Incomplete blocks at
/// the right and bottom are dropped.
///
/// # Panics
/// When a factor of zero meets an image that is not empty.
pub fn block_sums<const CHANNELS: usize>(samples: &[u8], width: usize, factor: usize) -> Vec<u32> {
    let row = width * CHANNELS;
    let row_of_sums = width / factor * CHANNELS;
    if row_of_sums == 0 {
        return Vec::new();
    }
    let mut sums = vec![0_u32; row_of_sums * (samples.len() / (row * factor))];
    let blocks = sums.chunks_exact_mut(row_of_sums);
    for (sums, rows) in blocks.zip(samples.chunks_exact(row * factor)) {
        for line in rows.chunks_exact(row) {
            let blocks = line.chunks_exact(factor * CHANNELS);
            for (sum, block) in sums.chunks_exact_mut(CHANNELS).zip(blocks) {
                for pixel in block.chunks_exact(CHANNELS) {
                    for (sum, sample) in sum.iter_mut().zip(pixel) {
                        *sum += u32::from(*sample);
                    }
                }
            }
        }
    }
    sums
}
