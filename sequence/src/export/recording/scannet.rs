//! ScanNet as exported.

use super::RecordingError;
use super::source::{Source, intrinsics, matrix_text};

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    for folder in ["color", "depth", "pose", "intrinsic"] {
        source.make_folder(folder)?;
    }
    for index in 0..source.count() {
        source.write_picture(index, &format!("color/{index}"))?;
        source.write_depth_png(index, 1000.0, &format!("depth/{index}.png"))?;
        let pose = matrix_text(source.pose(index));
        source.write(&format!("pose/{index}.txt"), pose.as_bytes())?;
    }
    for (name, camera) in [("color", source.camera()), ("depth", &source.depth_camera)] {
        let [fx, fy, cx, cy] = intrinsics(camera);
        let matrix = format!("{fx} 0 {cx} 0\n0 {fy} {cy} 0\n0 0 1 0\n0 0 0 1\n");
        source.write(
            &format!("intrinsic/intrinsic_{name}.txt"),
            matrix.as_bytes(),
        )?;
    }
    Ok(())
}
