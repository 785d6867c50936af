//! Reconstructs the sample sequence from a few keyframes.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve::{Input, Options, Reconstruction};

fn main() -> Result<(), Box<dyn Error>> {
    let mut input = Input::from(Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room"));
    input.selection.max_keyframes = Some(4);
    let mut reconstruction = Reconstruction::open(input, Options::default())?;
    while let Some(update) = reconstruction.advance()? {
        println!(
            "keyframe {}: {} new points, {} triangles added or removed",
            update.number,
            update.map.new_points,
            update.map.changed_triangles()
        );
    }
    let mesh = reconstruction.surface();
    println!(
        "{} segments; {} vertices, {} triangles",
        reconstruction.segments().lines.len(),
        mesh.positions.len(),
        mesh.triangles.len()
    );
    Ok(())
}
