//! Fewer triangles for the same surface: patches that are nearly plane are triangulated anew from their borders alone.
//!
//! 1. **Regions** (`regions`): every triangle joins a region whose vertices all lie near one plane, which it faces.
//! 2. **Borders** (`borders`): the lines between regions, from junction to junction, lose the vertices that they do not
//!    need. Feature edges are such borders. Both sides use the same border, so that nothing tears.
//! 3. **Patches** (`patch`): each region is triangulated anew between its borders by a constrained Delaunay triangulation
//!    in its plane; its inner vertices go.
//!
//! A region whose new border crosses itself in the plane gets its full border back, and if that does not help its
//! triangles stay as they were: the surface stays as closed, and hangs together, as it did.

mod borders;
mod edges;
mod options;
mod patch;
mod reduce;
mod regions;

pub use options::{SimplifyOptions, SimplifyOptionsError};
pub use reduce::{Simplified, simplify};
