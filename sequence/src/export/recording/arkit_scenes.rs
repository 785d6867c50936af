//! ARKitScenes.

use super::RecordingError;
use super::source::{Source, intrinsics, joined, seconds};

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    for folder in ["lowres_wide", "lowres_depth", "lowres_wide_intrinsics"] {
        source.make_folder(folder)?;
    }
    let mut trajectory = String::new();
    let size = source.size();
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    let sides = [f64::from(size.width), f64::from(size.height)];
    let camera = joined(&[sides[0], sides[1], fx, fy, cx, cy]) + "\n";
    for index in 0..source.count() {
        let time = seconds(source.time_ns(index));
        source.write_picture(index, &format!("lowres_wide/1_{time}"))?;
        source.write_depth_png(index, 1000.0, &format!("lowres_depth/1_{time}.png"))?;
        let name = format!("lowres_wide_intrinsics/1_{time}.pincam");
        source.write(&name, camera.as_bytes())?;
        let pose = source.pose(index).inverse();
        let (r, t) = (pose.rotation.scaled_axis(), pose.translation.vector);
        trajectory += &format!("{time} {}\n", joined(&[r.x, r.y, r.z, t.x, t.y, t.z]));
    }
    source.write("lowres_wide.traj", trajectory.as_bytes())
}
