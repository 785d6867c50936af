//! What a run keeps in its output folder so that it can go on after it was killed.
//!
//! Looking at images is what takes long and depends on nothing else: what it yields is stored, one file a keyframe, each
//! whole or absent. A resumed run reads what there is and computes the rest; everything after that runs again from the
//! beginning, so that its result is that of a run without interruption to the last byte. The folder goes when the run is
//! through.

mod store;

pub use store::{Checkpoint, CheckpointError, FOLDER};
