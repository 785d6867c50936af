//! Replica of NICE-SLAM.

use serde_json::json;

use super::RecordingError;
use super::source::{Source, intrinsics, joined, matrix_rows};

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    source.make_folder("results")?;
    // Floating-point depth gets the unit of the data set.
    let scale = match source.depth_scale > 1.0 {
        true => source.depth_scale,
        false => 6553.5,
    };
    let mut trajectory = String::new();
    for index in 0..source.count() {
        source.write_picture(index, &format!("results/frame{index:06}"))?;
        source.write_depth_png(index, scale, &format!("results/depth{index:06}.png"))?;
        trajectory += &(joined(matrix_rows(source.pose(index)).as_flattened()) + "\n");
    }
    source.write("traj.txt", trajectory.as_bytes())?;
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    let size = source.size();
    let camera = json!({ "w": size.width, "h": size.height, "fx": fx, "fy": fy, "cx": cx, "cy": cy, "scale": scale });
    let file = json!({ "camera": camera }).to_string();
    source.write("cam_params.json", file.as_bytes())
}
