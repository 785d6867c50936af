//! The index of MP4 and MOV files: where the samples of the video track lie, and when they are shown.
//!
//! # Reference
//! ISO/IEC 14496-12 (boxes, sample tables) and 14496-15 (`avcC`, `hvcC`).

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::VideoError;

/// Largest index that is read into memory.
const MAX_INDEX: u64 = 1 << 28;

/// A sample of the video track, in the order of decoding.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sample {
    pub(super) offset: u64,
    pub(super) size: u32,
    /// When it is shown.
    pub(super) time_ns: i64,
}

/// What the decoder needs before the first sample.
#[derive(Debug)]
pub(super) enum Configuration {
    /// Contents of the `avcC` box.
    H264(Vec<u8>),
    /// Contents of the `hvcC` box.
    H265(Vec<u8>),
}

/// The video track of a file.
#[derive(Debug)]
pub(super) struct VideoTrack {
    pub(super) configuration: Configuration,
    pub(super) samples: Vec<Sample>,
    /// Quarter turns to the right that pictures need to be upright.
    pub(super) quarter_turns: u8,
}

/// Part of the index, with its position in the file.
#[derive(Debug, Clone, Copy)]
struct Part<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    offset: u64,
}

impl<'a> Part<'a> {
    fn error(&self, at: usize, problem: impl Into<String>) -> VideoError {
        VideoError::content(self.path, self.offset + at as u64, problem)
    }

    /// A part of `count` bytes at a position.
    fn take(&self, at: usize, count: usize) -> Result<Self, VideoError> {
        let bytes = at
            .checked_add(count)
            .and_then(|end| self.bytes.get(at..end))
            .ok_or_else(|| {
                self.error(
                    at,
                    "the index ends too early (damaged file?): copy it again",
                )
            })?;
        Ok(Self {
            path: self.path,
            bytes,
            offset: self.offset + at as u64,
        })
    }

    fn u32(&self, at: usize) -> Result<u32, VideoError> {
        let bytes = self.take(at, 4)?.bytes;
        Ok(bytes
            .iter()
            .fold(0, |sum, byte| (sum << 8) | u32::from(*byte)))
    }

    fn u64(&self, at: usize) -> Result<u64, VideoError> {
        Ok((u64::from(self.u32(at)?) << 32) | u64::from(self.u32(at + 4)?))
    }

    /// The contents of the boxes in this part, with their types.
    fn boxes(&self) -> Result<Vec<([u8; 4], Self)>, VideoError> {
        let mut found = Vec::new();
        let mut at = 0;
        while at + 8 <= self.bytes.len() {
            let mut head = 8;
            let size = match self.u32(at)? {
                0 => self.bytes.len() - at,
                1 => {
                    head = 16;
                    usize::try_from(self.u64(at + 8)?).unwrap_or(usize::MAX)
                }
                size => size as usize,
            };
            let name = self.take(at + 4, 4)?.bytes;
            if size < head {
                return Err(self.error(at, "a box is shorter than its head (damaged file?)"));
            }
            let whole = self.take(at, size)?;
            found.push((
                [name[0], name[1], name[2], name[3]],
                whole.take(head, size - head)?,
            ));
            at += size;
        }
        Ok(found)
    }

    fn find(&self, name: &[u8; 4]) -> Result<Option<Self>, VideoError> {
        let found = self.boxes()?.into_iter().find(|(other, _)| other == name);
        Ok(found.map(|(_, part)| part))
    }

    fn need(&self, name: &[u8; 4]) -> Result<Self, VideoError> {
        self.find(name)?.ok_or_else(|| {
            self.error(
                0,
                format!("the box {} is missing (damaged file?)", name.escape_ascii()),
            )
        })
    }

    /// Entries of a table: `count` at a position, then as many rows of `width` bytes.
    fn rows(&self, at: usize, width: usize) -> Result<impl Iterator<Item = Self>, VideoError> {
        let count = self.u32(at)? as usize;
        let table = count
            .checked_mul(width)
            .ok_or_else(|| self.error(at, "the table is too long (damaged file?)"))
            .and_then(|size| self.take(at + 4, size))?;
        Ok((0..count).filter_map(move |row| table.take(row * width, width).ok()))
    }
}

/// Reads the index of a file.
pub(super) fn read_track<R: Read + Seek>(
    path: &Path,
    file: &mut R,
) -> Result<VideoTrack, VideoError> {
    let (bytes, offset) = read_index(path, file)?;
    let index = Part {
        path,
        bytes: &bytes,
        offset,
    };
    let boxes = index.boxes()?;
    if boxes.iter().any(|(name, _)| name == b"mvex") {
        return Err(index.error(
            0,
            "fragmented files are not read: convert with ffmpeg -i VIDEO -c copy -movflags faststart OUT.mp4",
        ));
    }
    for (_, track) in boxes.into_iter().filter(|(name, _)| name == b"trak") {
        let media = track.need(b"mdia")?;
        if media.need(b"hdlr")?.take(8, 4)?.bytes == b"vide" {
            return video_track(&track, &media);
        }
    }
    Err(index.error(0, "the file has no video track"))
}

