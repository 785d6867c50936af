//! Trajectories and maps for other programs: what [`crate::sequence`] reads, written again.
//!
//! Numbers are written with as many digits as it takes to read the same double again, so that a round trip changes poses by
//! rounding of the conversion alone.

mod colmap;
mod posed;
mod trajectory;
mod transforms;

pub use colmap::{ColmapError, write_colmap};
pub use posed::{PosedImage, posed_images};
pub use trajectory::{TrajectoryFormat, write_trajectory};
pub use transforms::{TransformsError, write_transforms};
