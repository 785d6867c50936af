//! Files of a tracked sequence.

use std::path::Path;

use linecarve_mesh::files::{WriteError, write_atomically};
use linecarve_mesh::write_points_ply;
use linecarve_sequence::Sequence;
use linecarve_sequence::export::{PosedImage, TrajectoryFormat, posed_images, write_trajectory};
use nalgebra::Isometry3;

use super::output::OutputFolder;
use crate::tracking::{TrackReport, TrackedSequence, poses_file};

/// Writes the poses of each sub-map, the points of the largest, and the report, which is last.
pub(crate) fn write_tracked(
    tracked: &TrackedSequence,
    sequence: &Sequence,
    report: &mut TrackReport,
    output: &mut OutputFolder,
) -> anyhow::Result<()> {
    for number in 0..tracked.recording.submaps.len() {
        let path = output.file(&poses_file(number));
        write_frames(&path, sequence, tracked.poses_in(number))?;
    }
    if let Some(submap) = tracked.recording.submaps.first() {
        write_points_ply(&output.file("points.ply"), &submap.points, None)?;
    }
    let path = output.file("track.json");
    report.files = output.written().to_vec();
    write_atomically(&path, |out| {
        serde_json::to_writer_pretty(&mut *out, &report).map_err(std::io::Error::other)?;
        out.write_all(b"\n")
    })?;
    Ok(())
}

fn write_frames(
    path: &Path,
    sequence: &Sequence,
    poses: impl Iterator<Item = (usize, Isometry3<f64>)>,
) -> Result<(), WriteError> {
    let images = posed_images(sequence);
    let posed: Vec<PosedImage> = poses
        .map(|(frame, world_from_camera)| PosedImage {
            world_from_camera,
            ..images[frame].clone()
        })
        .collect();
    write_trajectory(path, TrajectoryFormat::Tum, &posed)
}
