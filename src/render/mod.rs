//! Pictures of meshes and segments, ray-cast on the CPU: no driver, no window, the same bytes on every machine.
//!
//! A [`View`] says from where; [`Renderer`] holds a mesh ready for rays and [draws](Renderer::draw) it in passes, each
//! over the whole picture: first hits (`buffer`), how open the sky is above each of them (`occlusion`), light
//! (`shade`), outlines (`outline`), segments with a depth test (`segments`). Vertex colours are shown as they are,
//! errors coloured by vertex included; without colours the mesh looks like clay. Back faces, which a closed carved
//! surface only shows through its holes, are tinted.

mod buffer;
mod occlusion;
mod options;
mod outline;
mod picture;
mod segments;
mod shade;
mod view;

pub use options::{BackFaces, Background, RenderOptions, RenderOptionsError};
pub use picture::{PictureError, Renderer, write_png};
pub(crate) use view::upright_rotation;
pub use view::{View, up_direction};

#[cfg(test)]
mod tests;
