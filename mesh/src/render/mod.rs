//! Pictures of meshes and segments, drawn on the CPU: without driver or window, with the same bytes on every
//! machine.
//!
//! A [`View`] is a camera and image size. [`Renderer`] holds a mesh and [draws](Renderer::draw) it in passes over the
//! picture: first hits (`buffer`, `raster`), ambient occlusion (`occlusion`), shading (`shade`), outlines (`outline`), segments
//! with a depth test (`segments`). Colours come from the vertices, from a [function of the
//! position](Renderer::draw_colored), or are those of clay. Back faces, which are visible only through holes of a
//! closed surface, are tinted.

mod buffer;
mod heat;
mod lettering;
mod occlusion;
mod options;
mod outline;
mod picture;
mod raster;
mod segments;
mod shade;
mod view;

pub use heat::{HeatScale, with_caption, with_color_bar};
pub use lettering::{draw_text, text_width};
pub use options::{BackFaces, Background, RenderOptions, RenderOptionsError};
pub use picture::{PictureError, PointColors, Renderer, write_png};
pub use view::upright_rotation;
pub use view::{View, up_direction};

#[cfg(test)]
mod tests;
