//! What all writers of recordings take from a sequence, and how they write files.

use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};

use image::codecs::png::PngEncoder;
use image::{DynamicImage, ImageBuffer, ImageFormat, Luma};
use linecarve_lines::camera::Camera;
use linecarve_mesh::files::write_unsynced;
use nalgebra::Isometry3;

use super::{Disturbance, RecordingError};
use crate::load::DepthImage;
use crate::{DepthValues, ImageSize, Sequence, container};

/// Nanoseconds between frames of sequences without times.
const INTERVAL_NS: i64 = 100_000_000;

/// A sequence and the folder to write to.
pub(super) struct Source<'a> {
    sequence: &'a Sequence,
    out: &'a Path,
    disturbance: &'a Disturbance,
    poses: Vec<Isometry3<f64>>,
    /// Camera of the depth images.
    pub(super) depth_camera: Camera,
    /// Raw units of depth per pose unit: those of the sequence, where its values are depth.
    pub(super) depth_scale: f64,
}

/// An encoded colour image.
pub(super) struct Picture {
    pub(super) bytes: Vec<u8>,
    pub(super) extension: &'static str,
}

impl<'a> Source<'a> {
    /// Checks the sequence, and makes the folder.
    pub(super) fn new(
        sequence: &'a Sequence,
        out: &'a Path,
        disturbance: &'a Disturbance,
    ) -> Result<Self, RecordingError> {
        let frames = sequence.frames().iter().enumerate();
        let poses = frames
            .map(|(at, frame)| frame.world_from_camera * disturbance.of_frame(at).motion)
            .collect();
        let content = |problem: &str| RecordingError::Content {
            folder: sequence.folder().to_owned(),
            problem: problem.to_owned(),
        };
        let depth = sequence
            .depth_calibration()
            .ok_or_else(|| content("has no depth images, and this layout is of recordings with depth: write --to transforms or --to tum"))?;
        if !depth.registered && !sequence.depth_has_color_view {
            return Err(content(
                "has a depth camera apart from the colour camera, which this layout cannot say: register depth to colour first",
            ));
        }
        let source = Self {
            sequence,
            out,
            disturbance,
            poses,
            depth_camera: depth.camera.clone(),
            depth_scale: match depth.values {
                DepthValues::Depth => depth.scale,
                DepthValues::InverseDepth | DepthValues::Distance => 1000.0,
            },
        };
        source.make_folder("")?;
        let failed = |source| RecordingError::Folder {
            folder: out.to_owned(),
            source,
        };
        match std::fs::read_dir(out).map_err(failed)?.next() {
            Some(_) => Err(RecordingError::NotEmpty {
                folder: out.to_owned(),
            }),
            None => Ok(source),
        }
    }

    /// Number of frames.
    pub(super) fn count(&self) -> usize {
        self.sequence.frames().len()
    }

    pub(super) fn pose(&self, index: usize) -> &Isometry3<f64> {
        &self.poses[index]
    }

    /// Camera of the colour images.
    pub(super) fn camera(&self) -> &Camera {
        self.sequence.color_camera()
    }

    pub(super) fn size(&self) -> ImageSize {
        self.sequence.color_size()
    }

    /// Time of a frame in nanoseconds.
    pub(super) fn time_ns(&self, index: usize) -> i64 {
        match self.sequence.has_time() {
            true => self.sequence.frames()[index].timestamp_ns,
            false => INTERVAL_NS * (index as i64 + 10),
        }
    }

    /// Size of the depth images.
    pub(super) fn depth_size(&self) -> ImageSize {
        match self.sequence.depth_has_color_view {
            true => self.sequence.stored_depth_size.unwrap_or(self.size()),
            false => self.size(),
        }
    }

    /// The colour image of a frame: its file where that is a JPEG or PNG without lens distortion, else a PNG.
    pub(super) fn picture(&self, index: usize) -> Result<Picture, RecordingError> {
        let sequence = self.sequence;
        let stored = sequence.stored_color_camera();
        let is_as_loaded = stored.is_pinhole()
            && sequence.stored_camera(index) == stored
            && sequence.stored_size(index) == sequence.color_size();
        if is_as_loaded {
            let bytes = container::read(&sequence.frames()[index].color).unwrap_or_default();
            match image::guess_format(&bytes) {
                Ok(ImageFormat::Jpeg) => {
                    return Ok(Picture {
                        bytes,
                        extension: "jpg",
                    });
                }
                Ok(ImageFormat::Png) => {
                    return Ok(Picture {
                        bytes,
                        extension: "png",
                    });
                }
                _ => {}
            }
        }
        let bytes = self.png(index, &sequence.load_color(index)?.into())?;
        Ok(Picture {
            bytes,
            extension: "png",
        })
    }

