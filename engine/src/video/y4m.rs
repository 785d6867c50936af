//! Uncompressed video: YUV4MPEG2, as FFmpeg writes it to a pipe with `-f yuv4mpegpipe`.

use std::io::{BufRead, Read};
use std::path::Path;

use super::picture::Picture;
use super::{Take, VideoError};

/// First bytes of a stream.
pub(super) const MAGIC: &[u8] = b"YUV4MPEG2 ";

/// Longest line of parameters.
const MAX_LINE: u64 = 1024;

/// Largest side of a picture.
const MAX_SIDE: usize = 16_384;

/// Parameters of a stream.
struct Header {
    width: usize,
    height: usize,
    /// Pictures in a second, as a fraction.
    rate: [i64; 2],
    chroma_step: Option<[usize; 2]>,
    is_full_range: bool,
}

/// Reads a stream to its end. Returns a warning when the last picture is cut off.
pub(super) fn read(
    path: &Path,
    input: &mut dyn BufRead,
    take: &mut Take<'_>,
) -> Result<Vec<String>, VideoError> {
    let mut offset = 0;
    let line = read_line(path, input, &mut offset)?;
    let header = parse_header(&line).map_err(|problem| VideoError::content(path, 0, problem))?;
    let luma = header.width * header.height;
    let chroma = header.chroma_step.map_or(0, |[across, down]| {
        header.width.div_ceil(across) * header.height.div_ceil(down)
    });
    let mut number = 0;
    loop {
        let start = offset;
        let line = read_line(path, input, &mut offset)?;
        if line.is_empty() {
            break;
        }
        if !line.starts_with(b"FRAME") {
            return Err(VideoError::content(
                path,
                start,
                format!(
                    "expected picture {number} to begin with FRAME (damaged file?): write the video again"
                ),
            ));
        }
        let mut planes = [vec![0; luma], vec![0; chroma], vec![0; chroma]];
        for plane in &mut planes {
            match input.read_exact(plane) {
                Ok(()) => offset += plane.len() as u64,
                Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => {
                    if number == 0 {
                        return Err(VideoError::content(
                            path,
                            offset,
                            "the first picture is cut off",
                        ));
                    }
                    return Ok(vec![format!(
                        "{}: picture {number} is cut off and left out",
                        path.display()
                    )]);
                }
                Err(error) => return Err(VideoError::unreadable(path, error)),
            }
        }
        let [luma, blue, red] = planes;
        let [count, seconds] = header.rate;
        take(Picture {
            time_ns: (i128::from(number) * i128::from(seconds) * 1_000_000_000 / i128::from(count))
                as i64,
            width: header.width,
            height: header.height,
            luma,
            chroma: [blue, red],
            chroma_step: header.chroma_step.unwrap_or([1, 1]),
            is_full_range: header.is_full_range,
        })?;
        number += 1;
    }
    match number {
        0 => Err(VideoError::content(
            path,
            offset,
            "the video has no picture",
        )),
        _ => Ok(Vec::new()),
    }
}

/// A line without its end; empty at the end of the stream.
fn read_line(
    path: &Path,
    input: &mut dyn BufRead,
    offset: &mut u64,
) -> Result<Vec<u8>, VideoError> {
    let mut line = Vec::new();
    input
        .take(MAX_LINE)
        .read_until(b'\n', &mut line)
        .map_err(|error| VideoError::unreadable(path, error))?;
    *offset += line.len() as u64;
    if line.last() == Some(&b'\n') {
        line.pop();
    }
    Ok(line)
}

