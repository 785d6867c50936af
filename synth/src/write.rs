//! Writing of a rendered sequence.

use std::io::Cursor;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{DynamicImage, ImageBuffer, Luma, RgbImage};
use linecarve_lines::camera::Camera;
use linecarve_mesh::encode_jpeg;
use nalgebra::Isometry3;
use rayon::prelude::*;

use super::error::SynthError;
use super::files::{Files, matrix_text, write_text};
use super::ground_truth::observed;
use super::noise::sensor_depth;
use super::options::{ColorFormat, DepthNoise, SequenceLayout, SynthOptions};
use super::photo::{FrameRenderer, RenderedFrame};
use super::scene::Scene;
use super::trajectory::Motion;
use linecarve_mesh::files::write_unsynced;
use linecarve_mesh::write_mesh_ply;

/// Views of the scene that are averaged in a blurred image.
const BLUR_VIEWS: u32 = 8;

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
    let motion = scene.motion(options.frames, options.seed);
    let photographer = FrameRenderer::new(&scene, &camera, options.width, options.height);

    let done = AtomicUsize::new(0);
    let with_depth: Vec<u64> = poses
        .par_iter()
        .enumerate()
        .filter(|(frame, _)| is_selected(*frame))
        .map(|(frame, pose)| {
            let mut valid = 0;
            match options.stereo_baseline {
                Some(baseline) => {
                    write_pair(&photographer, options, &files, &motion, frame, baseline)?;
                }
                None => valid = write_frame(&photographer, options, &files, &motion, frame, pose)?,
            }
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

/// A frame as the shutter lets it through, of a camera at `left_from_camera`.
fn expose(
    photographer: &FrameRenderer<'_>,
    options: &SynthOptions,
    motion: &Motion,
    frame: usize,
    left_from_camera: Option<&Isometry3<f64>>,
) -> RenderedFrame {
    let height = f64::from(options.height);
    let view = |time: f64| {
        photographer.render_rows(&|row| {
            let readout = options.rolling_shutter * ((row as f64 + 0.5) / height - 0.5);
            let left = motion.at(time + readout);
            left_from_camera.map_or(left, |camera| left * camera)
        })
    };
    let middle = frame as f64;
    let mut photo = view(middle);
    if options.blur > 0.0 {
        photo.light.fill([0.0; 3]);
        for number in 0..BLUR_VIEWS {
            let share = (f64::from(number) + 0.5) / f64::from(BLUR_VIEWS) - 0.5;
            let part = view(middle + options.blur * share);
            for (sum, light) in photo.light.iter_mut().zip(part.light) {
                for (channel, one) in sum.iter_mut().zip(light) {
                    *channel += one / BLUR_VIEWS as f32;
                }
            }
        }
    }
    photo
}

/// Exposure of a frame.
fn gain(options: &SynthOptions, frame: usize) -> f64 {
    let along = frame as f64 / f64::from(options.frames);
    1.0 + options.exposure_change * (std::f64::consts::TAU * 2.0 * along).sin()
}

/// Writes the images of both cameras of one frame.
fn write_pair(
    photographer: &FrameRenderer<'_>,
    options: &SynthOptions,
    files: &Files<'_>,
    motion: &Motion,
    frame: usize,
    baseline: f64,
) -> Result<(), SynthError> {
    let right_camera = Isometry3::translation(baseline, 0.0, 0.0);
    let cameras = [
        (files.color(frame), None),
        (files.right(frame), Some(&right_camera)),
    ];
    for (side, (path, camera)) in cameras.into_iter().enumerate() {
        let photo = expose(photographer, options, motion, frame, camera);
        // Noise of its own for each camera.
        let seed = options.seed.wrapping_add(side as u64);
        let gain = gain(options, frame);
        let color = photo.color_image(gain, options.color_noise, seed, frame as u64);
        write_color(&path, &color, options.color)?;
    }
    Ok(())
}

/// Writes the images of one frame; returns how many pixels have depth.
fn write_frame(
    photographer: &FrameRenderer<'_>,
    options: &SynthOptions,
    files: &Files<'_>,
    motion: &Motion,
    frame: usize,
    pose: &Isometry3<f64>,
) -> Result<u64, SynthError> {
    let photo = expose(photographer, options, motion, frame, None);
    let number = frame as u64;
    let color = photo.color_image(
        gain(options, frame),
        options.color_noise,
        options.seed,
        number,
    );
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
            let bytes = encode_jpeg(picture, quality).map_err(|source| SynthError::Encode {
                path: path.to_owned(),
                source,
            })?;
            Ok(write_unsynced(path, |out| out.write_all(&bytes))?)
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
    Ok(write_unsynced(path, |out| out.write_all(bytes.get_ref()))?)
}

fn readme(
    options: &SynthOptions,
    scene: &Scene,
    camera: &Camera,
    summary: &SynthSummary,
) -> String {
    let measured = match options.noise {
        DepthNoise::Exact => "exact, through the centre of each pixel".to_owned(),
        DepthNoise::Kinect { strength } => {
            format!("with the noise of a structured-light sensor, strength {strength}")
        }
    };
    let depth = match options.stereo_baseline {
        Some(baseline) => {
            format!("- The right camera is {baseline:?} m to the right; there is no depth.")
        }
        None => format!(
            "- Depth is {measured}, {scale} raw units a metre, registered to colour; 0 is unknown.",
            scale = options.layout.depth_scale()
        ),
    };
    let mut shutter = String::new();
    if options.blur > 0.0 || options.rolling_shutter > 0.0 {
        shutter = format!(
            "- Exposure takes {:?} of the time between frames, the readout of the rows {:?}; poses are of the middle of both.\n",
            options.blur, options.rolling_shutter
        );
    }
    format!(
        "# {title}\n\n\
         A rendered sequence. It was made, and can be made again byte for byte, by\n\n    \
         {command}\n\n\
         - {frames} frames of {width} x {height} pixels, pinhole camera with focal length {focal} px.\n\
         - Poses are exact: metres, world from camera, the world with z up, the camera with x right, y down, z forward.\n\
         {shutter}{depth}\n\
         - `ground-truth.ply` is the whole surface: {triangles} triangles that face free space.\n\
         - `ground-truth-observed.ply` is what at least one frame sees of it: {share:.1} % of its area.\n",
        title = scene.title,
        command = options.command_line(),
        frames = options.frames,
        width = options.width,
        height = options.height,
        focal = camera.fx(),
        triangles = summary.triangles,
        share = 100.0 * summary.observed_share,
    )
}
