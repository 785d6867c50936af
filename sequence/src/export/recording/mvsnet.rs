//! MVSNet.

use super::RecordingError;
use super::loose::float_map;
use super::source::{Source, intrinsics, matrix_text};

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    for folder in ["images", "cams", "depth_est"] {
        source.make_folder(folder)?;
    }
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    for index in 0..source.count() {
        source.write_picture(index, &format!("images/{index:08}"))?;
        let depth = source.depth(index)?;
        source.write(&format!("depth_est/{index:08}.pfm"), &float_map(&depth))?;
        let known = depth.samples().iter().copied().filter(|depth| *depth > 0.0);
        let nearest = known.fold(f32::INFINITY, f32::min);
        let nearest = if nearest.is_finite() { nearest } else { 0.0 };
        let extrinsic = matrix_text(&source.pose(index).inverse());
        let text = format!(
            "extrinsic\n{extrinsic}\nintrinsic\n{fx} 0 {cx}\n0 {fy} {cy}\n0 0 1\n\n{nearest} 0.0025\n"
        );
        source.write(&format!("cams/{index:08}_cam.txt"), text.as_bytes())?;
    }
    Ok(())
}
