//! End-to-end tests of the commands: one binary, since each test binary links the whole program.

#![allow(clippy::unwrap_used, reason = "a failure in a helper fails the test")]

#[path = "../program/mod.rs"]
mod program;

mod bad_input;
mod browser;
mod compare;
mod convert;
mod depth_coverage;
mod depth_values;
mod diff;
mod evaluate;
mod faults;
mod floors;
mod folders;
mod growth;
mod image_size;
mod invariance;
mod killed;
mod live;
mod map_points;
mod mesh;
mod paper;
mod phones;
mod pictures;
mod reconstruct;
mod render;
mod report_page;
mod resume;
mod room_folders;
mod sample;
mod simplify;
mod stream;
mod stream_cameras;
mod stream_frames;
mod structure;
mod surface_keys;
mod texture;
mod tiles;
mod track;
mod unused_options;
mod upright;
mod users_files;
