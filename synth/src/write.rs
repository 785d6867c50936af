//! Writing of a rendered sequence.

use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ImageBuffer, ImageError, Luma, RgbImage};
use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;
use rayon::prelude::*;

use super::ground_truth::observed;
use super::noise::sensor_depth;
use super::options::{ColorFormat, DepthNoise, SequenceLayout, SynthOptions, SynthOptionsError};
use super::photo::FrameRenderer;
use super::scene::Scene;
use linecarve_mesh::files::{WriteError, write_atomically};
use linecarve_mesh::{MeshFileError, write_mesh_ply};

/// Time between two frames.
const FRAME_INTERVAL_US: u64 = 100_000;
/// Time of the first frame.
const START_US: u64 = 1_000_000;

/// Summary of a written sequence.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct SynthSummary {
    /// Number of frames.
    pub frames: u32,
    /// Triangles of the whole surface.
    pub triangles: usize,
    /// Share of the surface area visible in at least one frame.
    pub observed_share: f64,
    /// Share of the pixels with depth.
    pub depth_share: f64,
}

/// Why a sequence could not be written.
#[derive(Debug, thiserror::Error)]
pub enum SynthError {
    /// An option is out of its range.
    #[error(transparent)]
    Options(#[from] SynthOptionsError),
    /// The folder is not empty.
    #[error("{} is not empty: name a new folder or empty this one, so that no frame of another sequence remains in it", folder.display())]
    NotEmpty {
        /// The folder.
        folder: PathBuf,
    },
    /// The folder cannot be made or read.
    #[error("cannot use folder {}: {source} (check that it may be written)", folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// An image could not be encoded.
    #[error("cannot encode {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Error of the encoder.
        source: ImageError,
    },
    /// A file could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A mesh could not be written.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
}

/// Renders a scene to `out`, which must be empty or not exist: images, poses, calibration in the layout of the options;
/// `ground-truth.ply`, the whole surface; `ground-truth-observed.ply`, what the frames see of it; a README.
///
/// Frames are rendered in parallel; the bytes do not depend on the number of threads. `progress` is called with frames
/// done and frames to do, from any thread.
///
/// # Errors
/// When an option is out of range, the folder is not empty, or something cannot be written; what was written so far
/// remains.
pub fn write_sequence(
    options: &SynthOptions,
    out: &Path,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<SynthSummary, SynthError> {
    write_selected(options, out, &|_| true, progress)
}

/// [`write_sequence`] that leaves out the images of frames that are not selected.
pub(super) fn write_selected(
    options: &SynthOptions,
    out: &Path,
    is_selected: &(dyn Fn(usize) -> bool + Sync),
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<SynthSummary, SynthError> {
    options.validate()?;
    let files = Files::new(options, out);
    files.make_folders()?;
    let scene = Scene::new(options.scene);
    let camera = options.camera()?;
    let poses = scene.poses(options.frames, options.seed);
    let photographer = FrameRenderer::new(&scene, &camera, options.width, options.height);

    let done = AtomicUsize::new(0);
    let with_depth: Vec<u64> = poses
        .par_iter()
        .enumerate()
        .filter(|(frame, _)| is_selected(*frame))
        .map(|(frame, pose)| {
            let valid = write_frame(&photographer, options, &files, frame, pose)?;
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, poses.len());
            Ok(valid)
        })
        .collect::<Result<_, SynthError>>()?;

    files.write_lists(&poses, &camera)?;
    let mesh = scene.mesh();
    write_mesh_ply(&out.join("ground-truth.ply"), &mesh)?;
    let size = (options.width, options.height);
    let observed = observed(&scene, photographer.ray_scene(), &camera, size, &poses);
    write_mesh_ply(&out.join("ground-truth-observed.ply"), &observed.mesh)?;
    let pixels = u64::from(options.width) * u64::from(options.height) * poses.len() as u64;
    let summary = SynthSummary {
        frames: options.frames,
        triangles: mesh.triangles.len(),
        observed_share: observed.share,
        depth_share: with_depth.iter().sum::<u64>() as f64 / pixels as f64,
    };
    write_text(
        &out.join("README.md"),
        &readme(options, &scene, &camera, &summary),
    )?;
    Ok(summary)
}

/// Writes the images of one frame; returns how many pixels have depth.
fn write_frame(
    photographer: &FrameRenderer<'_>,
    options: &SynthOptions,
    files: &Files<'_>,
    frame: usize,
    pose: &Isometry3<f64>,
) -> Result<u64, SynthError> {
    let photo = photographer.render(pose);
    let number = frame as u64;
    let along = frame as f64 / f64::from(options.frames);
    let gain = 1.0 + options.exposure_change * (std::f64::consts::TAU * 2.0 * along).sin();
    let color = photo.color_image(gain, options.color_noise, options.seed, number);
    write_color(&files.color(frame), &color, options.color)?;

    let measured = match options.noise {
        DepthNoise::Exact => photo.depth,
        DepthNoise::Kinect { strength } => sensor_depth(&photo, strength, options.seed, number),
    };
    let scale = options.layout.depth_scale();
    let mut valid = 0;
    let raw: Vec<u16> = measured
        .into_iter()
        .map(|depth| {
            let raw = depth.map_or(0.0, |depth| (depth * scale).round());
            // 65535 means unknown in some layouts.
            let raw = if raw < 65535.0 { raw as u16 } else { 0 };
            valid += u64::from(raw != 0);
            raw
        })
        .collect();
    let image = ImageBuffer::<Luma<u16>, _>::from_raw(options.width, options.height, raw)
        .expect("one value a pixel");
    write_png(&files.depth(frame), &DynamicImage::ImageLuma16(image))?;
    if options.layout == SequenceLayout::SevenScenes {
        write_text(&files.name(frame, "pose.txt"), &matrix_text(pose))?;
    }
    Ok(valid)
}

fn write_color(path: &Path, picture: &RgbImage, format: ColorFormat) -> Result<(), SynthError> {
    match format {
        ColorFormat::Png => write_png(path, &DynamicImage::ImageRgb8(picture.clone())),
        ColorFormat::Jpeg { quality } => {
            let mut bytes = Vec::new();
            JpegEncoder::new_with_quality(&mut bytes, quality)
                .encode_image(picture)
                .map_err(|source| SynthError::Encode {
                    path: path.to_owned(),
                    source,
                })?;
            Ok(write_atomically(path, |out| out.write_all(&bytes))?)
        }
    }
}

fn write_png(path: &Path, picture: &DynamicImage) -> Result<(), SynthError> {
    let mut bytes = Cursor::new(Vec::new());
    let encoder =
        PngEncoder::new_with_quality(&mut bytes, CompressionType::Best, FilterType::Adaptive);
    picture
        .write_with_encoder(encoder)
        .map_err(|source| SynthError::Encode {
            path: path.to_owned(),
            source,
        })?;
    Ok(write_atomically(path, |out| {
        out.write_all(bytes.get_ref())
    })?)
}

fn write_text(path: &Path, text: &str) -> Result<(), SynthError> {
    Ok(write_atomically(path, |out| {
        out.write_all(text.as_bytes())
    })?)
}

/// File paths by layout.
struct Files<'a> {
    out: &'a Path,
    layout: SequenceLayout,
    extension: &'static str,
}

