//! Reconstructs the sample sequence from a few keyframes.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve::{Input, Options, Reconstruction};

fn main() -> Result<(), Box<dyn Error>> {
    let mut input = Input::from(Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room"));
    input.selection.max_keyframes = Some(4);
    let mut reconstruction = Reconstruction::open(input, Options::default())?;
    let mut points = 0;
    while let Some(update) = reconstruction.advance()? {
        points += update.map.new_points;
    }
    let mesh = reconstruction.surface();
    println!(
        "{} keyframes: {points} points, {} segments; {} vertices, {} triangles",
        reconstruction.numbers().len(),
        reconstruction.segments().lines.len(),
        mesh.positions.len(),
        mesh.triangles.len()
    );
    Ok(())
}
