//! What can be wrong with a sequence as a whole, and with one of its images.

use std::path::PathBuf;

/// Why a sequence cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SequenceError {
    /// There is nothing at the path.
    #[error("there is no folder {}: check the path of the sequence", folder.display())]
    FolderMissing {
        /// The path as given.
        folder: PathBuf,
    },
    /// The path is a file.
    #[error("{} is a file: give the folder that holds the sequence", path.display())]
    NotAFolder {
        /// The path as given.
        path: PathBuf,
    },
    /// The folder has no entries.
    #[error("the folder {} is empty: give the folder that holds the images and poses of a sequence", folder.display())]
    EmptyFolder {
        /// The path as given.
        folder: PathBuf,
    },
    /// No layout recognises the folder.
    #[error(
        "the layout of {} is not known; looked for {looked_for}; found {found}{hint}",
        folder.display()
    )]
    UnknownLayout {
        /// The path as given.
        folder: PathBuf,
        /// What the known layouts look for.
        looked_for: String,
        /// The first entries of the folder.
        found: String,
        /// A remedy, when one can be guessed.
        hint: String,
    },
    /// No layout has this name.
    #[error("there is no layout {name}: --layout takes one of {known}")]
    UnknownLayoutName {
        /// The name as given.
        name: String,
        /// The names that there are.
        known: String,
    },
    /// A file or folder cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A line of a text file is wrong.
    #[error("{}, line {line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Its line, from 1.
        line: usize,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// A binary file is wrong.
    #[error("{}, byte {offset}: {problem}", path.display())]
    Byte {
        /// The file.
        path: PathBuf,
        /// Where, counted from 0.
        offset: u64,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// A file is wrong as a whole.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// Not one frame has an image and a pose.
    #[error("{}: no frame is left: {reason}", folder.display())]
    NoFrames {
        /// The path as given.
        folder: PathBuf,
        /// What became of the frames.
        reason: String,
    },
    /// The first image that can be read shows that the calibration does not fit.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// Why an image of a frame cannot be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FrameError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The image.
        path: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// The file is not a whole image.
    #[error("{} cannot be decoded: {reason} (copy or record the file again, or remove the frame)", path.display())]
    Undecodable {
        /// The image.
        path: PathBuf,
        /// What the decoder said.
        reason: String,
    },
    /// The image has another size than its calibration is for.
    #[error(
        "{} is {width} x {height}, expected {expected_width} x {expected_height} ({expected_by}): {remedy}",
        path.display()
    )]
    Size {
        /// The image.
        path: PathBuf,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
        /// Width that the calibration is for.
        expected_width: u32,
        /// Height that the calibration is for.
        expected_height: u32,
        /// Where the expectation comes from.
        expected_by: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The calibration cannot belong to images of this size.
    #[error(
        "{} is {width} x {height}, but the principal point ({cx}, {cy}) lies outside of it: \
         give the intrinsics of images of this size (--calibration FILE)",
        path.display()
    )]
    PrincipalPoint {
        /// The image.
        path: PathBuf,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
        /// Principal point x in pixels.
        cx: f64,
        /// Principal point y in pixels.
        cy: f64,
    },
    /// The depth image does not hold one 16-bit number a pixel.
    #[error(
        "{} holds {found} a pixel, a depth image needs one channel of 16 bits (8-bit previews lose the depth): \
         give the original depth images",
        path.display()
    )]
    DepthFormat {
        /// The image.
        path: PathBuf,
        /// What it holds instead, in words.
        found: String,
    },
}

impl FrameError {
    /// Whether only this frame is affected, so that a run may leave it out, count it and go on. Otherwise the whole
    /// sequence or its calibration is wrong.
    pub fn is_limited_to_frame(&self) -> bool {
        matches!(self, Self::Unreadable { .. } | Self::Undecodable { .. })
    }
}
