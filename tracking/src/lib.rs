#![doc = include_str!("../README.md")]

mod adjust;
mod camera;
mod dense;
mod finish;
mod first_map;
mod focal;
mod frame;
mod initialise;
mod interpolation;
mod local_adjustment;
mod localise;
mod loop_confirmation;
mod loops;
mod map;
mod mapping;
mod matching;
mod noise;
mod options;
mod patches;
mod places;
mod records;
mod saving;
mod separation;
mod smooth;
mod snapshot;
mod solve;
mod stereo;
mod submaps;
mod subpixel;
mod tracker;
mod verification;

pub use dense::layers::{
    DepthLayer, LayerAlignment, LayerModel, LayerPlacement, align_layers, compare_layers,
};
pub use finish::{FramePose, Submap, TrackedRecording};
pub use frame::{FrameDetector, FrameFeatures};
pub use options::{TrackingOptions, TrackingOptionsError};
pub use records::{Contradiction, FrameOutcome, LoopReport, MapCheck, NoPose, StageTimes};
pub use snapshot::MapSnapshot;
pub use tracker::Tracker;

#[cfg(test)]
mod tests;