impl<'a> Files<'a> {
    fn new(options: &SynthOptions, out: &'a Path) -> Self {
        Self {
            out,
            layout: options.layout,
            extension: match options.color {
                ColorFormat::Png => "png",
                ColorFormat::Jpeg { .. } => "jpg",
            },
        }
    }

    fn folders(&self) -> &'static [&'static str] {
        match self.layout {
            SequenceLayout::Tum => &["rgb", "depth"],
            SequenceLayout::SevenScenes => &[],
            SequenceLayout::Open3d => &["image", "depth"],
        }
    }

    fn make_folders(&self) -> Result<(), SynthError> {
        let failed = |folder: &Path| {
            let folder = folder.to_owned();
            |source| SynthError::Folder { folder, source }
        };
        make_folder(self.out)?;
        for name in self.folders() {
            let folder = self.out.join(name);
            std::fs::create_dir(&folder).map_err(failed(&folder))?;
        }
        Ok(())
    }

    /// A file of a frame in the layout of 7-Scenes.
    fn name(&self, frame: usize, ending: &str) -> PathBuf {
        self.out.join(format!("frame-{frame:06}.{ending}"))
    }

    fn color(&self, frame: usize) -> PathBuf {
        let extension = self.extension;
        match self.layout {
            SequenceLayout::Tum => self.out.join(format!("rgb/{}.{extension}", stamp(frame))),
            SequenceLayout::SevenScenes => self.name(frame, &format!("color.{extension}")),
            SequenceLayout::Open3d => self.out.join(format!("image/{frame:05}.{extension}")),
        }
    }

    fn depth(&self, frame: usize) -> PathBuf {
        match self.layout {
            SequenceLayout::Tum => self.out.join(format!("depth/{}.png", stamp(frame))),
            SequenceLayout::SevenScenes => self.name(frame, "depth.png"),
            SequenceLayout::Open3d => self.out.join(format!("depth/{frame:05}.png")),
        }
    }

    /// Lists of images and poses, and the calibration.
    fn write_lists(&self, poses: &[Isometry3<f64>], camera: &Camera) -> Result<(), SynthError> {
        match self.layout {
            SequenceLayout::Tum => {
                let list = |folder: &str, extension: &str| {
                    let mut text = String::from("# timestamp filename\n");
                    for frame in 0..poses.len() {
                        let stamp = stamp(frame);
                        text += &format!("{stamp} {folder}/{stamp}.{extension}\n");
                    }
                    text
                };
                write_text(&self.out.join("rgb.txt"), &list("rgb", self.extension))?;
                write_text(&self.out.join("depth.txt"), &list("depth", "png"))?;
                let mut text = String::from("# timestamp tx ty tz qx qy qz qw\n");
                for (frame, pose) in poses.iter().enumerate() {
                    let (t, q) = (pose.translation.vector, pose.rotation.coords);
                    text += &stamp(frame);
                    for value in [t.x, t.y, t.z, q.x, q.y, q.z, q.w] {
                        text += &format!(" {value:.10}");
                    }
                    text.push('\n');
                }
                write_text(&self.out.join("groundtruth.txt"), &text)?;
            }
            SequenceLayout::SevenScenes => {
                let text = format!(
                    "{} 0 {}\n0 {} {}\n0 0 1\n",
                    camera.fx(),
                    camera.cx(),
                    camera.fy(),
                    camera.cy()
                );
                write_text(&self.out.join("camera-intrinsics.txt"), &text)?;
            }
            SequenceLayout::Open3d => {
                let mut text = String::new();
                for (frame, pose) in poses.iter().enumerate() {
                    text += &format!("{frame} {frame} {}\n{}", frame + 1, matrix_text(pose));
                }
                write_text(&self.out.join("trajectory.log"), &text)?;
            }
        }
        let scale = self.layout.depth_scale();
        let text = format!(
            "[color]\nmodel = \"pinhole\"\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\n\n[depth]\nscale = {scale:?}\n",
            camera.fx(),
            camera.fy(),
            camera.cx(),
            camera.cy()
        );
        write_text(&self.out.join("linecarve.toml"), &text)
    }
}

