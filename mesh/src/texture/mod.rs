//! Textures of meshes from posed photographs.
//!
//! [`texture_mesh`] gives every triangle the photograph that shows it best, and packs the photographs' parts into one
//! image:
//!
//! 1. `observe`: what each view sees of each triangle, by a depth buffer of the mesh itself: colour, gradient, pixels
//!    per area.
//! 2. `exposure`: one gain per view and channel, by least squares over the triangles that several views see.
//! 3. `quality`: resolution, angle, sharpness and agreement with the other views as one number.
//! 4. `label`: one view per triangle, with few changes between neighbours.
//! 5. `chart`, `pack`: connected triangles of one view become a chart, and charts an atlas.
//! 6. `level`: offsets at vertices that bring each view to the mean of all views, so that seams disappear.
//! 7. `fill`: colours of all texels; `spread`: of the texels between charts.
//!
//! Two of the steps read the photographs, one per thread at a time. The result does not depend on the number of threads.
//!
//! # Reference
//! M. Waechter, N. Moehrle, M. Goesele, "Let There Be Color! Large-Scale Texturing of 3D Reconstructions", ECCV 2014;
//! V. Lempitsky, D. Ivanov, "Seamless Mosaicing of Image-Based Texture Maps", CVPR 2007. *Differs from the papers:*
//! offsets at vertices are computed from the mean over all views, not solved for across seams; the depth buffer replaces
//! ray casts; no Poisson blending.

mod align;
mod chart;
mod depth_buffer;
mod encode;
mod exposure;
mod fill;
mod label;
mod level;
mod make;
mod observe;
mod pack;
mod photo;
mod quality;
mod spread;
mod types;

pub use align::{PhotoAlignment, align_photos};
pub use encode::{EncodedTexture, SplitMesh, TextureFormat};
pub use make::{TextureSummary, texture_mesh};
pub use photo::LoadPhoto;
pub use types::{Texture, TextureError, TextureOptions, TextureView};
