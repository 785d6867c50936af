//! Pictures of H.264 samples, in the order in which they are shown.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use rust_h264::decoder::{ChromaFormat, Decoder, Frame};
use rust_h264::nal::{NalUnit, NalUnitType, parse_avcc, parse_avcc_config, parse_sps_info};

use super::mp4::VideoTrack;
use super::picture::Picture;
use super::{Take, VideoError};

/// Pictures that wait for one to be shown before them: no stream may need more.
const MAX_WAITING: usize = 16;

/// Largest encoded picture.
const MAX_SAMPLE: u32 = 1 << 26;

/// Largest picture in pixels: a damaged header may claim more than there is memory for.
const MAX_PIXELS: u64 = 1 << 26;

/// Decodes the samples of a track. Samples that are damaged or cut off are left out and counted in the warnings that are returned.
pub(super) fn read<R: Read + Seek>(
    path: &Path,
    file: &mut R,
    track: &VideoTrack,
    take: &mut Take<'_>,
) -> Result<Vec<String>, VideoError> {
    let damaged =
        |problem: &str| VideoError::content(path, 0, format!("{problem} (damaged file?)"));
    let configuration = parse_avcc_config(&track.configuration).map_err(damaged)?;
    let mut decoder = Decoder::new();
    for nal in configuration.sps_nals.iter().chain(&configuration.pps_nals) {
        decode(&mut decoder, nal).map_err(|problem| damaged(&problem))?;
    }
    let mut waiting = Waiting::default();
    // Group and time of the picture that is being decoded: the decoder returns it with the next.
    let mut current = None;
    let mut group = 0_u32;
    let (mut failed, mut first_failure, mut shown) = (0, None, 0);
    let mut data = Vec::new();
    for (number, sample) in track.samples.iter().enumerate() {
        let outcome = load(file, sample.offset, sample.size, &mut data).and_then(|()| {
            for nal in parse_avcc(&data, configuration.length_size) {
                if let Some(frame) = decode(&mut decoder, &nal)?
                    && let Some(place) = current.take()
                {
                    waiting.insert(place, frame);
                }
                // The counters of pictures begin anew.
                group += u32::from(nal.nal_unit_type == NalUnitType::SliceIdr && current.is_none());
                if matches!(
                    nal.nal_unit_type,
                    NalUnitType::Slice | NalUnitType::SliceIdr
                ) {
                    current = Some((group, sample.time_ns));
                }
            }
            Ok(())
        });
        if let Err(problem) = outcome {
            failed += 1;
            first_failure.get_or_insert_with(|| format!("picture {number}: {problem}"));
        }
        while waiting.frames.len() > MAX_WAITING {
            shown += waiting.show(take)?;
        }
    }
    if let (Some(frame), Some(place)) = (decoder.flush(), current) {
        waiting.insert(place, frame);
    }
    while !waiting.frames.is_empty() {
        shown += waiting.show(take)?;
    }
    let first_failure = first_failure.unwrap_or_default();
    if shown == 0 {
        return Err(VideoError::content(
            path,
            track.samples[0].offset,
            format!(
                "none of the {} pictures can be decoded ({first_failure})",
                track.samples.len()
            ),
        ));
    }
    Ok(match failed {
        0 => Vec::new(),
        _ => vec![format!(
            "{}: {failed} of {} pictures are damaged or cut off and left out (first: {first_failure})",
            path.display(),
            track.samples.len()
        )],
    })
}

/// Decodes a unit, unless it announces a picture of implausible size.
fn decode(decoder: &mut Decoder, nal: &NalUnit<'_>) -> Result<Option<Frame>, String> {
    if nal.nal_unit_type == NalUnitType::Sps {
        let announced = parse_sps_info(nal).map_err(|error| error.to_string())?;
        let (width, height) = (announced.coded_width, announced.coded_height);
        if u64::from(width) * u64::from(height) > MAX_PIXELS {
            return Err(format!("its size of {width} x {height} is implausible"));
        }
    }
    decoder.decode_nal(nal).map_err(|error| error.to_string())
}

fn load<R: Read + Seek>(
    file: &mut R,
    offset: u64,
    size: u32,
    data: &mut Vec<u8>,
) -> Result<(), String> {
    if size > MAX_SAMPLE {
        return Err("its size is implausible".to_owned());
    }
    data.clear();
    file.seek(SeekFrom::Start(offset))
        .and_then(|_| file.by_ref().take(u64::from(size)).read_to_end(data))
        .map_err(|error| error.to_string())?;
    match data.len() == size as usize {
        true => Ok(()),
        false => Err("the file ends before it".to_owned()),
    }
}

/// Decoded pictures that others may be shown before.
#[derive(Default)]
struct Waiting {
    /// By group, counter in the group, and order of decoding, with their times.
    frames: BTreeMap<(u32, i32, usize), (i64, Frame)>,
    decoded: usize,
    /// Time of the last picture that was shown.
    last_ns: Option<i64>,
}

impl Waiting {
    fn insert(&mut self, (group, time_ns): (u32, i64), frame: Frame) {
        let key = (group, frame.pic_order_cnt, self.decoded);
        self.frames.insert(key, (time_ns, frame));
        self.decoded += 1;
    }

    /// Passes on the first picture; returns how many were passed on. Times ascend: some recorders write equal ones.
    fn show(&mut self, take: &mut Take<'_>) -> Result<usize, VideoError> {
        let Some((_, (time_ns, frame))) = self.frames.pop_first() else {
            return Ok(0);
        };
        let time_ns = self
            .last_ns
            .map_or(time_ns, |last| time_ns.max(last.saturating_add(1)));
        let Some(picture) = picture_of(frame, time_ns) else {
            return Ok(0);
        };
        self.last_ns = Some(time_ns);
        take(picture)?;
        Ok(1)
    }
}

/// `None` when the planes of a damaged stream have not the size of the picture.
fn picture_of(frame: Frame, time_ns: i64) -> Option<Picture> {
    let (width, height) = (frame.width as usize, frame.height as usize);
    let down = match frame.chroma_format {
        ChromaFormat::Yuv420 => 2,
        ChromaFormat::Yuv422 => 1,
    };
    let shift = u32::from(frame.bit_depth).checked_sub(8)?;
    let plane = |bytes: Vec<u8>| match shift {
        0 => bytes,
        _ => bytes
            .chunks_exact(2)
            .map(|pair| (u16::from_le_bytes([pair[0], pair[1]]) >> shift) as u8)
            .collect(),
    };
    let luma = plane(frame.y);
    (width > 0 && height > 0 && luma.len() >= width * height).then(|| Picture {
        time_ns,
        width,
        height,
        luma,
        chroma: [plane(frame.u), plane(frame.v)],
        chroma_step: [2, down],
        is_full_range: false,
    })
}
