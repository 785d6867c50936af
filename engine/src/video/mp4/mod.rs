//! The index of MP4 and MOV files: where the samples of the video track lie, and when they are shown.
//!
//! # Reference
//! ISO/IEC 14496-12 (boxes, sample tables, movie fragments) and 14496-15 (`avcC`, `hvcC`).

mod fragments;
mod part;
mod sample;
mod tables;

use std::io::{Read, Seek, SeekFrom};
use std::num::NonZeroU32;
use std::ops::Range;
use std::path::Path;

use super::VideoError;
use fragments::Fragments;
use part::Part;
pub(super) use sample::Sample;
use sample::TimeScale;
use tables::samples;

/// Largest index that is read into memory.
const MAX_INDEX: u64 = 1 << 28;

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
    /// Width and height of the pictures as stored.
    pub(super) size: [u32; 2],
    /// Quarter turns to the right that pictures need to be upright.
    pub(super) quarter_turns: u8,
    /// Whether samples of pictures are said to use all values.
    pub(super) is_full_range: bool,
    /// Why fragments at the end are left out.
    pub(super) damage: Option<VideoError>,
}

/// Reads the index of a file, and those of its fragments.
pub(super) fn read_track<R: Read + Seek>(
    path: &Path,
    file: &mut R,
) -> Result<VideoTrack, VideoError> {
    let unreadable = |error| VideoError::unreadable(path, error);
    let end = file.seek(SeekFrom::End(0)).map_err(unreadable)?;
    let mut at = 0;
    let index = loop {
        let Some(found) = OuterBox::at(path, file, at, end)? else {
            return Err(VideoError::content(
                path,
                end,
                "the file ends without an index (moov): it was cut off, or the recording was not finished; copy it again",
            ));
        };
        at = found.end;
        if &found.name == b"moov" {
            break found;
        }
    };
    let bytes = index.contents(path, file, end)?;
    let (mut track, fragments) = read_index(index.part(path, &bytes))?;
    if let Some(mut fragments) = fragments {
        // A file whose recording was interrupted is whole up to the last fragments.
        let outcome = read_fragments(path, file, at..end, &mut fragments, &mut track.samples);
        track.damage = outcome.err();
    }
    let times = track.samples.iter().map(|sample| sample.time_ns);
    let Some(first) = times.min() else {
        return Err(track.damage.unwrap_or_else(|| {
            VideoError::content(path, index.start, "the video has no pictures")
        }));
    };
    for sample in &mut track.samples {
        sample.time_ns = sample.time_ns.saturating_sub(first);
    }
    Ok(track)
}

/// Appends the samples of all fragments in a range of the file; those before a fragment that is damaged or cut off when there is an error.
fn read_fragments<R: Read + Seek>(
    path: &Path,
    file: &mut R,
    range: Range<u64>,
    fragments: &mut Fragments,
    samples: &mut Vec<Sample>,
) -> Result<(), VideoError> {
    let mut at = range.start;
    while let Some(found) = OuterBox::at(path, file, at, range.end)? {
        if &found.name == b"moof" {
            let bytes = found.contents(path, file, range.end)?;
            fragments.read(&found.part(path, &bytes), found.start, samples)?;
        }
        at = found.end;
    }
    Ok(())
}

/// The place of a box that is in no other.
struct OuterBox {
    name: [u8; 4],
    start: u64,
    /// Where its contents start.
    inside: u64,
    end: u64,
}

impl OuterBox {
    /// The box at a byte of a file with an end; `None` there.
    fn at<R: Read + Seek>(
        path: &Path,
        file: &mut R,
        at: u64,
        end: u64,
    ) -> Result<Option<Self>, VideoError> {
        if at.saturating_add(8) > end {
            return Ok(None);
        }
        let unreadable = |error| VideoError::unreadable(path, error);
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
        Ok(Some(Self {
            name: [head[4], head[5], head[6], head[7]],
            start: at,
            inside: at + head_size,
            end: at.saturating_add(size),
        }))
    }

    fn contents<R: Read + Seek>(
        &self,
        path: &Path,
        file: &mut R,
        file_end: u64,
    ) -> Result<Vec<u8>, VideoError> {
        let length = self.end - self.inside;
        if length > MAX_INDEX || self.end > file_end {
            return Err(VideoError::content(
                path,
                self.start,
                "the index is cut off (damaged file?): copy it again",
            ));
        }
        let unreadable = |error| VideoError::unreadable(path, error);
        let mut bytes = vec![0; length as usize];
        file.seek(SeekFrom::Start(self.inside))
            .map_err(unreadable)?;
        file.read_exact(&mut bytes).map_err(unreadable)?;
        Ok(bytes)
    }

    fn part<'a>(&self, path: &'a Path, bytes: &'a [u8]) -> Part<'a> {
        Part {
            path,
            bytes,
            offset: self.inside,
        }
    }
}

