//! Errors of opening a sequence and of loading its images.

use std::path::PathBuf;

/// Why a sequence cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SequenceError {
    /// The path does not exist.
    #[error("folder {} does not exist: check the path of the sequence", folder.display())]
    FolderMissing {
        /// The path as given.
        folder: PathBuf,
    },
    /// The path is a file.
    #[error("{} is a file: give the folder of the sequence", path.display())]
    NotAFolder {
        /// The path as given.
        path: PathBuf,
    },
    /// The path is a file of another program.
    #[error("{} is {what}, which is not read: {remedy}", path.display())]
    ForeignFile {
        /// The path as given.
        path: PathBuf,
        /// What it is.
        what: &'static str,
        /// How to bring it in.
        remedy: String,
    },
    /// The folder has no entries.
    #[error("folder {} is empty: give the folder with the images and poses of a sequence", folder.display())]
    EmptyFolder {
        /// The path as given.
        folder: PathBuf,
    },
    /// The folder matches no known layout.
    #[error(
        "{} has no known layout; looked for {looked_for}; found {found}{hint}",
        folder.display()
    )]
    UnknownLayout {
        /// The path as given.
        folder: PathBuf,
        /// The files of each known layout.
        looked_for: String,
        /// The first entries of the folder.
        found: String,
        /// A suggested remedy, or empty.
        hint: String,
    },
    /// The layout name is unknown.
    #[error("unknown layout {name}: --layout takes one of {known}")]
    UnknownLayoutName {
        /// The name as given.
        name: String,
        /// The known names.
        known: String,
    },
    /// A file or folder cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Unreadable {
        /// The file or folder.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A line of a text file is invalid.
    #[error("{}, line {line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The problem and what is expected.
        problem: String,
    },
    /// A binary file is invalid.
    #[error("{}, byte {offset}: {problem}", path.display())]
    Byte {
        /// The file.
        path: PathBuf,
        /// Byte offset, from 0.
        offset: u64,
        /// The problem and what is expected.
        problem: String,
    },
    /// A file is invalid as a whole.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file or folder.
        path: PathBuf,
        /// The problem and what is expected.
        problem: String,
    },
    /// No frame has both an image and a pose.
    #[error("{}: no usable frame: {reason}", folder.display())]
    NoFrames {
        /// The path as given.
        folder: PathBuf,
        /// Why the frames were skipped.
        reason: String,
    },
    /// There are images and poses, but no image has a pose that can be used.
    #[error("{}: no usable frame: {reason}; where these poses are wrong, --track finds others from the images", path.display())]
    UnusablePoses {
        /// The folder, or the file with the poses.
        path: PathBuf,
        /// Why the poses were skipped.
        reason: String,
    },
    /// The calibration does not fit the first readable image.
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
        /// The operating system's error.
        source: std::io::Error,
    },
    /// The file is not a complete image.
    #[error("{} cannot be decoded: {reason} (copy or record the file again, or remove the frame)", path.display())]
    Undecodable {
        /// The image.
        path: PathBuf,
        /// The decoder's error.
        reason: String,
    },
    /// The image size differs from the calibrated size.
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
        /// Calibrated width.
        expected_width: u32,
        /// Calibrated height.
        expected_height: u32,
        /// Source of the calibrated size.
        expected_by: String,
        /// What to do.
        remedy: &'static str,
    },
    /// The principal point lies outside of the image.
    #[error(
        "{} is {width} x {height}, but the principal point ({cx}, {cy}) lies outside of it: \
         give intrinsics for this image size (--calibration FILE)",
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
    /// The focal length is far too short for the images.
    #[error(
        "the focal length of {focal:.3} pixels is too short for images of {width} x {height} pixels ({}): focal lengths and the principal point \
         are in pixels; normalised ones are multiplied by the width and the height",
        path.display()
    )]
    FocalLength {
        /// The first image.
        path: PathBuf,
        /// Its width in pixels.
        width: u32,
        /// Its height in pixels.
        height: u32,
        /// The mean focal length in pixels.
        focal: f64,
    },
    /// The depth image does not have one channel of 16 bits or of floating-point values.
    #[error(
        "{} has {found}; a depth image needs one channel of 16 bits, or of floating-point values in a TIFF, NPY, OpenEXR or PFM file: \
         give the original depth images, not 8-bit previews",
        path.display()
    )]
    DepthFormat {
        /// The image.
        path: PathBuf,
        /// Channels and bits of the image.
        found: String,
    },
    /// The depth image has integers and the first one of the sequence floating-point values, or the other way round.
    #[error(
        "{} has {found}, the first depth image of the sequence {expected}: \
         their units differ; write all depth images of a sequence with one type",
        path.display()
    )]
    DepthType {
        /// The image.
        path: PathBuf,
        /// Type of its values.
        found: &'static str,
        /// Type of the values of the first image.
        expected: &'static str,
    },
    /// A depth image has no image of standard deviations.
    #[error(
        "no image {}.* with the standard deviations of {}: write one for each depth image, or remove sigma from [depth] of linecarve.toml",
        stem.display(), depth.display()
    )]
    SigmaMissing {
        /// The depth image.
        depth: PathBuf,
        /// The path of the missing file without its extension.
        stem: PathBuf,
    },
}

impl FrameError {
    /// Whether only this frame is affected, so that a caller may skip it. Otherwise the sequence or its calibration is
    /// invalid.
    pub fn is_limited_to_frame(&self) -> bool {
        matches!(
            self,
            Self::Unreadable { .. } | Self::Undecodable { .. } | Self::SigmaMissing { .. }
        )
    }
}
