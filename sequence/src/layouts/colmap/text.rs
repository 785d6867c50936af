//! Text files of COLMAP models.

use std::path::Path;

use nalgebra::Point3;

use super::super::super::SequenceError;
use super::super::super::text::{TextFile, TextLine, parse_number, shorten};
use super::builder::{ImageRecord, ModelBuilder};
use super::camera::camera;

fn integer<T: std::str::FromStr>(
    row: &TextLine,
    field: Option<&str>,
    what: &str,
) -> Result<T, SequenceError> {
    let field = field.unwrap_or_default();
    field
        .parse()
        .map_err(|_| row.error(format!("'{}' is not {what}", shorten(field))))
}

fn number(row: &TextLine, field: &str) -> Result<f64, SequenceError> {
    parse_number(field).ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))
}

pub(super) fn read_cameras(path: &Path, model: &mut ModelBuilder) -> Result<(), SequenceError> {
    let file = TextFile::read(path)?;
    let source = path.display().to_string();
    let mut is_empty = true;
    for row in file.rows() {
        let mut fields = row.fields();
        let id: u32 = integer(&row, fields.next(), "a camera id")?;
        let name = fields.next().unwrap_or_default();
        let width: u64 = integer(&row, fields.next(), "an image width")?;
        let height: u64 = integer(&row, fields.next(), "an image height")?;
        let parameters = fields
            .map(|field| number(&row, field))
            .collect::<Result<Vec<f64>, _>>()?;
        camera(name, width, height, &parameters, &source)
            .and_then(|found| model.add_camera(id, found))
            .map_err(|problem| row.error(problem))?;
        is_empty = false;
    }
    if is_empty {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: "has no camera: expected lines 'CAMERA_ID MODEL WIDTH HEIGHT PARAMS...'"
                .to_owned(),
        });
    }
    Ok(())
}

/// Reads two lines an image; the second has its observations and may be empty.
pub(super) fn read_images(path: &Path, model: &mut ModelBuilder) -> Result<(), SequenceError> {
    let file = TextFile::read(path)?;
    let mut rows = file.lines();
    while let Some(row) = rows.next() {
        if row.text().is_empty() || row.text().starts_with('#') {
            continue;
        }
        // The name is the rest of the line and may contain blanks.
        let mut rest = row.text();
        let mut next = || {
            let (field, after) = rest.split_once(char::is_whitespace).unwrap_or((rest, ""));
            rest = after.trim_start();
            Some(field).filter(|field| !field.is_empty())
        };
        let id: u32 = integer(&row, next(), "an image id")?;
        let mut pose = [0.0; 7];
        for slot in &mut pose {
            *slot = number(&row, next().unwrap_or_default())?;
        }
        let camera_id: u32 = integer(&row, next(), "a camera id")?;
        if rest.is_empty() {
            return Err(row.error(
                "expected 'IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME', the name is missing"
                    .to_owned(),
            ));
        }
        let record = ImageRecord {
            id,
            pose,
            camera_id,
            name: rest.to_owned(),
        };
        let view = model
            .add_image(record)
            .map_err(|problem| row.error(problem))?;
        if let Some(row) = rows.next() {
            read_observations(&row, view, model)?;
        }
    }
    Ok(())
}

/// Reads triples `X Y POINT3D_ID`; the id -1 marks a feature without a point.
fn read_observations(
    row: &TextLine,
    view: u32,
    model: &mut ModelBuilder,
) -> Result<(), SequenceError> {
    let mut fields = row.text().split_ascii_whitespace();
    while let Some(x) = fields.next() {
        let (Some(y), Some(id)) = (fields.next(), fields.next()) else {
            return Err(
                row.error("expected triples 'X Y POINT3D_ID', the last is incomplete".to_owned())
            );
        };
        if id == "-1" {
            continue;
        }
        let id: u64 = integer(row, Some(id), "a point id")?;
        model.add_observation(id, view, [number(row, x)?, number(row, y)?]);
    }
    Ok(())
}

pub(super) fn read_points(path: &Path, model: &mut ModelBuilder) -> Result<(), SequenceError> {
    let file = TextFile::read(path)?;
    let mut images = Vec::new();
    for row in file.rows() {
        let id: u64 = integer(&row, row.fields().next(), "a point id")?;
        let [x, y, z, r, g, b, _error] = row.numbers_from(1)?;
        let color = [r, g, b].map(|channel: f64| channel.clamp(0.0, 255.0) as u8);
        images.clear();
        let mut track = row.fields().skip(8);
        while let Some(image) = track.next() {
            if track.next().is_none() {
                return Err(row.error(
                    "expected pairs 'IMAGE_ID POINT2D_IDX' at the end, the last is incomplete"
                        .to_owned(),
                ));
            }
            images.push(integer(&row, Some(image), "an image id")?);
        }
        model.add_point(id, Point3::new(x, y, z), color, images.drain(..));
    }
    Ok(())
}