/// The first video track of the contents of the box `moov`, and what reads its fragments when it has some.
fn read_index(index: Part<'_>) -> Result<(VideoTrack, Option<Fragments>), VideoError> {
    let boxes = index.boxes()?;
    let extends = boxes.iter().find(|(name, _)| name == b"mvex");
    for (_, track) in boxes.iter().filter(|(name, _)| name == b"trak") {
        let media = track.need(b"mdia")?;
        if media.need(b"hdlr")?.take(8, 4)?.bytes != b"vide" {
            continue;
        }
        let header = media.need(b"mdhd")?;
        let scale = header.u32(if header.is_long()? { 20 } else { 12 })?;
        let scale = NonZeroU32::new(scale)
            .map(TimeScale)
            .ok_or_else(|| header.error(0, "the time scale is zero (damaged file?)"))?;
        let table = media.need(b"minf")?.need(b"stbl")?;
        // First, as the tables of a codec that is not read may be unusual, too.
        let Description {
            configuration,
            is_full_range,
            size,
        } = description(&table.need(b"stsd")?)?;
        let (samples, end) = samples(&table, scale)?;
        let head = track.need(b"tkhd")?;
        let number = head.u32(if head.is_long()? { 20 } else { 12 })?;
        let fragments = extends.map(|(_, part)| Fragments::new(part, number, scale, end));
        let track = VideoTrack {
            configuration,
            is_full_range,
            samples,
            size,
            quarter_turns: quarter_turns(&head)?,
            damage: None,
        };
        return Ok((track, fragments.transpose()?));
    }
    Err(index.error(0, "the file has no video track"))
}

/// The description of the samples.
struct Description {
    configuration: Configuration,
    /// Whether pictures use all values.
    is_full_range: bool,
    /// Width and height.
    size: [u32; 2],
}

fn description(description: &Part<'_>) -> Result<Description, VideoError> {
    /// Bytes of a visual sample entry before its boxes.
    const VISUAL_ENTRY: usize = 78;
    let entries = description
        .take(8, description.bytes.len().saturating_sub(8))?
        .boxes()?;
    let Some((codec, entry)) = entries.first() else {
        return Err(description.error(0, "the format of the video is missing"));
    };
    let inside = || entry.take(VISUAL_ENTRY, entry.bytes.len().saturating_sub(VISUAL_ENTRY));
    let contents = |name| Ok::<_, VideoError>(inside()?.need(name)?.bytes.to_vec());
    let configuration = match codec {
        b"avc1" | b"avc3" => Configuration::H264(contents(b"avcC")?),
        b"hvc1" | b"hev1" => Configuration::H265(contents(b"hvcC")?),
        _ => return Err(entry.error(
            0,
            format!(
                "video of type {} is not read, only H.264 and H.265: convert with ffmpeg -i VIDEO -c:v libx264 OUT.mp4, or pipe it \
                 with ffmpeg -i VIDEO -pix_fmt yuv420p -f yuv4mpegpipe - | linecarve track - ...",
                codec.escape_ascii()
            ),
        )),
    };
    let color = inside()?.find(b"colr")?;
    let is_full_range = color.is_some_and(|color| match color.bytes {
        [b'n', b'c', b'l', b'x', _, _, _, _, _, _, range, ..] => range >> 7 == 1,
        _ => false,
    });
    let size = entry.u32(24)?;
    Ok(Description {
        configuration,
        is_full_range,
        size: [size >> 16, size & 0xFFFF],
    })
}

/// Quarter turns to the right, from the matrix of a track head. A matrix of zeros turns nothing.
fn quarter_turns(head: &Part<'_>) -> Result<u8, VideoError> {
    let matrix = if head.is_long()? { 52 } else { 40 };
    // Rows are a b u, c d v, x y w; x' = a x + c y.
    let number = |at: usize| Ok::<_, VideoError>(head.u32(matrix + 4 * at)? as i32);
    let [a, b, c, d] = [number(0)?, number(1)?, number(3)?, number(4)?];
    let determinant = i64::from(a) * i64::from(d) - i64::from(b) * i64::from(c);
    match (a, b, c, d) {
        (1.., 0, 0, 1..) | (0, 0, 0, 0) => Ok(0),
        (0, 1.., ..=-1, 0) => Ok(1),
        (..=-1, 0, 0, ..=-1) => Ok(2),
        (0, ..=-1, 1.., 0) => Ok(3),
        _ if determinant < 0 => Err(head.error(
            matrix,
            "the display matrix shows the video as a mirror image: if text is readable in a player, run ffmpeg -i VIDEO OUT.mp4; if it is \
             mirrored there, run ffmpeg -display_rotation 0 -i VIDEO -c copy OUT.mp4",
        )),
        _ => Err(head.error(
            matrix,
            "the display matrix turns the video by an angle that is no quarter turn: run ffmpeg -i VIDEO OUT.mp4 for the pictures as players \
             show them, or ffmpeg -display_rotation 0 -i VIDEO -c copy OUT.mp4 for the pictures as they are stored",
        )),
    }
}
