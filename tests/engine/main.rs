//! Tests of the library on whole sequences: pose correction, provisional depth, streaming without depth images.

#![allow(clippy::unwrap_used, reason = "a failure in a helper fails the test")]

#[path = "../program/mod.rs"]
mod program;

mod image_poses;
mod reconstruction;
mod refinement;
mod stream_images;
