//! Writes the pictures of a video as the images of a sequence.

use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

use image::RgbImage;
use linecarve_mesh::encode_jpeg;
use linecarve_mesh::files::{write_atomically, write_unsynced};
use linecarve_sequence::OpenOptions;

use super::picture::Picture;
use super::{VideoError, mp4, samples, y4m};
use crate::run::ProgressHook;

/// Quality of the images: their loss is below that of the video.
const JPEG_QUALITY: u8 = 95;

/// Name of the folder of images in the folder of the sequence.
const IMAGES: &str = "images";

/// Standard input as a path.
const STANDARD_INPUT: &str = "-";

/// Whether a path is a video: a file that begins as one, or `-` for standard input.
pub fn is_video(path: &Path) -> bool {
    if path == Path::new(STANDARD_INPUT) {
        return true;
    }
    let mut start = [0; 12];
    let is_file = std::fs::metadata(path).is_ok_and(|metadata| metadata.is_file());
    is_file
        && File::open(path).is_ok_and(|mut file| file.read_exact(&mut start).is_ok())
        && (start.starts_with(y4m::MAGIC) || is_mp4(&start))
}

/// How the folder of [`unpack`] is opened.
pub fn of_video(options: OpenOptions) -> OpenOptions {
    let mut options = options;
    options.layout = Some("images-and-poses".to_owned());
    options
}

pub(super) fn is_mp4(start: &[u8]) -> bool {
    let first = start.get(4..8).unwrap_or_default();
    [b"ftyp", b"moov", b"mdat", b"wide", b"free"]
        .iter()
        .any(|name| first == *name)
}

/// Writes the pictures of a video to `images/` in a folder, and their times to `times.txt`. Removes nothing: images of an earlier video
/// that had more pictures would stay. Returns warnings.
///
/// # Errors
/// When the video has no picture that can be read, or a file cannot be written.
pub fn unpack(
    input: &Path,
    folder: &Path,
    progress: &ProgressHook,
) -> Result<Vec<String>, VideoError> {
    unpack_as(input, folder, Unpacking::default(), progress)
}

/// How the pictures of a video are written.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unpacking {
    /// For a recording that has poses and intrinsics of the pictures: pixels as they are stored, whatever way they are to be shown, and
    /// numbers that count damaged pictures, too.
    pub of_recording: bool,
    /// Only so many pictures.
    pub most: Option<usize>,
}

/// As [`unpack`], with a choice of how.
///
/// # Errors
/// As [`unpack`].
pub fn unpack_as(
    input: &Path,
    folder: &Path,
    unpacking: Unpacking,
    progress: &ProgressHook,
) -> Result<Vec<String>, VideoError> {
    let images = folder.join(IMAGES);
    std::fs::create_dir_all(&images).map_err(|error| VideoError::Write {
        path: images.clone(),
        problem: error.to_string(),
    })?;
    let mut times = String::from("# seconds\n");
    let mut count = 0_usize;
    let mut turns = 0;
    let mut size = None;
    // Times of the pictures of a recording, also of damaged ones.
    let mut all_times: Vec<i64> = Vec::new();
    let mut take = |picture: Picture, turns: u8, all_times: &[i64]| {
        // Of a damaged video, pictures may come in another size; a sequence has one.
        let own = (picture.width, picture.height);
        if *size.get_or_insert(own) != own {
            return Ok(());
        }
        let number = all_times.binary_search(&picture.time_ns).unwrap_or(count);
        let path = images.join(format!("{number:06}.jpg"));
        let rgb = upright(picture.to_rgb(), turns);
        write_image(&path, &rgb)?;
        let [seconds, rest] = [
            picture.time_ns.div_euclid(1_000_000_000),
            picture.time_ns.rem_euclid(1_000_000_000),
        ];
        times.push_str(&format!("{seconds}.{rest:09}\n"));
        count += 1;
        Ok(())
    };
    let warnings = if input == Path::new(STANDARD_INPUT) {
        let mut stdin = std::io::stdin().lock();
        y4m::read(Path::new("standard input"), &mut stdin, &mut |one| {
            take(one, 0, &[])
        })?
    } else {
        let unreadable = |error| VideoError::unreadable(input, error);
        let mut file = BufReader::new(File::open(input).map_err(unreadable)?);
        let mut start = [0; 12];
        file.read_exact(&mut start).map_err(unreadable)?;
        if is_mp4(&start) {
            let mut track = mp4::read_track(input, &mut file)?;
            if unpacking.of_recording {
                all_times.extend(track.samples.iter().map(|sample| sample.time_ns));
                all_times.sort_unstable();
            } else {
                turns = track.quarter_turns;
            }
            track.samples.truncate(unpacking.most.unwrap_or(usize::MAX));
            let mut task = progress.begin("pictures", track.samples.len(), "reading the video");
            samples::read(input, &mut file, &track, &mut |one| {
                task.step();
                take(one, turns, &all_times)
            })?
        } else {
            let mut whole = Cursor::new(start).chain(file);
            y4m::read(input, &mut BufReader::new(&mut whole), &mut |one| {
                take(one, turns, &[])
            })?
        }
    };
    let path = folder.join("times.txt");
    write_atomically(&path, |out| out.write_all(times.as_bytes())).map_err(|error| {
        VideoError::Write {
            path,
            problem: error.to_string(),
        }
    })?;
    Ok(warnings)
}

fn upright(picture: RgbImage, quarter_turns: u8) -> RgbImage {
    match quarter_turns {
        1 => image::imageops::rotate90(&picture),
        2 => image::imageops::rotate180(&picture),
        3 => image::imageops::rotate270(&picture),
        _ => picture,
    }
}

fn write_image(path: &Path, picture: &RgbImage) -> Result<(), VideoError> {
    let failed = |problem: String| VideoError::Write {
        path: path.to_owned(),
        problem,
    };
    let bytes = encode_jpeg(picture, JPEG_QUALITY).map_err(|error| failed(error.to_string()))?;
    write_unsynced(path, |out| out.write_all(&bytes)).map_err(|error| failed(error.to_string()))
}

#[cfg(test)]
mod tests;
