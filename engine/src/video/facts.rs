//! What a video file holds, without decoding it.

use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use serde::Serialize;

use super::mp4::{self, Configuration};
use super::unpack::is_mp4;
use super::{VideoError, y4m};

/// Facts about a video.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct VideoFacts {
    /// `MP4` or `Y4M`.
    pub container: &'static str,
    /// `H.264`, `H.265` or `none`.
    pub codec: &'static str,
    /// Width of the pictures as stored.
    pub width: u32,
    /// Height of the pictures as stored.
    pub height: u32,
    /// Number of pictures.
    pub pictures: usize,
    /// Time from the first to the last picture in seconds.
    pub duration_s: f64,
    /// Quarter turns to the right that make pictures upright.
    pub quarter_turns: u8,
    /// Why pictures at the end are left out.
    pub damage: Option<String>,
}

/// Reads the index of a video.
///
/// # Errors
/// If the file cannot be read, is damaged, or its codec is not supported.
pub fn describe(path: &Path) -> Result<VideoFacts, VideoError> {
    let unreadable = |error| VideoError::unreadable(path, error);
    let mut file = BufReader::new(File::open(path).map_err(unreadable)?);
    let mut start = [0; 12];
    file.read_exact(&mut start).map_err(unreadable)?;
    file.seek(SeekFrom::Start(0)).map_err(unreadable)?;
    if is_mp4(&start) {
        let track = mp4::read_track(path, &mut file)?;
        let last = track.samples.iter().map(|sample| sample.time_ns).max();
        return Ok(VideoFacts {
            container: "MP4",
            codec: match track.configuration {
                Configuration::H264(_) => "H.264",
                Configuration::H265(_) => "H.265",
            },
            width: track.size[0],
            height: track.size[1],
            pictures: track.samples.len(),
            duration_s: last.unwrap_or(0) as f64 * 1e-9,
            quarter_turns: track.quarter_turns,
            damage: track.damage.map(|damage| damage.to_string()),
        });
    }
    let mut facts = VideoFacts {
        container: "Y4M",
        codec: "none",
        width: 0,
        height: 0,
        pictures: 0,
        duration_s: 0.0,
        quarter_turns: 0,
        damage: None,
    };
    let warnings = y4m::read(path, &mut file, &mut |picture| {
        facts.width = picture.width as u32;
        facts.height = picture.height as u32;
        facts.pictures += 1;
        facts.duration_s = picture.time_ns as f64 * 1e-9;
        Ok(())
    })?;
    facts.damage = warnings.into_iter().next();
    Ok(facts)
}
