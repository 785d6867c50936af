//! Export of trajectories, COLMAP models, `transforms.json` and whole recordings for other programs.
//!
//! Numbers have enough digits to restore the same double, so that a round trip changes poses only by the rounding of the
//! conversion.

mod colmap;
mod posed;
mod recording;
mod trajectory;
mod transforms;

pub use colmap::{ColmapError, write_colmap};
pub use posed::{PosedImage, posed_images};
pub use recording::{
    Disturbance, RecordingError, RecordingLayout, WrongDepth, write_disturbed_recording,
    write_recording,
};
pub use trajectory::{TrajectoryFormat, write_trajectory};
pub use transforms::{TransformsError, write_transforms};
