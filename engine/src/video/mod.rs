//! Video files: pictures out of MP4 and MOV (H.264, H.265) and of uncompressed Y4M, written as images that a sequence is read from.

mod codec;
mod facts;
mod h264;
mod h265;
mod mp4;
mod picture;
mod samples;
mod unpack;
mod y4m;

pub use facts::{VideoFacts, describe};
pub use unpack::{Unpacking, is_video, of_video, unpack, unpack_as};

use std::path::{Path, PathBuf};

use picture::Picture;

/// Why a video cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum VideoError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The file is damaged, or holds what is not supported.
    #[error("{}, byte {offset}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// Byte at which it stands.
        offset: u64,
        /// What is wrong.
        problem: String,
    },
    /// The pictures cannot be written.
    #[error("cannot write {}: {problem}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The reason.
        problem: String,
    },
}

impl VideoError {
    fn unreadable(path: &Path, source: std::io::Error) -> Self {
        Self::Unreadable {
            path: path.to_owned(),
            source,
        }
    }

    fn content(path: &Path, offset: u64, problem: impl Into<String>) -> Self {
        Self::Content {
            path: path.to_owned(),
            offset,
            problem: problem.into(),
        }
    }
}

/// Takes the pictures of a video in the order of their times.
type Take<'a> = dyn FnMut(Picture) -> Result<(), VideoError> + 'a;
