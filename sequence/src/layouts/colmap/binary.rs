//! Binary files of COLMAP models, little-endian.

use std::path::Path;

use nalgebra::Point3;

use super::super::super::SequenceError;
use super::super::super::bytes::{ByteReader, read_file};
use super::builder::{ImageRecord, ModelBuilder};
use super::camera::{camera, model_by_number};

pub(super) fn read_cameras(path: &Path, model: &mut ModelBuilder) -> Result<(), SequenceError> {
    let bytes = read_file(path)?;
    let mut reader = ByteReader::new(path, &bytes);
    let source = path.display().to_string();
    for _ in 0..reader.count("cameras", 24 + 3 * 8)? {
        let id = reader.u32()?;
        let number = reader.u32()?;
        let (name, count) = model_by_number(number).map_err(|problem| reader.error(problem))?;
        let (width, height) = (reader.u64()?, reader.u64()?);
        let mut parameters = [0.0; 16];
        for slot in &mut parameters[..count] {
            *slot = reader.f64()?;
        }
        camera(name, width, height, &parameters[..count], &source)
            .and_then(|found| model.add_camera(id, found))
            .map_err(|problem| reader.error(problem))?;
    }
    Ok(())
}

pub(super) fn read_images(path: &Path, model: &mut ModelBuilder) -> Result<(), SequenceError> {
    let bytes = read_file(path)?;
    let mut reader = ByteReader::new(path, &bytes);
    for _ in 0..reader.count("images", 73)? {
        let record = ImageRecord {
            id: reader.u32()?,
            pose: reader.f64s()?,
            camera_id: reader.u32()?,
            name: reader.text_to_zero()?,
        };
        let view = model
            .add_image(record)
            .map_err(|problem| reader.error(problem))?;
        for _ in 0..reader.count("pixels", 24)? {
            let pixel = reader.f64s()?;
            let point = reader.u64()?;
            if point != u64::MAX {
                model.add_observation(point, view, pixel);
            }
        }
    }
    Ok(())
}

pub(super) fn read_points(path: &Path, model: &mut ModelBuilder) -> Result<(), SequenceError> {
    let bytes = read_file(path)?;
    let mut reader = ByteReader::new(path, &bytes);
    let mut track = Vec::new();
    for _ in 0..reader.count("points", 51)? {
        let id = reader.u64()?;
        let [x, y, z] = reader.f64s()?;
        let color = [reader.u8()?, reader.u8()?, reader.u8()?];
        let _error = reader.f64()?;
        track.clear();
        for _ in 0..reader.count("observations of a point", 8)? {
            track.push(reader.u32()?);
            let _index = reader.u32()?;
        }
        model.add_point(id, Point3::new(x, y, z), color, track.drain(..));
    }
    Ok(())
}
