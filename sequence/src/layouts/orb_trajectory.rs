//! The trajectory files of ORB-SLAM by their names.

use std::path::PathBuf;

use super::super::layout::Folder;

/// What ORB-SLAM saves, keyframes first: their poses are the optimised ones.
pub(super) const ORB_TRAJECTORIES: [&str; 3] = [
    "KeyFrameTrajectory.txt",
    "CameraTrajectory.txt",
    "FrameTrajectory.txt",
];

/// The trajectory that a run of ORB-SLAM left in a folder.
pub(super) fn orb_trajectory(folder: &Folder) -> Option<PathBuf> {
    folder.first_entry(&ORB_TRAJECTORIES).or_else(|| {
        // ORB-SLAM3 puts the name of the run into that of the file; kf is of keyframes.
        ["kf_", "f_"].iter().find_map(|start| {
            folder
                .names()
                .iter()
                .find(|name| name.starts_with(start) && name.ends_with(".txt"))
                .map(|name| folder.path().join(name))
        })
    })
}
