//! Pictures of the samples of a track, in the order in which they are shown.

use std::collections::BTreeMap;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::codec::{Codec, Decoded};
use super::mp4::{Configuration, VideoTrack};
use super::picture::Picture;
use super::{Take, VideoError, h264, h265};

/// Pictures that wait for one to be shown before them: no stream may need more.
const MAX_WAITING: usize = 16;

/// Largest encoded picture.
const MAX_SAMPLE: u32 = 1 << 26;

/// Decodes the samples of a track. Samples that are damaged or cut off are left out and counted in the warnings that are returned.
pub(super) fn read<R: Read + Seek>(
    path: &Path,
    file: &mut R,
    track: &VideoTrack,
    take: &mut Take<'_>,
) -> Result<Vec<String>, VideoError> {
    let damaged =
        |problem: String| VideoError::content(path, 0, format!("{problem} (damaged file?)"));
    let mut codec: Box<dyn Codec> = match &track.configuration {
        Configuration::H264(bytes) => Box::new(h264::Samples::new(bytes).map_err(damaged)?),
        Configuration::H265(bytes) => Box::new(h265::Samples::new(bytes).map_err(damaged)?),
    };
    let mut take = |picture: Picture| {
        take(Picture {
            is_full_range: picture.is_full_range || track.is_full_range,
            ..picture
        })
    };
    let take: &mut Take<'_> = &mut take;
    let mut waiting = Waiting::default();
    let (mut failed, mut first_failure, mut shown) = (0, None, 0);
    let (mut data, mut decoded) = (Vec::new(), Vec::new());
    for (number, sample) in track.samples.iter().enumerate() {
        let outcome = load(file, sample.offset, sample.size, &mut data)
            .and_then(|()| codec.decode(&data, sample.time_ns, &mut decoded));
        if let Err(problem) = outcome {
            failed += 1;
            first_failure.get_or_insert_with(|| format!("picture {number}: {problem}"));
        }
        waiting.insert(decoded.drain(..));
        while waiting.pictures.len() > MAX_WAITING {
            shown += waiting.show(take)?;
        }
    }
    waiting.insert(codec.finish());
    while !waiting.pictures.is_empty() {
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
    let mut warnings = Vec::new();
    if failed > 0 {
        warnings.push(format!(
            "{}: {failed} of {} pictures are damaged or cut off and left out (first: {first_failure})",
            path.display(),
            track.samples.len()
        ));
    }
    if let Some(damage) = &track.damage {
        warnings.push(format!("{damage}; the pictures from there on are left out"));
    }
    Ok(warnings)
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
    /// By group, counter in the group, and order of decoding.
    pictures: BTreeMap<(u32, i32, usize), Option<Picture>>,
    decoded: usize,
    /// Time of the last picture that was shown.
    last_ns: Option<i64>,
}

impl Waiting {
    fn insert(&mut self, decoded: impl IntoIterator<Item = Decoded>) {
        for one in decoded {
            let key = (one.group, one.count, self.decoded);
            self.pictures.insert(key, one.picture);
            self.decoded += 1;
        }
    }

    /// Passes on the first picture; returns how many were passed on. Times ascend: some recorders write equal ones.
    fn show(&mut self, take: &mut Take<'_>) -> Result<usize, VideoError> {
        let Some((_, Some(mut picture))) = self.pictures.pop_first() else {
            return Ok(0);
        };
        if let Some(last) = self.last_ns {
            picture.time_ns = picture.time_ns.max(last.saturating_add(1));
        }
        self.last_ns = Some(picture.time_ns);
        take(picture)?;
        Ok(1)
    }
}