/// The contents of the box `moov`, and their position.
fn read_index<R: Read + Seek>(path: &Path, file: &mut R) -> Result<(Vec<u8>, u64), VideoError> {
    let unreadable = |error| VideoError::unreadable(path, error);
    let end = file.seek(SeekFrom::End(0)).map_err(unreadable)?;
    let mut at = 0;
    while at + 8 <= end {
        let mut head = [0; 16];
        let length = (end - at).min(16) as usize;
        file.seek(SeekFrom::Start(at)).map_err(unreadable)?;
        file.read_exact(&mut head[..length]).map_err(unreadable)?;
        let part = Part {
            path,
            bytes: &head[..length],
            offset: at,
        };
        let (size, head_size) = match part.u32(0)? {
            0 => (end - at, 8),
            1 => (part.u64(8)?, 16),
            size => (u64::from(size), 8),
        };
        if size < head_size {
            return Err(part.error(0, "a box is shorter than its head (damaged file?)"));
        }
        if &head[4..8] == b"moov" {
            let length = size - head_size;
            if length > MAX_INDEX || size > end - at {
                return Err(part.error(0, "the index is cut off (damaged file?): copy it again"));
            }
            let mut bytes = vec![0; length as usize];
            file.seek(SeekFrom::Start(at + head_size))
                .map_err(unreadable)?;
            file.read_exact(&mut bytes).map_err(unreadable)?;
            return Ok((bytes, at + head_size));
        }
        at = at.saturating_add(size);
    }
    Err(VideoError::content(
        path,
        end,
        "the file ends without an index (moov): it was cut off, or the recording was not finished; copy it again",
    ))
}

fn video_track(track: &Part<'_>, media: &Part<'_>) -> Result<VideoTrack, VideoError> {
    let header = media.need(b"mdhd")?;
    let is_long = header.take(0, 1)?.bytes[0] == 1;
    let scale = header.u32(if is_long { 20 } else { 12 })?;
    if scale == 0 {
        return Err(header.error(0, "the time scale is zero (damaged file?)"));
    }
    let table = media.need(b"minf")?.need(b"stbl")?;
    let samples = samples(&table, scale)?;
    Ok(VideoTrack {
        configuration: configuration(&table.need(b"stsd")?)?,
        samples,
        quarter_turns: quarter_turns(&track.need(b"tkhd")?)?,
    })
}

/// The configuration of the decoder, from the description of the samples.
fn configuration(description: &Part<'_>) -> Result<Configuration, VideoError> {
    /// Bytes of a visual sample entry before its boxes.
    const VISUAL_ENTRY: usize = 78;
    let entries = description
        .take(8, description.bytes.len().saturating_sub(8))?
        .boxes()?;
    let Some((codec, entry)) = entries.first() else {
        return Err(description.error(0, "the format of the video is missing"));
    };
    let contents = |name| {
        let inside = entry.take(VISUAL_ENTRY, entry.bytes.len().saturating_sub(VISUAL_ENTRY))?;
        Ok(inside.need(name)?.bytes.to_vec())
    };
    match codec {
        b"avc1" | b"avc3" => contents(b"avcC").map(Configuration::H264),
        b"hvc1" | b"hev1" => contents(b"hvcC").map(Configuration::H265),
        _ => Err(entry.error(
            0,
            format!(
                "video of type {} is not read, only H.264 and H.265: convert with ffmpeg -i VIDEO -c:v libx264 OUT.mp4, or pipe it \
                 with ffmpeg -i VIDEO -pix_fmt yuv420p -f yuv4mpegpipe - | linecarve track - ...",
                codec.escape_ascii()
            ),
        )),
    }
}

/// Quarter turns to the right, from the matrix of a track head.
fn quarter_turns(head: &Part<'_>) -> Result<u8, VideoError> {
    let is_long = head.take(0, 1)?.bytes[0] == 1;
    let matrix = if is_long { 52 } else { 40 };
    // Rows are a b u, c d v, x y w; x' = a x + c y.
    let [a, b] = [head.u32(matrix)? as i32, head.u32(matrix + 4)? as i32];
    Ok(match (a, b) {
        (0, 1..) => 1,
        (..=-1, 0) => 2,
        (0, ..=-1) => 3,
        _ => 0,
    })
}

fn samples(table: &Part<'_>, scale: u32) -> Result<Vec<Sample>, VideoError> {
    let sizes = table.need(b"stsz")?;
    let sizes: Vec<u32> = match sizes.u32(4)? {
        0 => sizes
            .rows(8, 4)?
            .map(|row| row.u32(0))
            .collect::<Result<_, _>>()?,
        _ => return Err(sizes.error(4, "all samples have one size, which no encoded video has")),
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
    let times = times(table, sizes.len())?;
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
                time_ns: (i128::from(time) * 1_000_000_000 / i128::from(scale)) as i64,
            });
            offset = offset.saturating_add(u64::from(*size));
        }
    }
    if samples.is_empty() {
        return Err(table.error(0, "the video has no pictures"));
    }
    let first = samples
        .iter()
        .map(|sample| sample.time_ns)
        .min()
        .unwrap_or(0);
    for sample in &mut samples {
        sample.time_ns = sample.time_ns.saturating_sub(first);
    }
    Ok(samples)
}

/// When each sample is shown, in units of the time scale.
fn times(table: &Part<'_>, count: usize) -> Result<Vec<i64>, VideoError> {
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
    Ok(times)
}
