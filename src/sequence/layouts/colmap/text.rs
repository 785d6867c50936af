//! COLMAP models as text.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Point3;

use super::super::super::model::{ModelImage, PointBuilder, SparseModel};
use super::super::super::text::{Row, TextFile, parse_number, shorten};
use super::super::super::{SequenceError, rigid};
use super::camera::camera;

/// Reads `cameras.txt`, `images.txt` and, when it is there, `points3D.txt` of a folder.
pub(super) fn read(folder: &Path) -> Result<SparseModel, SequenceError> {
    let mut model = SparseModel::default();
    let camera_of = read_cameras(&folder.join("cameras.txt"), &mut model)?;
    let points_path = folder.join("points3D.txt");
    let mut points = PointBuilder::default();
    let mut tracks = Vec::new();
    if points_path.is_file() {
        tracks = read_points(&points_path, &mut points)?;
    }
    let view_of = read_images(
        &folder.join("images.txt"),
        &camera_of,
        &mut model,
        &mut points,
    )?;
    // Tracks name views; where those list no pixels, the sighting still counts.
    for (point, image) in tracks {
        if let Some(&view) = view_of.get(&image) {
            points.see(point, view, None);
        }
    }
    model.points = points.finish();
    Ok(model)
}

fn whole<T: std::str::FromStr>(
    row: &Row,
    field: Option<&str>,
    what: &str,
) -> Result<T, SequenceError> {
    let field = field.unwrap_or_default();
    field
        .parse()
        .map_err(|_| row.error(format!("'{}' is not {what}", shorten(field))))
}

fn read_cameras(path: &Path, model: &mut SparseModel) -> Result<BTreeMap<u32, u32>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut camera_of = BTreeMap::new();
    for row in file.rows() {
        let mut fields = row.fields();
        let id: u32 = whole(&row, fields.next(), "a camera id")?;
        let name = fields.next().unwrap_or_default();
        let width: u64 = whole(&row, fields.next(), "an image width")?;
        let height: u64 = whole(&row, fields.next(), "an image height")?;
        let parameters = fields
            .map(|field| {
                parse_number(field)
                    .ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))
            })
            .collect::<Result<Vec<f64>, _>>()?;
        let found = camera(
            name,
            width,
            height,
            &parameters,
            &path.display().to_string(),
        )
        .map_err(|problem| row.error(problem))?;
        if camera_of.insert(id, model.cameras.len() as u32).is_some() {
            return Err(row.error(format!("camera {id} stands there before")));
        }
        model.cameras.push(found);
    }
    if camera_of.is_empty() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: "holds no camera: lines 'CAMERA_ID MODEL WIDTH HEIGHT PARAMS...' expected"
                .to_owned(),
        });
    }
    Ok(camera_of)
}

/// Two lines an image; the second, the image's points, may be empty. Gives the place of each image id.
fn read_images(
    path: &Path,
    camera_of: &BTreeMap<u32, u32>,
    model: &mut SparseModel,
    points: &mut PointBuilder,
) -> Result<BTreeMap<u32, u32>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut view_of = BTreeMap::new();
    let mut rows = file.lines();
    while let Some(row) = rows.next() {
        if row.text().is_empty() || row.text().starts_with('#') {
            continue;
        }
        // The name is the rest of the line and may hold blanks.
        let mut rest = row.text();
        let mut next = || {
            let (field, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            rest = after.trim_start();
            Some(field).filter(|field| !field.is_empty())
        };
        let id: u32 = whole(&row, next(), "an image id")?;
        let mut numbers = [0.0; 7];
        for slot in &mut numbers {
            let field = next().unwrap_or_default();
            *slot = parse_number(field)
                .ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))?;
        }
        let camera_id: u32 = whole(&row, next(), "a camera id")?;
        let name = rest;
        if name.is_empty() {
            return Err(row.error(
                "'IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME' expected, the name is missing"
                    .to_owned(),
            ));
        }
        let camera = *camera_of
            .get(&camera_id)
            .ok_or_else(|| row.error(format!("there is no camera {camera_id} in cameras.txt")))?;
        let [qw, qx, qy, qz, tx, ty, tz] = numbers;
        let camera_from_world = rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
            .map_err(|problem| row.error(format!("the pose of {} {problem}", shorten(name))))?;
        let view = model.images.len() as u32;
        if view_of.insert(id, view).is_some() {
            return Err(row.error(format!("image {id} stands there before")));
        }
        model.images.push(ModelImage {
            name: name.to_owned(),
            camera,
            world_from_camera: camera_from_world.inverse(),
            timestamp_ns: None,
        });
        if let Some(row) = rows.next() {
            read_sightings(&row, view, points)?;
        }
    }
    Ok(view_of)
}

/// Triples `X Y POINT3D_ID`, the id -1 where no point is seen.
fn read_sightings(row: &Row, view: u32, points: &mut PointBuilder) -> Result<(), SequenceError> {
    let mut fields = row.text().split_ascii_whitespace();
    while let Some(x) = fields.next() {
        let (Some(y), Some(id)) = (fields.next(), fields.next()) else {
            return Err(
                row.error("triples 'X Y POINT3D_ID' expected, the last is cut off".to_owned())
            );
        };
        if id == "-1" {
            continue;
        }
        let number = |field: &str| {
            parse_number(field)
                .ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))
        };
        let id: u64 = whole(row, Some(id), "a point id")?;
        points.see(id, view, Some([number(x)? - 0.5, number(y)? - 0.5]));
    }
    Ok(())
}

/// Adds the points; gives all pairs of point and image id that their tracks name.
fn read_points(path: &Path, points: &mut PointBuilder) -> Result<Vec<(u64, u32)>, SequenceError> {
    let file = TextFile::read(path)?;
    let mut tracks = Vec::new();
    for row in file.rows() {
        let id: u64 = whole(&row, row.fields().next(), "a point id")?;
        let [x, y, z, r, g, b, _error] = row.numbers_from(1)?;
        let channel = |value: f64| value.clamp(0.0, 255.0) as u8;
        points.add(
            id,
            Point3::new(x, y, z),
            Some([channel(r), channel(g), channel(b)]),
        );
        let mut track = row.fields().skip(8);
        while let Some(image) = track.next() {
            if track.next().is_none() {
                return Err(row.error(
                    "pairs 'IMAGE_ID POINT2D_IDX' expected at the end, the last is cut off"
                        .to_owned(),
                ));
            }
            tracks.push((id, whole(&row, Some(image), "an image id")?));
        }
    }
    Ok(tracks)
}
