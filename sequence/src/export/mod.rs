//! Export of trajectories, COLMAP models and `transforms.json` for other programs.
//!
//! Numbers have enough digits to restore the same double, so that a round trip changes poses only by the rounding of the
//! conversion.

mod colmap;
mod posed;
mod trajectory;
mod transforms;

pub use colmap::{ColmapError, write_colmap};
pub use posed::{PosedImage, posed_images};
pub use trajectory::{TrajectoryFormat, write_trajectory};
pub use transforms::{TransformsError, write_transforms};
