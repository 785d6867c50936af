//! Trajectory files.

use std::path::Path;

use super::PosedImage;
use linecarve_mesh::files::{WriteError, write_atomically};

/// Trajectory formats for export. All store poses `world_from_camera`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrajectoryFormat {
    /// `stamp tx ty tz qx qy qz qw`, seconds.
    Tum,
    /// `stamp,px,py,pz,qw,qx,qy,qz`, nanoseconds.
    Euroc,
    /// The first three rows of the matrix in one line; no stamps.
    Kitti,
    /// Five lines an image: `i i i+1` and the 4x4 matrix.
    Open3dLog,
}

/// Writes the poses of images in the given order.
///
/// # Errors
/// If the file cannot be written.
pub fn write_trajectory(
    path: &Path,
    format: TrajectoryFormat,
    images: &[PosedImage],
) -> Result<(), WriteError> {
    write_atomically(path, |out| {
        match format {
            TrajectoryFormat::Tum => writeln!(out, "# timestamp tx ty tz qx qy qz qw")?,
            TrajectoryFormat::Euroc => writeln!(
                out,
                "#timestamp [ns],p_x [m],p_y [m],p_z [m],q_w [],q_x [],q_y [],q_z []"
            )?,
            TrajectoryFormat::Kitti | TrajectoryFormat::Open3dLog => {}
        }
        for image in images {
            let number = image.number;
            let t = image.world_from_camera.translation.vector;
            let q = image.world_from_camera.rotation;
            let matrix = image.world_from_camera.to_homogeneous();
            match format {
                TrajectoryFormat::Tum => writeln!(
                    out,
                    "{} {} {} {} {} {} {} {}",
                    seconds(image.timestamp_ns),
                    t.x,
                    t.y,
                    t.z,
                    q.i,
                    q.j,
                    q.k,
                    q.w
                )?,
                TrajectoryFormat::Euroc => writeln!(
                    out,
                    "{},{},{},{},{},{},{},{}",
                    image.timestamp_ns, t.x, t.y, t.z, q.w, q.i, q.j, q.k
                )?,
                TrajectoryFormat::Kitti => {
                    let numbers: Vec<String> = (0..3)
                        .flat_map(|row| (0..4).map(move |column| (row, column)))
                        .map(|at| matrix[at].to_string())
                        .collect();
                    writeln!(out, "{}", numbers.join(" "))?;
                }
                TrajectoryFormat::Open3dLog => {
                    writeln!(out, "{number} {number} {}", number.saturating_add(1))?;
                    for row in matrix.row_iter() {
                        let numbers: Vec<String> = row.iter().map(ToString::to_string).collect();
                        writeln!(out, "{}", numbers.join(" "))?;
                    }
                }
            }
        }
        Ok(())
    })
}

/// Nanoseconds as seconds with nine decimals.
fn seconds(ns: i64) -> String {
    let sign = if ns < 0 { "-" } else { "" };
    let magnitude = ns.unsigned_abs();
    format!(
        "{sign}{}.{:09}",
        magnitude / 1_000_000_000,
        magnitude % 1_000_000_000
    )
}
