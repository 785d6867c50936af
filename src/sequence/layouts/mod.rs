//! One file for each layout.

pub(super) mod open3d_log;
pub(super) mod seven_scenes;
pub(super) mod tum;
