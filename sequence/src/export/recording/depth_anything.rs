//! Depth Anything 3: `results.npz` with images, all at the size of depth.

use std::io::Write;

use zip::ZipWriter;

use super::RecordingError;
use super::arrays::{begin_array, write_f32, write_f64};
use super::source::{Source, intrinsics, matrix_rows};

/// Poses and intrinsics have double precision, where the model writes single precision: readers take both.
const DOUBLE: &str = "<f8";

pub(super) fn write(source: &Source<'_>) -> Result<(), RecordingError> {
    let (size, depth) = (source.size(), source.depth_size());
    let count = source.count() as u64;
    // Images of another size lie beside the archive.
    let is_inside = size == depth;
    if !is_inside {
        source.make_folder("images")?;
        for index in 0..source.count() {
            source.write_picture(index, &format!("images/{index:06}"))?;
        }
    }
    source.write_with("results.npz", |out| {
        let mut archive = ZipWriter::new_stream(out);
        let (height, width) = (u64::from(depth.height), u64::from(depth.width));
        begin_array(&mut archive, "depth", "<f4", &[count, height, width])?;
        for index in 0..source.count() {
            write_f32(&mut archive, source.depth(index)?.samples())?;
        }
        if source.confidence(0).is_some() {
            begin_array(&mut archive, "conf", "<f4", &[count, height, width])?;
            for index in 0..source.count() {
                // The model's values are at least one.
                let classes = source.confidence(index).unwrap_or_default();
                let values = classes.into_iter().map(|class| 1.0 + f32::from(class));
                write_f32(&mut archive, &values.collect::<Vec<f32>>())?;
            }
        }
        begin_array(&mut archive, "extrinsics", DOUBLE, &[count, 3, 4])?;
        for index in 0..source.count() {
            let rows = matrix_rows(&source.pose(index).inverse());
            write_f64(&mut archive, rows[..3].as_flattened())?;
        }
        begin_array(&mut archive, "intrinsics", DOUBLE, &[count, 3, 3])?;
        let [fx, fy, cx, cy] = intrinsics(&source.depth_camera);
        for _ in 0..source.count() {
            write_f64(&mut archive, &[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])?;
        }
        if is_inside {
            begin_array(&mut archive, "image", "|u1", &[count, height, width, 3])?;
            for index in 0..source.count() {
                archive.write_all(&source.pixels(index)?)?;
            }
        }
        archive.finish()?;
        Ok(())
    })
}
