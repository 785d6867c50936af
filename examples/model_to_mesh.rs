//! Makes a mesh from the points of a COLMAP model: `cargo run --example model_to_mesh -- MODEL MESH.ply`. Without arguments it
//! takes a small model of a box.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::fmt::Write;
use std::path::{Path, PathBuf};

use linecarve::mesh::write_mesh_ply;
use linecarve::{Input, Options, Reconstruction, SourceChoice};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args_os().skip(1).map(PathBuf::from);
    let temporary = std::env::temp_dir().join("linecarve-model-to-mesh");
    let model = match arguments.next() {
        Some(model) => model,
        None => {
            write_box(&temporary)?;
            temporary.clone()
        }
    };
    let output = arguments.next().unwrap_or(temporary.join("mesh.ply"));

    let mut input = Input::from(&model);
    input.source = SourceChoice::MapPoints;
    let mut reconstruction = Reconstruction::open(input, Options::default())?;
    while reconstruction.advance()?.is_some() {}
    let mesh = reconstruction.surface();
    write_mesh_ply(&output, &mesh)?;
    println!("{} triangles in {}", mesh.triangles.len(), output.display());
    Ok(())
}

/// Writes a model in text form: four cameras that see a box before a wall.
fn write_box(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)?;
    std::fs::write(
        folder.join("cameras.txt"),
        "1 PINHOLE 640 480 400 400 320 240\n",
    )?;
    let (mut images, mut points) = (String::new(), String::new());
    for view in 1..=4 {
        // Cameras look along z; translations are those of `camera_from_world`.
        let (x, y) = (0.4 * f64::from(view) - 1.0, 0.2 * f64::from(view % 2));
        let _ = writeln!(images, "{view} 1 0 0 0 {x} {y} 4 1 {view}.png\n");
    }
    // The front of a box, and the wall behind it where all cameras see it.
    let grid = (-5..=5).flat_map(|a| (-5..=5).map(move |b| [a, b].map(|n| 0.3 * f64::from(n))));
    let seen = grid.filter_map(|[a, b]| match a.abs().max(b.abs()) {
        near if near < 0.7 => Some([a, b, 0.5]),
        far if far > 1.1 => Some([a, b, 1.5]),
        _ => None,
    });
    for (id, [x, y, z]) in seen.enumerate() {
        let _ = writeln!(points, "{id} {x} {y} {z} 180 170 160 0.5 1 0 2 0 3 0 4 0");
    }
    std::fs::write(folder.join("images.txt"), images)?;
    std::fs::write(folder.join("points3D.txt"), points)
}
