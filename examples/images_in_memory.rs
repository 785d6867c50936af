//! Makes a surface from images, depth and poses that are in memory, here those of the sample.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve::front_end::median_depth;
use linecarve::sequence::{OpenOptions, Sequence};
use linecarve::{ImageReconstruction, Options, RgbdImage};

fn main() -> Result<(), Box<dyn Error>> {
    // Stands for a program that has images, depth in metres, poses and a camera from elsewhere.
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let sequence = Sequence::open(&folder, &OpenOptions::default())?;
    let camera = sequence.color_camera();
    let depth_of = |frame| -> Result<_, Box<dyn Error>> {
        let depth = sequence.load_depth(frame)?;
        depth.ok_or("no depth image".into())
    };

    let typical = median_depth(&depth_of(0)?).ok_or("no depth in the first image")?;
    let mut room = ImageReconstruction::new(camera, typical, Options::default())?;
    for frame in [0, 8, 16, 24] {
        let update = room.add(&RgbdImage {
            world_from_camera: sequence.frames()[frame].world_from_camera,
            color: &sequence.load_color(frame)?,
            depth: &depth_of(frame)?,
        })?;
        println!("image {frame}: {} new points", update.new_points);
    }
    let mesh = room.finish()?;
    let (vertices, triangles) = (mesh.positions.len(), mesh.triangles.len());
    println!("{vertices} vertices, {triangles} triangles");
    Ok(())
}
