//! Tests of the library on whole sequences: pose correction, provisional depth, corrections and streams.

#![allow(clippy::unwrap_used, reason = "a failure in a helper fails the test")]

#[path = "../program/mod.rs"]
mod program;

mod image_poses;
mod reconstruction;
mod refinement;
mod stream_cameras;
mod stream_corrections;
mod stream_images;
mod stream_messages;
mod stream_tracking;
mod track_resume;
