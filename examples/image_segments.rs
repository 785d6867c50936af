//! Finds the 3D line segments of one image of the sample sequence.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve_lines::{ExtractOptions, SegmentExtractor};
use linecarve_sequence::{OpenOptions, Sequence};

/// Standard deviation of a depth at `TYPICAL_DEPTH`, as a share of it.
const RELATIVE_NOISE: f64 = 0.003;
/// Typical depth of the scene, in metres.
const TYPICAL_DEPTH: f64 = 2.0;

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let sequence = Sequence::open(&folder, &OpenOptions::default())?;
    let calibration = sequence.depth_calibration().ok_or("no depth camera")?;
    let camera = sequence.color_camera();
    let (image, color) = sequence.load_gray_and_color(0)?;
    let depth = sequence.load_depth(0)?.ok_or("no depth image")?;

    let sensor = calibration.sensor(RELATIVE_NOISE, TYPICAL_DEPTH);
    let inverse_depth = sensor.inverse_depth(&depth, camera, image.width(), image.height())?;
    let mut extractor = SegmentExtractor::new(ExtractOptions::default())?;
    let extraction = extractor.extract(&image, Some(color.as_raw()), &inverse_depth, camera, 0)?;
    println!(
        "{} x {} pixels: {} edge chains, {} segments",
        image.width(),
        image.height(),
        extraction.chains,
        extraction.segments.len()
    );
    Ok(())
}
