//! Textures of meshes from posed photographs.
//!
//! [`texture_mesh`] lays every triangle out as the photograph that shows it best does, packs these parts into one image, and
//! fills it with the mean of the photographs. Their poses, and what is left of the distortion of their lens, are
//! [adjusted](align_photos) first. Then:
//!
//! 1. `observe`: what each view sees of each triangle, by a depth buffer of the mesh itself: colour, gradient, pixels
//!    per area.
//! 2. `exposure`: one gain per view and channel, by least squares over the triangles that several views see.
//! 3. `quality`: resolution, angle, sharpness and agreement with the other views as one number.
//! 4. `label`: one view per triangle, with few changes between neighbours.
//! 5. `chart`, `pack`: connected triangles of one view become a chart, and charts an atlas.
//! 6. `fill`: colours of all texels, means of all views weighted by quality, so that there are no seams; `spread`: of the
//!    texels between charts.
//!
//! Two of the steps read the photographs, one per thread at a time. The result does not depend on the number of threads.
//!
//! # Reference
//! M. Waechter, N. Moehrle, M. Goesele, "Let There Be Color! Large-Scale Texturing of 3D Reconstructions", ECCV 2014;
//! V. Lempitsky, D. Ivanov, "Seamless Mosaicing of Image-Based Texture Maps", CVPR 2007. *Differs from the papers:*
//! texels are means over views, so that seams need no levelling; the depth buffer replaces ray casts.

mod align;
mod chart;
mod depth_buffer;
mod distortion;
mod encode;
mod exposure;
mod fill;
mod label;
mod make;
mod observe;
mod pack;
mod photo;
mod quality;
mod spread;
mod types;

pub use align::{PhotoAlignment, align_photos};
pub use distortion::DistortionGrid;
pub use encode::{EncodedTexture, SplitMesh, TextureFormat};
pub use make::{TextureSummary, texture_mesh};
pub use photo::LoadPhoto;
pub use types::{Texture, TextureError, TextureOptions, TextureView};
