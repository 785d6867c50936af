//! Services of a run: checkpoint, cancellation, memory limit, progress and stage times.

mod cancel;
mod checkpoint;
mod description;
mod memory;
mod progress;
mod times;

pub use cancel::{CancelToken, Cancelled, UnknownMemory};
pub(crate) use checkpoint::checksum;
pub use checkpoint::{Checkpoint, CheckpointError, FOLDER as CHECKPOINT_FOLDER};
pub use description::RunDescription;
pub use memory::{MemoryLimit, peak_mb, resident_mb, size_mb};
pub use progress::{ProgressHook, TaskState};
pub use times::{StageTimes, milliseconds};
