//! Keyframes given by a list or a fixed step.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use linecarve_mesh::files::read_regular;

use crate::{Frame, parse_stamp_ns};

/// Largest difference between a listed time stamp and its frame: programs print stamps in microseconds or coarser.
const STAMP_TOLERANCE_NS: u64 = 1_000_000;

/// Why a list of keyframes is invalid.
#[derive(Debug, thiserror::Error)]
pub enum KeyframeListError {
    /// The file cannot be read.
    #[error("cannot read the list of keyframes {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A line matches no frame.
    #[error("{}, line {line}: {entry:?} is not a frame: give a frame name (such as {example:?}), an index below {count}, or a time stamp in seconds", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The line, truncated.
        entry: String,
        /// The name of the first frame.
        example: String,
        /// Number of frames.
        count: usize,
    },
    /// The list is empty.
    #[error("{}: the list of keyframes is empty: give one frame a line", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// The indices of every `n`-th of `count` frames, from the first. An `n` of 0 counts as 1.
pub fn every_nth(n: usize, count: usize) -> Vec<usize> {
    (0..count).step_by(n.max(1)).collect()
}

/// Reads the frames listed in a text file, one a line; returns their indices in ascending order without repetition. Empty
/// lines and `#` comments are ignored.
///
/// A line, or its first word, is a frame name, an image file name, an index from 0, or a time stamp in seconds with a
/// decimal point, in this order of precedence. Keyframe trajectories of other programs are therefore valid lists.
///
/// # Errors
/// If the file cannot be read, lists an unknown frame, or lists none.
pub fn read_keyframe_list(path: &Path, frames: &[Frame]) -> Result<Vec<usize>, KeyframeListError> {
    let bytes = read_regular(path).map_err(|source| KeyframeListError::Read {
        path: path.to_owned(),
        source,
    })?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{feff}');
    let names = FrameLookup::new(frames);
    let mut chosen = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let entry = line.split('#').next().unwrap_or_default().trim();
        if entry.is_empty() {
            continue;
        }
        let is_separator = |c: char| c.is_whitespace() || c == ',';
        let word = entry.split(is_separator).next().unwrap_or_default();
        let Some(frame) = names.find(entry).or_else(|| names.find(word)) else {
            return Err(KeyframeListError::Unknown {
                path: path.to_owned(),
                line: index + 1,
                entry: entry.chars().take(80).collect(),
                example: frames
                    .first()
                    .map_or_else(String::new, |frame| frame.name.clone()),
                count: frames.len(),
            });
        };
        chosen.push(frame);
    }
    if chosen.is_empty() {
        return Err(KeyframeListError::Empty {
            path: path.to_owned(),
        });
    }
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
}

/// Lookup of frames by name, index and time.
struct FrameLookup<'a> {
    by_name: HashMap<&'a str, usize>,
    /// Ascending.
    by_stamp: Vec<(i64, usize)>,
    count: usize,
}

impl<'a> FrameLookup<'a> {
    fn new(frames: &'a [Frame]) -> Self {
        let mut by_name = HashMap::new();
        for (index, frame) in frames.iter().enumerate() {
            by_name.entry(frame.name.as_str()).or_insert(index);
        }
        for (index, frame) in frames.iter().enumerate() {
            if let Some(name) = frame.color.file_name().and_then(|name| name.to_str()) {
                by_name.entry(name).or_insert(index);
            }
        }
        let mut by_stamp: Vec<_> = (0..)
            .zip(frames)
            .map(|(index, frame)| (frame.timestamp_ns, index))
            .collect();
        by_stamp.sort_unstable();
        Self {
            by_name,
            by_stamp,
            count: frames.len(),
        }
    }

    fn find(&self, entry: &str) -> Option<usize> {
        let file_name = entry.rsplit(['/', '\\']).next().unwrap_or(entry);
        let by_name = [entry, file_name]
            .into_iter()
            .find_map(|name| self.by_name.get(name).copied());
        let by_index = || entry.parse().ok().filter(|index| *index < self.count);
        let by_stamp = || {
            let stamp_ns = parse_stamp_ns(entry).filter(|_| entry.contains('.'))?;
            self.nearest(stamp_ns)
        };
        by_name.or_else(by_index).or_else(by_stamp)
    }

    fn nearest(&self, stamp_ns: i64) -> Option<usize> {
        let after = self
            .by_stamp
            .partition_point(|&(other, _)| other < stamp_ns);
        self.by_stamp[after.saturating_sub(1)..self.by_stamp.len().min(after + 1)]
            .iter()
            .map(|&(other, index)| (other.abs_diff(stamp_ns), index))
            .min()
            .filter(|(difference, _)| *difference <= STAMP_TOLERANCE_NS)
            .map(|(_, index)| index)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;

    fn frames() -> Vec<Frame> {
        ["frame-000000", "frame-000003", "7"]
            .into_iter()
            .map(|name| Frame {
                name: name.to_owned(),
                timestamp_ns: 1_305_031_102_175_304_000 + name.len() as i64 * 1_000_000_000,
                world_from_camera: Isometry3::identity(),
                color: Path::new("rgb").join(name).with_extension("png"),
                depth: None,
                right: None,
            })
            .collect()
    }

    fn read(text: &[u8]) -> Result<Vec<usize>, KeyframeListError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.txt");
        std::fs::write(&path, text).unwrap();
        read_keyframe_list(&path, &frames())
    }

    #[test]
    fn frames_are_returned_in_sequence_order() {
        let list = "# chosen by hand\n7\r\n\nframe-000003 # table\n0\n1\n";
        assert_eq!(read(list.as_bytes()).unwrap(), [0, 1, 2]);
    }

    #[test]
    fn an_unknown_frame_is_reported_with_its_line() {
        let message = read(b"0\nframe-000001\n").unwrap_err().to_string();
        assert!(
            message.contains("list.txt, line 2") && message.contains("frame-000001"),
            "{message}"
        );
        assert!(matches!(read(b"3"), Err(KeyframeListError::Unknown { .. })));
        assert!(matches!(
            read(b"\xff\xfe0"),
            Err(KeyframeListError::Unknown { .. })
        ));
        assert!(matches!(
            read(b"# nothing\n"),
            Err(KeyframeListError::Empty { .. })
        ));
    }

    #[test]
    fn image_files_and_time_stamps_are_accepted() {
        assert_eq!(read(b"rgb/frame-000003.png\nC:\\7.png").unwrap(), [1, 2]);
        // Seven digits and a pose, as other programs write keyframe trajectories.
        assert_eq!(read(b"1305031103.1753041 1 2 3 0 0 0 1").unwrap(), [2]);
        assert!(read(b"1305031103.2").is_err());
    }

    #[test]
    fn every_third() {
        assert_eq!(every_nth(3, 8), [0, 3, 6]);
        assert_eq!(every_nth(0, 2), [0, 1]);
    }
}
