//! Arguments of `synth`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use super::ranges::{number, whole};
use super::{LayoutChoice, SceneChoice, parse_size};

/// Arguments of `synth`.
#[derive(Debug, Args)]
pub struct SynthArgs {
    /// The scene.
    #[arg(value_enum, default_value_t = SceneChoice::Room)]
    pub scene: SceneChoice,

    /// Number of points of the city, which has no images and no frames: a dense model for `reconstruct --from map-points` and
    /// `tiles plan`, to be opened by its `fused.ply`.
    #[arg(long, value_name = "N", value_parser = whole::<usize>(1..=1_000_000_000), default_value_t = 100_000)]
    pub points: usize,

    /// Folder for the sequence and its ground truth; must be empty or missing.
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,

    /// Number of frames, spread evenly over the path.
    #[arg(long, value_name = "N", value_parser = whole::<u32>(1..=100_000), default_value_t = 36)]
    pub frames: u32,

    /// Image size.
    #[arg(long, value_name = "WxH", default_value = "640x480", value_parser = parse_size)]
    pub size: (u32, u32),

    /// Focal length in pixels; default: that of a 640 pixel wide image with 525.
    #[arg(long, value_name = "PIXELS", value_parser = number(1.0..=1e6))]
    pub focal: Option<f64>,

    /// Layout of the files.
    #[arg(long, value_enum, default_value_t = LayoutChoice::Tum)]
    pub layout: LayoutChoice,

    /// Quality of the colour images, which are JPEG, 1 to 100.
    #[arg(long, value_name = "QUALITY", value_parser = whole::<u8>(1..=100), default_value_t = 85)]
    pub jpeg_quality: u8,

    /// Write colour as PNG, without loss.
    #[arg(long, conflicts_with = "jpeg_quality")]
    pub png: bool,

    /// Errors of the depth camera.
    #[arg(long, value_enum, default_value_t = NoiseModel::None)]
    pub noise: NoiseModel,

    /// How strong those errors are; 1 is the sensor as modelled.
    #[arg(long, value_name = "FACTOR", value_parser = number(0.001..=10.0), default_value_t = 1.0)]
    pub noise_strength: f64,

    /// Standard deviation of the noise of colour images, in 8-bit steps.
    #[arg(long, value_name = "STEPS", value_parser = number(0.0..=64.0), default_value_t = 0.0)]
    pub color_noise: f64,

    /// Largest relative change of the exposure along the path.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=0.9), default_value_t = 0.0)]
    pub exposure_change: f64,

    /// Exposure time as a share of the time between frames: motion blur.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=1.0), default_value_t = 0.0)]
    pub blur: f64,

    /// Time from the first to the last row as a share of the time between frames; poses are those of the middle row.
    #[arg(long, value_name = "SHARE", value_parser = number(0.0..=1.0), default_value_t = 0.0)]
    pub rolling_shutter: f64,

    /// A right camera this many metres to the right, in place of depth: rectified pairs in the layout of KITTI odometry.
    #[arg(long, value_name = "METRES", value_parser = number(0.001..=10.0), conflicts_with_all = ["layout", "noise"])]
    pub stereo: Option<f64>,

    /// Seed of path and errors.
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
}

/// Errors of the depth camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum NoiseModel {
    /// Exact up to the resolution of the files.
    None,
    /// Structured light: disparity noise and steps, dropouts at edges, a largest range.
    Kinect,
}
