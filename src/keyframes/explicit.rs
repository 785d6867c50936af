//! Keyframes that the user names.

use std::path::{Path, PathBuf};

use crate::sequence::Frame;

/// Why a list of keyframes is refused.
#[derive(Debug, thiserror::Error)]
pub enum ListError {
    /// The file cannot be read.
    #[error("cannot read the list of keyframes {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A line names no frame.
    #[error("{}, line {line}: {entry:?} is neither the name of a frame (such as {example:?}) nor an index below {count}", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
        /// Which line, counted from 1.
        line: usize,
        /// What stands there.
        entry: String,
        /// The name of the first frame.
        example: String,
        /// Number of frames.
        count: usize,
    },
    /// The list is empty.
    #[error("{}: the list of keyframes is empty", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// Every n-th frame, from the first. An `n` of 0 counts as 1.
pub fn every(n: usize, count: usize) -> Vec<usize> {
    (0..count).step_by(n.max(1)).collect()
}

/// The frames that a text file names, one name or index a line, in the order of the sequence and each once. Empty lines
/// and what follows a `#` are passed over. A name wins over an index.
///
/// # Errors
/// When the file cannot be read, names a frame that is not there, or names none.
pub fn named(path: &Path, frames: &[Frame]) -> Result<Vec<usize>, ListError> {
    let bytes = std::fs::read(path).map_err(|source| ListError::Read {
        path: path.to_owned(),
        source,
    })?;
    let text = String::from_utf8_lossy(&bytes);
    let text = text.trim_start_matches('\u{feff}');
    let mut chosen = Vec::new();
    for (index, line) in text.lines().enumerate() {
        let entry = line.split('#').next().unwrap_or_default().trim();
        if entry.is_empty() {
            continue;
        }
        let by_name = frames.iter().position(|frame| frame.name == entry);
        let by_index = || entry.parse().ok().filter(|index| *index < frames.len());
        let Some(frame) = by_name.or_else(by_index) else {
            return Err(ListError::Unknown {
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
        return Err(ListError::Empty {
            path: path.to_owned(),
        });
    }
    chosen.sort_unstable();
    chosen.dedup();
    Ok(chosen)
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
                timestamp_ns: 0,
                world_from_camera: Isometry3::identity(),
                color: PathBuf::new(),
                depth: None,
            })
            .collect()
    }

    fn read(text: &[u8]) -> Result<Vec<usize>, ListError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.txt");
        std::fs::write(&path, text).unwrap();
        named(&path, &frames())
    }

    #[test]
    fn names_and_indices_come_in_the_order_of_the_sequence() {
        let list = "# chosen by hand\n7\r\n\nframe-000003 # table\n0\n1\n";
        assert_eq!(read(list.as_bytes()).unwrap(), [0, 1, 2]);
    }

    #[test]
    fn what_names_no_frame_is_told_with_its_line() {
        let message = read(b"0\nframe-000001\n").unwrap_err().to_string();
        assert!(
            message.contains("list.txt, line 2") && message.contains("frame-000001"),
            "{message}"
        );
        assert!(matches!(read(b"3"), Err(ListError::Unknown { .. })));
        assert!(matches!(read(b"\xff\xfe0"), Err(ListError::Unknown { .. })));
        assert!(matches!(read(b"# nothing\n"), Err(ListError::Empty { .. })));
    }

    #[test]
    fn every_third() {
        assert_eq!(every(3, 8), [0, 3, 6]);
        assert_eq!(every(0, 2), [0, 1]);
    }
}
