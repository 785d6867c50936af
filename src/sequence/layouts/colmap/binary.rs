//! COLMAP models as binary files, little-endian.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Point3;

use super::super::super::bytes::{ByteReader, read_file};
use super::super::super::model::{ModelImage, PointBuilder, SparseModel};
use super::super::super::{SequenceError, rigid};
use super::camera::{camera, model_by_number};

/// Reads `cameras.bin`, `images.bin` and, when it is there, `points3D.bin` of a folder.
pub(super) fn read(folder: &Path) -> Result<SparseModel, SequenceError> {
    let mut model = SparseModel::default();
    let camera_of = read_cameras(&folder.join("cameras.bin"), &mut model)?;
    let points_path = folder.join("points3D.bin");
    let mut points = PointBuilder::default();
    let mut tracks = Vec::new();
    if points_path.is_file() {
        tracks = read_points(&points_path, &mut points)?;
    }
    let view_of = read_images(
        &folder.join("images.bin"),
        &camera_of,
        &mut model,
        &mut points,
    )?;
    for (point, image) in tracks {
        if let Some(&view) = view_of.get(&image) {
            points.see(point, view, None);
        }
    }
    model.points = points.finish();
    Ok(model)
}

fn read_cameras(path: &Path, model: &mut SparseModel) -> Result<BTreeMap<u32, u32>, SequenceError> {
    let bytes = read_file(path)?;
    let mut reader = ByteReader::new(path, &bytes);
    let mut camera_of = BTreeMap::new();
    for _ in 0..reader.count("cameras", 24 + 3 * 8)? {
        let id = reader.u32()?;
        let number = reader.u32()?;
        let (name, count) = model_by_number(number).map_err(|problem| reader.error(problem))?;
        let (width, height) = (reader.u64()?, reader.u64()?);
        let mut parameters = [0.0; 16];
        for slot in &mut parameters[..count] {
            *slot = reader.f64()?;
        }
        let found = camera(
            name,
            width,
            height,
            &parameters[..count],
            &path.display().to_string(),
        )
        .map_err(|problem| reader.error(problem))?;
        if camera_of.insert(id, model.cameras.len() as u32).is_some() {
            return Err(reader.error(format!("camera {id} stands there before")));
        }
        model.cameras.push(found);
    }
    Ok(camera_of)
}

fn read_images(
    path: &Path,
    camera_of: &BTreeMap<u32, u32>,
    model: &mut SparseModel,
    points: &mut PointBuilder,
) -> Result<BTreeMap<u32, u32>, SequenceError> {
    let bytes = read_file(path)?;
    let mut reader = ByteReader::new(path, &bytes);
    let mut view_of = BTreeMap::new();
    for _ in 0..reader.count("images", 73)? {
        let id = reader.u32()?;
        let [qw, qx, qy, qz, tx, ty, tz] = reader.f64s()?;
        let camera_id = reader.u32()?;
        let name = reader.text_to_zero()?;
        let camera = *camera_of.get(&camera_id).ok_or_else(|| {
            reader.error(format!("there is no camera {camera_id} in cameras.bin"))
        })?;
        let camera_from_world = rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
            .map_err(|problem| reader.error(format!("the pose of {name} {problem}")))?;
        let view = model.images.len() as u32;
        if view_of.insert(id, view).is_some() {
            return Err(reader.error(format!("image {id} stands there before")));
        }
        model.images.push(ModelImage {
            name,
            camera,
            world_from_camera: camera_from_world.inverse(),
            timestamp_ns: None,
        });
        for _ in 0..reader.count("pixels", 24)? {
            let [x, y] = reader.f64s()?;
            let point = reader.u64()?;
            if point != u64::MAX {
                points.see(point, view, Some([x - 0.5, y - 0.5]));
            }
        }
    }
    Ok(view_of)
}

/// Adds the points; gives all pairs of point and image id that their tracks name.
fn read_points(path: &Path, points: &mut PointBuilder) -> Result<Vec<(u64, u32)>, SequenceError> {
    let bytes = read_file(path)?;
    let mut reader = ByteReader::new(path, &bytes);
    let mut tracks = Vec::new();
    for _ in 0..reader.count("points", 51)? {
        let id = reader.u64()?;
        let [x, y, z] = reader.f64s()?;
        let color = [reader.u8()?, reader.u8()?, reader.u8()?];
        let _error = reader.f64()?;
        points.add(id, Point3::new(x, y, z), Some(color));
        for _ in 0..reader.count("sightings of a point", 8)? {
            let image = reader.u32()?;
            let _place = reader.u32()?;
            tracks.push((id, image));
        }
    }
    Ok(tracks)
}