/// Time stamp of a frame in seconds.
fn stamp(frame: usize) -> String {
    let us = START_US + FRAME_INTERVAL_US * frame as u64;
    format!("{}.{:06}", us / 1_000_000, us % 1_000_000)
}

/// The 4x4 matrix of a pose, row by row.
fn matrix_text(pose: &Isometry3<f64>) -> String {
    let matrix = pose.to_homogeneous();
    let mut text = String::new();
    for row in matrix.row_iter() {
        let values: Vec<String> = row.iter().map(|value| format!("{value:.12}")).collect();
        text += &values.join(" ");
        text.push('\n');
    }
    text
}

fn readme(
    options: &SynthOptions,
    scene: &Scene,
    camera: &Camera,
    summary: &SynthSummary,
) -> String {
    let depth = match options.noise {
        DepthNoise::Exact => "exact, through the centre of each pixel".to_owned(),
        DepthNoise::Kinect { strength } => {
            format!("with the noise of a structured-light sensor, strength {strength}")
        }
    };
    format!(
        "# {title}\n\n\
         A rendered sequence. It was made, and can be made again byte for byte, by\n\n    \
         {command}\n\n\
         - {frames} frames of {width} x {height} pixels, pinhole camera with focal length {focal} px.\n\
         - Poses are exact: metres, world from camera, the world with z up, the camera with x right, y down, z forward.\n\
         - Depth is {depth}, {scale} raw units a metre, registered to colour; 0 is unknown.\n\
         - `ground-truth.ply` is the whole surface: {triangles} triangles that face free space.\n\
         - `ground-truth-observed.ply` is what at least one frame sees of it: {share:.1} % of its area.\n",
        title = scene.title,
        command = options.command_line(),
        frames = options.frames,
        width = options.width,
        height = options.height,
        focal = camera.fx(),
        scale = options.layout.depth_scale(),
        triangles = summary.triangles,
        share = 100.0 * summary.observed_share,
    )
}

/// Makes a folder, which must be empty if it is there.
pub(super) fn make_folder(folder: &Path) -> Result<(), SynthError> {
    let failed = |source| SynthError::Folder {
        folder: folder.to_owned(),
        source,
    };
    std::fs::create_dir_all(folder).map_err(failed)?;
    let mut entries = std::fs::read_dir(folder).map_err(failed)?;
    match entries.next() {
        Some(_) => Err(SynthError::NotEmpty {
            folder: folder.to_owned(),
        }),
        None => Ok(()),
    }
}
