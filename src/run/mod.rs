//! What every run needs: checkpoint, cancellation, a bound on memory, progress, stage times.

mod cancel;
mod checkpoint;
mod memory;
mod progress;
mod times;

pub use cancel::{CancelToken, Cancelled, WatchError};
pub use checkpoint::{Checkpoint, CheckpointError, FOLDER as CHECKPOINT_FOLDER};
pub use memory::{MemoryLimit, held_mb, peak_mb};
pub use progress::{Progress, Verbosity};
pub use times::{StageTimes, milliseconds};
