//! Incremental clustering of segments from many keyframes.

mod cells;
mod clusterer;
mod index;
mod options;
mod representative;

pub use clusterer::{Cluster, ClusterEvent, ClusterId, SegmentClusterer, SegmentId};
pub use options::{ClusterOptions, ClusterOptionsError};
pub use representative::WorldSegment;