fn parse_header(line: &[u8]) -> Result<Header, String> {
    let rest = line.strip_prefix(MAGIC).ok_or(
        "is not YUV4MPEG2: pipe it with ffmpeg -i VIDEO -pix_fmt yuv420p -f yuv4mpegpipe -",
    )?;
    let text = std::str::from_utf8(rest).map_err(|_| "the parameters are not text")?;
    let (mut width, mut height, mut rate) = (0, 0, [25, 1]);
    let mut chroma_step = Some([2, 2]);
    let mut is_full_range = false;
    for field in text.split(' ').filter(|field| !field.is_empty()) {
        let (key, value) = field.split_at(field.chars().next().map_or(0, char::len_utf8));
        let number = || {
            let number = value.parse::<usize>().ok();
            number
                .filter(|side| (1..=MAX_SIDE).contains(side))
                .ok_or_else(|| format!("{field}: width and height are 1 to {MAX_SIDE}"))
        };
        match key {
            "W" => width = number()?,
            "H" => height = number()?,
            "F" => {
                let fraction = value.split_once(':').and_then(|(a, b)| {
                    let fraction = [a.parse::<i64>().ok()?, b.parse::<i64>().ok()?];
                    let is_valid = fraction
                        .iter()
                        .all(|part| (1..=1_000_000_000).contains(part));
                    is_valid.then_some(fraction)
                });
                rate = fraction
                    .ok_or_else(|| format!("{field}: the rate is a fraction such as F30:1"))?;
            }
            "C" => {
                chroma_step = match value {
                    "mono" => None,
                    "420" | "420jpeg" | "420paldv" | "420mpeg2" => Some([2, 2]),
                    "422" => Some([2, 1]),
                    "444" => Some([1, 1]),
                    _ => {
                        return Err(format!(
                            "samples of type {value} are not read: convert with ffmpeg -pix_fmt yuv420p"
                        ));
                    }
                };
            }
            "X" => is_full_range |= value == "COLORRANGE=FULL",
            _ => {}
        }
    }
    if width == 0 || height == 0 {
        return Err("width (W) or height (H) is missing in the first line".to_owned());
    }
    Ok(Header {
        width,
        height,
        rate,
        chroma_step,
        is_full_range,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stream(pictures: usize) -> Vec<u8> {
        let mut bytes = b"YUV4MPEG2 W5 H3 F30:1 Ip C420jpeg XCOLORRANGE=FULL\n".to_vec();
        for number in 0..pictures {
            bytes.extend(b"FRAME\n");
            bytes.extend((0..15 + 2 * 6).map(|at| (at + number) as u8));
        }
        bytes
    }

    fn pictures(bytes: &[u8]) -> Result<(Vec<Picture>, Vec<String>), VideoError> {
        let mut found = Vec::new();
        let warnings = read(Path::new("video.y4m"), &mut &bytes[..], &mut |picture| {
            found.push(picture);
            Ok(())
        })?;
        Ok((found, warnings))
    }

    #[test]
    fn pictures_come_with_their_times() {
        let (found, warnings) = pictures(&stream(3)).unwrap();
        assert!(warnings.is_empty());
        let times: Vec<i64> = found.iter().map(|picture| picture.time_ns).collect();
        assert_eq!(times, [0, 33_333_333, 66_666_666]);
        assert!(found[1].is_full_range);
        assert_eq!(
            (
                found[1].luma[0],
                found[1].chroma[0][0],
                found[1].chroma[1][5]
            ),
            (1, 16, 27)
        );
    }

    #[test]
    fn damaged_streams_are_refused_or_cut() {
        let whole = stream(3);
        for cut in 0..whole.len() {
            match pictures(&whole[..cut]) {
                Ok((found, _)) => assert!(!found.is_empty()),
                Err(error) => assert!(error.to_string().contains("video.y4m, byte"), "{error}"),
            }
        }
        for at in 0..whole.len() {
            for bit in 0..8 {
                let mut damaged = whole.clone();
                damaged[at] ^= 1 << bit;
                if let Err(error) = pictures(&damaged) {
                    assert!(error.to_string().contains("video.y4m, byte"), "{error}");
                }
            }
        }
        let other = b"YUV4MPEG2 W5 H3 C420p10\n";
        let error = pictures(other).unwrap_err().to_string();
        assert!(
            error.contains("420p10") && error.contains("-pix_fmt"),
            "{error}"
        );
    }
}