    /// Writes the colour image of a frame under a name without extension; returns its extension.
    pub(super) fn write_picture(
        &self,
        index: usize,
        stem: &str,
    ) -> Result<&'static str, RecordingError> {
        let Picture { bytes, extension } = self.picture(index)?;
        self.write(&format!("{stem}.{extension}"), &bytes)?;
        Ok(extension)
    }

    /// The pixels of the colour image of a frame.
    pub(super) fn pixels(&self, index: usize) -> Result<Vec<u8>, RecordingError> {
        Ok(self.sequence.load_color(index)?.into_raw())
    }

    /// Depth of a frame in pose units, 0 where unknown; none known if the frame has no image.
    pub(super) fn depth(&self, index: usize) -> Result<DepthImage, RecordingError> {
        let ImageSize { width, height } = self.depth_size();
        let unknown = || {
            let samples = vec![0.0; width as usize * height as usize];
            DepthImage::new(width as usize, height as usize, samples).expect("one value a pixel")
        };
        let mut depth = self.sequence.load_depth(index)?.unwrap_or_else(unknown);
        self.disturbance.of_frame(index).apply(&mut depth);
        Ok(depth)
    }

    /// The class of confidence of each depth of a frame, if there are any.
    pub(super) fn confidence(&self, index: usize) -> Option<Vec<u8>> {
        let ImageSize { width, height } = self.depth_size();
        let (width, height) = (width as usize, height as usize);
        let unknown = DepthImage::new(width, height, vec![0.0; width * height]);
        let mut depth = unknown.expect("one value a pixel");
        self.disturbance.of_frame(index).apply(&mut depth)
    }

    /// Writes the classes of confidence of a frame as a PNG, if it has any.
    pub(super) fn write_confidence_png(
        &self,
        index: usize,
        name: &str,
    ) -> Result<(), RecordingError> {
        let ImageSize { width, height } = self.depth_size();
        let Some(classes) = self.confidence(index) else {
            return Ok(());
        };
        self.make_folder("confidence")?;
        let image = ImageBuffer::<Luma<u8>, _>::from_raw(width, height, classes)
            .expect("one class a pixel");
        self.write(name, &self.png(index, &DynamicImage::ImageLuma8(image))?)
    }

    /// Writes depth of a frame as a PNG of integers, `scale` of them a pose unit.
    pub(super) fn write_depth_png(
        &self,
        index: usize,
        scale: f64,
        name: &str,
    ) -> Result<(), RecordingError> {
        let depth = self.depth(index)?;
        let raw = depth.samples().iter().map(|&depth| {
            let raw = (f64::from(depth) * scale).round();
            // 65535 means unknown in some layouts.
            if raw < 65535.0 { raw as u16 } else { 0 }
        });
        let (width, height) = (depth.width() as u32, depth.height() as u32);
        let image = ImageBuffer::<Luma<u16>, _>::from_raw(width, height, raw.collect())
            .expect("one value a pixel");
        self.write(name, &self.png(index, &DynamicImage::ImageLuma16(image))?)
    }

    fn png(&self, index: usize, image: &DynamicImage) -> Result<Vec<u8>, RecordingError> {
        let mut bytes = Cursor::new(Vec::new());
        image
            .write_with_encoder(PngEncoder::new(&mut bytes))
            .map_err(|error| self.encode_error(index, error))?;
        Ok(bytes.into_inner())
    }

    pub(super) fn encode_error(&self, index: usize, error: impl ToString) -> RecordingError {
        RecordingError::Encode {
            frame: self.sequence.frames()[index].name.clone(),
            problem: error.to_string(),
        }
    }

    /// Path of a file to write.
    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.out.join(name)
    }

    pub(super) fn make_folder(&self, name: &str) -> Result<(), RecordingError> {
        let folder = self.out.join(name);
        std::fs::create_dir_all(&folder).map_err(|source| RecordingError::Folder { folder, source })
    }

    pub(super) fn write(&self, name: &str, bytes: &[u8]) -> Result<(), RecordingError> {
        Ok(write_unsynced(&self.path(name), |out| {
            out.write_all(bytes)
        })?)
    }

    /// Writes a file piece by piece; errors of pieces are returned as they are.
    pub(super) fn write_with(
        &self,
        name: &str,
        fill: impl FnOnce(&mut dyn Write) -> Result<(), Failure>,
    ) -> Result<(), RecordingError> {
        let mut failed = None;
        let outcome = write_unsynced(&self.path(name), |out| match fill(out) {
            Ok(()) => Ok(()),
            Err(Failure::Io(error)) => Err(error),
            Err(Failure::Recording(error)) => {
                failed = Some(error);
                Err(std::io::Error::other("a frame cannot be written"))
            }
        });
        match failed {
            Some(error) => Err(error),
            None => Ok(outcome?),
        }
    }
}

/// Why a piece of a file cannot be written.
pub(super) enum Failure {
    Io(std::io::Error),
    Recording(RecordingError),
}

impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        Self::Io(error)
    }
}

impl From<zip::result::ZipError> for Failure {
    fn from(error: zip::result::ZipError) -> Self {
        Self::Io(error.into())
    }
}

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Self {
        Self::Recording(error)
    }
}

/// `fx fy cx cy` of a camera.
pub(super) fn intrinsics(camera: &Camera) -> [f64; 4] {
    [camera.fx(), camera.fy(), camera.cx(), camera.cy()]
}

/// The rows of the matrix of a pose.
pub(super) fn matrix_rows(pose: &Isometry3<f64>) -> [[f64; 4]; 4] {
    let matrix = pose.to_homogeneous();
    [0, 1, 2, 3].map(|row| [0, 1, 2, 3].map(|column| matrix[(row, column)]))
}

/// Numbers with blanks between them, with all their digits.
pub(super) fn joined(numbers: &[f64]) -> String {
    let texts: Vec<String> = numbers.iter().map(f64::to_string).collect();
    texts.join(" ")
}

/// The matrix of a pose, a row a line.
pub(super) fn matrix_text(pose: &Isometry3<f64>) -> String {
    let lines = matrix_rows(pose).map(|row| joined(&row) + "\n");
    lines.concat()
}

/// Nanoseconds as seconds with all their digits.
pub(super) fn seconds(time_ns: i64) -> String {
    crate::warning::stamp_text(time_ns)
}
