//! Tests of readers, writers and inspection: each layout, each kind of bad input, damaged files, and recorded data.
// The lint exempts test functions only, and helpers are outside of these.
#![allow(clippy::unwrap_used)]

mod copied_folders;
mod damage;
mod export;
mod faults;
mod float_depth;
mod folder_writers;
mod folders;
mod geometry_files;
mod layouts;
mod loose_folders;
mod models;
mod mutated;
mod phone_faults;
mod phone_layouts;
mod recorded;
mod recorded_export;
mod stereo;
mod support;
mod trajectories;
mod unusable;
mod writers;

use std::path::Path;

use linecarve_sequence::{OpenOptions, Sequence};
use support::{write_open3d, write_seven_scenes, write_tum};
use writers::{
    write_colmap_binary, write_colmap_text, write_euroc, write_kitti, write_mvs, write_nvm,
    write_orb_slam, write_pose_list, write_stella, write_transforms,
};

pub(crate) fn open(folder: &Path) -> Result<Sequence, String> {
    Sequence::open(folder, &OpenOptions::default()).map_err(|error| error.to_string())
}

pub(crate) fn folder_with(write: impl FnOnce(&Path)) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path());
    folder
}

pub(crate) fn warnings(sequence: &Sequence) -> String {
    sequence
        .warnings()
        .iter()
        .map(|w| format!("{w}\n"))
        .collect()
}

pub(crate) fn edit(path: &Path, change: impl FnOnce(String) -> String) {
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::write(path, change(text)).unwrap();
}

pub(crate) fn replace(path: &Path, from: &str, to: &str) {
    edit(path, |text| {
        assert!(text.contains(from), "{text}");
        text.replacen(from, to, 1)
    });
}

/// Replaces line `number`, from 1.
pub(crate) fn replace_line(path: &Path, number: usize, to: &str) {
    edit(path, |text| {
        let mut lines: Vec<&str> = text.lines().collect();
        lines[number - 1] = to;
        lines.join("\n")
    });
}

/// Writes a sequence into a folder.
pub(crate) type Writer = fn(&Path);
/// Layouts with depth: name and writer.
pub(crate) const LAYOUTS: [(&str, Writer); 3] = [
    ("7-scenes", |folder| write_seven_scenes(folder, 6)),
    ("tum-rgbd", |folder| write_tum(folder, 6)),
    ("open3d-log", |folder| write_open3d(folder, 11, 2)),
];
/// Layouts of models: name, writer, whether they have points.
pub(crate) const MODELS: [(&str, Writer, bool); 10] = [
    ("colmap", write_colmap_text, true),
    ("colmap", write_colmap_binary, true),
    ("nvm", write_nvm, true),
    ("openmvs", write_mvs, true),
    ("transforms-json", write_transforms, false),
    ("stella-vslam", write_stella, true),
    ("orb-slam", write_orb_slam, false),
    ("euroc", write_euroc, false),
    ("kitti", write_kitti, false),
    ("images-and-poses", write_pose_list, false),
];
