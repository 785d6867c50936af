//! Textures a mesh from images with known poses: the true mesh of the sample, from a few of its images.

#![allow(clippy::print_stdout, reason = "examples print their result")]

use std::error::Error;
use std::path::Path;

use linecarve::mesh::texture::{TextureFormat, TextureOptions, TextureView, texture_mesh};
use linecarve::mesh::{Geometry, GlbPart, GltfFrame, read_geometry, write_glb};
use linecarve::nalgebra::Vector3;
use linecarve::sequence::{OpenOptions, Sequence};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("assets/room");
    let mesh = read_geometry(&folder.join("ground-truth-observed.ply"))?.into_mesh();
    let sequence = Sequence::open(&folder, &OpenOptions::default())?;

    let frames = [0, 8, 16, 24];
    let views = frames.map(|frame: usize| TextureView {
        camera: sequence.color_camera().clone(),
        world_from_camera: sequence.frames()[frame].world_from_camera,
    });
    let load = |view: usize| sequence.load_color(frames[view]).ok();
    let (texture, summary) = texture_mesh(&mesh, &views, &load, &TextureOptions::default())
        .ok_or("no image shows the mesh")?;
    let texture = texture.encoded(TextureFormat::Jpeg)?;
    let part = GlbPart {
        name: "room",
        geometry: Geometry::Textured(&mesh, &texture),
        color: [214, 206, 192],
    };
    let path = std::env::temp_dir().join("linecarve-textured.glb");
    // The sample has z up.
    write_glb(
        &path,
        &[part],
        GltfFrame::upright(Vector3::zeros(), &Vector3::z()),
    )?;
    println!("{summary:?} in {}", path.display());
    Ok(())
}
