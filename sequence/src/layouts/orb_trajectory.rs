//! Trajectory files of ORB-SLAM.

use std::path::PathBuf;

use super::super::layout::Folder;

/// File names of ORB-SLAM, keyframes first, since only their poses are optimised.
pub(super) const ORB_TRAJECTORIES: [&str; 3] = [
    "KeyFrameTrajectory.txt",
    "CameraTrajectory.txt",
    "FrameTrajectory.txt",
];

/// The ORB-SLAM trajectory of a folder, if any.
pub(super) fn orb_trajectory(folder: &Folder) -> Option<PathBuf> {
    folder.first_entry(&ORB_TRAJECTORIES).or_else(|| {
        // ORB-SLAM3: kf_RUN.txt has keyframes, f_RUN.txt all frames.
        ["kf_", "f_"].iter().find_map(|start| {
            folder
                .names()
                .iter()
                .find(|name| name.starts_with(start) && name.ends_with(".txt"))
                .and_then(|name| folder.entry(name))
        })
    })
}
