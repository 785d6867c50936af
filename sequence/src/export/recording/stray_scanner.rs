//! Stray Scanner, with pictures in place of the video.

use super::RecordingError;
use super::source::{Source, intrinsics, seconds};

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    source.make_folder("rgb")?;
    source.make_folder("depth")?;
    let mut odometry = String::from("timestamp, frame, x, y, z, qx, qy, qz, qw\n");
    for index in 0..source.count() {
        source.write_picture(index, &format!("rgb/{index:06}"))?;
        source.write_depth_png(index, 1000.0, &format!("depth/{index:06}.png"))?;
        source.write_confidence_png(index, &format!("confidence/{index:06}.png"))?;
        let pose = source.pose(index);
        let (t, q) = (pose.translation.vector, pose.rotation.coords);
        let numbers = [t.x, t.y, t.z, q.x, q.y, q.z, q.w].map(|number| number.to_string());
        let time = seconds(source.time_ns(index));
        odometry += &format!("{time}, {index:06}, {}\n", numbers.join(", "));
    }
    source.write("odometry.csv", odometry.as_bytes())?;
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    let matrix = format!("{fx}, 0, {cx}\n0, {fy}, {cy}\n0, 0, 1\n");
    source.write("camera_matrix.csv", matrix.as_bytes())
}
