//! Pictures of meshes and segments, ray-cast on the CPU: no driver, no window, the same bytes on every machine.
//!
//! A [`View`] says from where; [`Renderer`] holds a mesh ready for rays and [draws](Renderer::draw) it in passes, each
//! over the whole picture: first hits (`buffer`), how open the sky is above each of them (`occlusion`), light
//! (`shade`), outlines (`outline`), segments with a depth test (`segments`). Vertex colours are shown as they are,
//! errors coloured by vertex included, or any place has the colour that it is [painted](Renderer::draw_colored) in; without colours the mesh looks like clay. Back faces, which a closed carved
//! surface only shows through its holes, are tinted.

mod buffer;
mod heat;
mod lettering;
mod occlusion;
mod options;
mod outline;
mod picture;
mod segments;
mod shade;
mod view;

pub use heat::{HeatScale, with_caption, with_color_bar};
pub use lettering::{draw_text, text_width};
pub use options::{BackFaces, Background, RenderOptions, RenderOptionsError};
pub use picture::{PictureError, PointColor, Renderer, write_png};
pub use view::upright_rotation;
pub use view::{View, up_direction};

#[cfg(test)]
mod tests;
