//! Finds the 3D line segments of one image of the sample recording, whose files it reads itself.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{DepthSensor, SensorNoise};
use linecarve_lines::image::{GrayImage, Plane};
use linecarve_lines::{ExtractOptions, SegmentExtractor};

/// Depth values a metre.
const DEPTH_SCALE: f32 = 5000.0;
/// Standard deviation of a depth at `TYPICAL_DEPTH`, as a share of it.
const RELATIVE_NOISE: f64 = 0.003;
/// Typical depth of the scene, in metres.
const TYPICAL_DEPTH: f64 = 2.0;

fn main() -> Result<(), Box<dyn Error>> {
    let room = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/room");
    let camera = Camera::pinhole(525.0, 525.0, 319.5, 239.5)?;
    let color = image::open(room.join("rgb/1.000000.jpg"))?.into_rgb8();
    let depth = image::open(room.join("depth/1.000000.png"))?.into_luma16();
    let (width, height) = (color.width() as usize, color.height() as usize);
    let gray = GrayImage::from_rgb8(width, height, color.as_raw())?;
    let depth = depth.iter().map(|&value| f32::from(value) / DEPTH_SCALE);
    let depth = Plane::new(width, height, depth.collect())?;

    let noise =
        SensorNoise::relative_at(RELATIVE_NOISE, TYPICAL_DEPTH, 1.0 / f64::from(DEPTH_SCALE));
    let sensor = DepthSensor::registered(&camera, noise);
    let inverse_depth = sensor.inverse_depth(&depth, &camera, width, height)?;
    let mut extractor = SegmentExtractor::new(ExtractOptions::default())?;
    let extraction = extractor.extract(&gray, Some(color.as_raw()), &inverse_depth, &camera, 0)?;
    let (chains, segments) = (extraction.chains, extraction.segments.len());
    println!("{width} x {height} pixels: {chains} edge chains, {segments} segments");
    Ok(())
}
