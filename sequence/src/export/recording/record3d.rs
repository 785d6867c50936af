//! Record3D: one archive.

use std::io::Write;

use nalgebra::Isometry3;
use serde_json::json;
use zip::ZipWriter;

use super::RecordingError;
use super::arrays::{packed, stored};
use super::source::{Failure, Source, intrinsics};
use crate::camera_axes::half_turn_about_x;

/// Name of the archive.
const FILE: &str = "recording.r3d";

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    source.write_with(FILE, |out| {
        let mut archive = ZipWriter::new_stream(out);
        archive.start_file("metadata", packed())?;
        archive.write_all(metadata(source).as_bytes())?;
        for index in 0..source.count() {
            let picture = source.picture(index)?;
            let name = format!("rgbd/{index}.{}", picture.extension);
            archive.start_file(name, stored())?;
            archive.write_all(&picture.bytes)?;
            archive.start_file(format!("rgbd/{index}.depth"), stored())?;
            archive.write_all(&depth(source, index)?)?;
        }
        archive.finish()?;
        Ok(())
    })
}

/// Depth as the app packs it; NaN where unknown.
fn depth(source: &Source<'_>, index: usize) -> Result<Vec<u8>, Failure> {
    let depth = source.depth(index)?;
    let values = depth.samples().iter().map(|&depth| match depth > 0.0 {
        true => depth,
        false => f32::NAN,
    });
    let bytes: Vec<u8> = values.flat_map(f32::to_le_bytes).collect();
    let mut packed = Vec::new();
    lzfse_rust::encode_bytes(&bytes, &mut packed)?;
    Ok(packed)
}

fn metadata(source: &Source<'_>) -> String {
    let [fx, fy, cx, cy] = intrinsics(source.camera());
    let (size, depth) = (source.size(), source.depth_size());
    let poses: Vec<[f64; 7]> = (0..source.count())
        .map(|at| numbers(source.pose(at)))
        .collect();
    let times: Vec<f64> = (0..source.count())
        .map(|at| source.time_ns(at) as f64 * 1e-9)
        .collect();
    let metadata = json!({
        "w": size.width,
        "h": size.height,
        "dw": depth.width,
        "dh": depth.height,
        "fps": 30,
        "K": [fx, 0.0, 0.0, 0.0, fy, 0.0, cx, cy, 1.0],
        "poses": poses,
        "frameTimestamps": times,
    });
    metadata.to_string()
}

/// `qx qy qz qw tx ty tz` with the axes of ARKit.
fn numbers(pose: &Isometry3<f64>) -> [f64; 7] {
    let t = pose.translation.vector;
    let q = (pose.rotation * half_turn_about_x().inverse()).coords;
    [q.x, q.y, q.z, q.w, t.x, t.y, t.z]
}
