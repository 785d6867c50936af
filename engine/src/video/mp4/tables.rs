//! Samples that the tables of the index list.

use super::part::Part;
use super::sample::{Sample, TimeScale};
use crate::video::VideoError;

/// Largest number of samples that may have one size: a damaged number takes any amount of memory.
const MAX_EQUAL_SAMPLES: u32 = 1 << 16;

/// The samples of the table `stbl`, and when the next one after them is decoded. There are none in a file that has only fragments.
pub(super) fn samples(
    table: &Part<'_>,
    scale: TimeScale,
) -> Result<(Vec<Sample>, i64), VideoError> {
    let sizes = table.need(b"stsz")?;
    let sizes: Vec<u32> = match sizes.u32(4)? {
        0 => sizes
            .rows(8, 4)?
            .map(|row| row.u32(0))
            .collect::<Result<_, _>>()?,
        size => {
            let count = sizes.u32(8)?;
            // A file of one picture, as a rule.
            if count > MAX_EQUAL_SAMPLES {
                return Err(sizes.error(4, "all samples have one size (damaged file?)"));
            }
            vec![size; count as usize]
        }
    };
    let offsets: Vec<u64> = match table.find(b"stco")? {
        Some(part) => part
            .rows(4, 4)?
            .map(|row| row.u32(0).map(u64::from))
            .collect::<Result<_, _>>()?,
        None => table
            .need(b"co64")?
            .rows(4, 8)?
            .map(|row| row.u64(0))
            .collect::<Result<_, _>>()?,
    };
    let (times, end) = times(table, sizes.len())?;
    let chunks = table.need(b"stsc")?;
    // First chunk, from 1, and samples in each chunk from there on.
    let runs: Vec<[u32; 2]> = chunks
        .rows(4, 12)?
        .map(|row| Ok([row.u32(0)?, row.u32(4)?]))
        .collect::<Result<_, VideoError>>()?;
    let mut samples = Vec::with_capacity(sizes.len());
    let mut run = 0;
    for (chunk, offset) in (1_u32..).zip(&offsets) {
        while runs.get(run + 1).is_some_and(|[first, _]| *first <= chunk) {
            run += 1;
        }
        let [_, count] = *runs
            .get(run)
            .ok_or_else(|| chunks.error(0, "the table of chunks is empty (damaged file?)"))?;
        let mut offset = *offset;
        for _ in 0..count {
            let Some(size) = sizes.get(samples.len()) else {
                break;
            };
            let time = times[samples.len()];
            samples.push(Sample {
                offset,
                size: *size,
                time_ns: scale.nanoseconds(time),
            });
            offset = offset.saturating_add(u64::from(*size));
        }
    }
    Ok((samples, end))
}

/// When each sample is shown, in units of the time scale, and when the last one ends.
fn times(table: &Part<'_>, count: usize) -> Result<(Vec<i64>, i64), VideoError> {
    let mut times = Vec::with_capacity(count);
    let mut time = 0_i64;
    for row in table.need(b"stts")?.rows(4, 8)? {
        let step = i64::from(row.u32(4)?);
        for _ in 0..row.u32(0)? {
            if times.len() == count {
                break;
            }
            times.push(time);
            time = time.saturating_add(step);
        }
    }
    times.resize(count, time);
    if let Some(offsets) = table.find(b"ctts")? {
        let mut at = 0;
        for row in offsets.rows(4, 8)? {
            // Unsigned in version 0, but nobody writes offsets beyond 2^31.
            let offset = i64::from(row.u32(4)? as i32);
            for _ in 0..row.u32(0)? {
                let Some(time) = times.get_mut(at) else {
                    break;
                };
                *time = time.saturating_add(offset);
                at += 1;
            }
        }
    }
    Ok((times, time))
}
