//! VisualSFM: one file `*.nvm` with cameras, poses and points, in the folder of the images.
//!
//! # Reference
//! C. Wu, VisualSFM: A Visual Structure from Motion System, documentation of the N-View Match format. Distortion is
//! `undistorted = measured * (1 + d * |measured|^2)`, both relative to the principal point and divided by the focal
//! length.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::{Isometry3, Point3, Translation3};

use super::super::calibration::{CalibratedCamera, ImageSize};
use super::super::image_file::image_size;
use super::super::layout::{Folder, Layout, PoseSource, Recording};
use super::super::model::{ModelImage, StoredModel};
use super::super::text::{TextFile, TextLine, parse_number, shorten};
use super::super::{SequenceError, Warning, rigid};
use crate::sparse_model::{ModelObservation, ModelPoint};

/// Reader of VisualSFM.
pub(in super::super) struct Nvm;

fn is_model(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".nvm")
}

fn model_path(folder: &Folder) -> Option<PathBuf> {
    if let Some(name) = folder.file() {
        return Some(folder.path().join(name));
    }
    let mut models = folder.names().iter().filter(|name| is_model(name));
    let only = models.next().filter(|_| models.next().is_none());
    only.and_then(|name| folder.entry(name))
}

impl Layout for Nvm {
    fn name(&self) -> &'static str {
        "nvm"
    }

    fn expected_files(&self) -> &'static str {
        "one file *.nvm"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        model_path(folder).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        is_model(name)
    }

    fn accepts_external_poses(&self) -> bool {
        false
    }

    fn read(&self, folder: &Folder, _origin: PoseSource) -> Result<Recording, SequenceError> {
        let path = model_path(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().to_owned(),
            problem: "has no file *.nvm, or several: give the file itself".to_owned(),
        })?;
        let file = TextFile::read(&path)?;
        let mut parsed = parse(&file, &path)?;
        let roots = [folder.path().to_owned(), folder.path().join("images")];
        let sizes: Vec<Option<ImageSize>> = parsed
            .cameras
            .iter()
            .map(|camera| {
                roots
                    .iter()
                    .find_map(|root| image_size(&root.join(&camera.name)).ok())
            })
            .collect();
        let mut warnings = Vec::new();
        let are_relative = measurements_to_pixels(&mut parsed, &sizes, &mut warnings);
        let model = model_of(parsed, &sizes, &path)?;
        let mut recording = model.into_recording(&path, &roots)?;
        recording.warnings.extend(warnings);
        recording.conventions.push(format!(
            "poses: {}, quaternion camera from world, w first, and camera centre; principal points at the image centres; \
             measurements relative to the {} of the image",
            path.display(),
            if are_relative { "centre" } else { "corner" }
        ));
        Ok(recording)
    }
}

/// A camera line.
struct CameraLine {
    name: String,
    focal_px: f64,
    /// Radial distortion coefficient of measured coordinates.
    radial: f64,
    world_from_camera: Isometry3<f64>,
}

struct NvmModel {
    cameras: Vec<CameraLine>,
    points: Vec<ModelPoint>,
    /// Intrinsics fixed in the head, `fx cx fy cy`.
    fixed: Option<[f64; 4]>,
}

fn parse(file: &TextFile, path: &Path) -> Result<NvmModel, SequenceError> {
    let content = |problem: &str| SequenceError::Content {
        path: path.to_owned(),
        problem: problem.to_owned(),
    };
    let mut rows = file.rows();
    let head = rows
        .next()
        .ok_or_else(|| content("is empty: expected NVM_V3 in the first line"))?;
    if !head.text().starts_with("NVM_V3") {
        return Err(head.error("expected the head NVM_V3 of the N-View Match format".to_owned()));
    }
    let fixed = match head.fields().nth(1) {
        Some("FixedK") => Some(head.numbers_from::<4>(2)?),
        _ => None,
    };
    let truncated = || content("ends within the model (truncated?): copy the file again");
    let count_row = rows.next().ok_or_else(truncated)?;
    let count = count_of(&count_row, "cameras")?;
    let mut cameras = Vec::new();
    for _ in 0..count {
        let row = rows.next().ok_or_else(truncated)?;
        cameras.push(camera_line(&row)?);
    }
    let mut points = Vec::new();
    if let Some(count_row) = rows.next() {
        for _ in 0..count_of(&count_row, "points")? {
            let row = rows.next().ok_or_else(truncated)?;
            points.push(point_line(&row, cameras.len())?);
        }
    }
    Ok(NvmModel {
        cameras,
        points,
        fixed,
    })
}

fn count_of(row: &TextLine, what: &str) -> Result<usize, SequenceError> {
    let field = row.fields().next().unwrap_or_default();
    field
        .parse()
        .map_err(|_| row.error(format!("'{}' is not a number of {what}", shorten(field))))
}

/// Parses `name f qw qx qy qz Cx Cy Cz d 0`; the name may contain blanks.
fn camera_line(row: &TextLine) -> Result<CameraLine, SequenceError> {
    let fields: Vec<&str> = row.text().split_whitespace().collect();
    // Some writers omit the final 0.
    let after_name = match row.text().split_once('\t') {
        Some((name, _)) => name.split_whitespace().count(),
        None if fields.len() >= 11 => fields.len() - 10,
        None => 1,
    };
    let mut numbers = [0.0; 9];
    for (slot, at) in numbers.iter_mut().zip(after_name..) {
        let field = fields.get(at).ok_or_else(|| {
            row.error(format!(
                "expected 'name f qw qx qy qz Cx Cy Cz d 0', found {} fields",
                fields.len()
            ))
        })?;
        *slot = parse_number(field)
            .ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))?;
    }
    let [focal_px, qw, qx, qy, qz, x, y, z, radial] = numbers;
    let name = fields[..after_name].join(" ").trim_matches('"').to_owned();
    let camera_from_world = rigid::from_translation_quaternion([0.0; 3], [qx, qy, qz, qw])
        .map_err(|problem| row.error(format!("the pose {problem}")))?;
    if ![x, y, z, focal_px, radial]
        .iter()
        .all(|value| value.is_finite())
    {
        return Err(row.error("the camera has numbers that are not finite".to_owned()));
    }
    Ok(CameraLine {
        name,
        focal_px,
        radial,
        world_from_camera: Isometry3::from_parts(
            Translation3::new(x, y, z),
            camera_from_world.rotation.inverse(),
        ),
    })
}

/// Parses `X Y Z R G B n (image feature x y)*`.
fn point_line(row: &TextLine, cameras: usize) -> Result<ModelPoint, SequenceError> {
    let [x, y, z, r, g, b, count] = row.numbers_from(0)?;
    let fields = row.fields().count() - 7;
    if !(count >= 0.0 && count.fract() == 0.0 && count * 4.0 == fields as f64) {
        return Err(row.error(format!(
            "expected {count} measurements of 4 numbers, found {fields} numbers"
        )));
    }
    let mut rest = row.fields().skip(7);
    let mut observations = Vec::new();
    while let (Some(image), Some(_feature), Some(u), Some(v)) =
        (rest.next(), rest.next(), rest.next(), rest.next())
    {
        let view = image
            .parse::<u32>()
            .ok()
            .filter(|&view| (view as usize) < cameras)
            .ok_or_else(|| {
                row.error(format!(
                    "'{}' is not an image index below {cameras}",
                    shorten(image)
                ))
            })?;
        let number = |field: &str| {
            parse_number(field)
                .ok_or_else(|| row.error(format!("'{}' is not a number", shorten(field))))
        };
        observations.push(ModelObservation {
            view,
            pixel: Some([number(u)?, number(v)?]),
        });
    }
    let channel = |value: f64| value.clamp(0.0, 255.0) as u8;
    Ok(ModelPoint {
        point_in_world: Point3::new(x, y, z),
        color: Some([channel(r), channel(g), channel(b)]),
        observations,
    })
}

/// Centre of an image; the centre of its first pixel is (0, 0).
fn image_center(size: ImageSize) -> [f64; 2] {
    [size.width, size.height].map(|length| (f64::from(length) - 1.0) / 2.0)
}

/// Converts measurements to pixels; returns whether they are relative to the image centre. The format defines them so,
/// but COLMAP writes them relative to the image corner: then no number is negative.
fn measurements_to_pixels(
    parsed: &mut NvmModel,
    sizes: &[Option<ImageSize>],
    warnings: &mut Vec<Warning>,
) -> bool {
    let are_relative = parsed
        .points
        .iter()
        .flat_map(|point| &point.observations)
        .filter_map(|observation| observation.pixel)
        .flatten()
        .any(|value| value < -1.0);
    if !are_relative && !parsed.points.is_empty() {
        warnings.push(Warning::statement(
            "no measurement is negative: measurements are read as relative to the image corner, as COLMAP writes them",
        ));
    }
    for observation in parsed
        .points
        .iter_mut()
        .flat_map(|point| &mut point.observations)
    {
        let center = sizes[observation.view as usize].map(image_center);
        observation.pixel = match (observation.pixel, center) {
            (Some([x, y]), Some([mx, my])) if are_relative => Some([x + mx, y + my]),
            (Some([x, y]), _) if !are_relative => Some([x - 0.5, y - 0.5]),
            _ => None,
        };
    }
    are_relative
}

fn model_of(
    parsed: NvmModel,
    sizes: &[Option<ImageSize>],
    path: &Path,
) -> Result<StoredModel, SequenceError> {
    let mut model = StoredModel::default();
    for (line, size) in parsed.cameras.into_iter().zip(sizes) {
        let content = |problem: String| SequenceError::Content {
            path: path.to_owned(),
            problem: format!("camera of {}: {problem}", line.name),
        };
        let [mx, my] = size.map_or([0.0, 0.0], image_center);
        let (fx, fy, cx, cy) = match parsed.fixed {
            Some([fx, cx, fy, cy]) => (fx, fy, cx, cy),
            None => (line.focal_px, line.focal_px, mx, my),
        };
        let camera = Camera::with_distortion(fx, fy, cx, cy, distortion(line.radial))
            .map_err(|error| content(error.to_string()))?;
        let known = CalibratedCamera::known(camera, *size, path.display().to_string());
        // Equal cameras are merged.
        let at = model.cameras.iter().position(|other| *other == known);
        let camera = at.unwrap_or_else(|| {
            model.cameras.push(known);
            model.cameras.len() - 1
        });
        model.images.push(ModelImage {
            name: line.name,
            camera: camera as u32,
            world_from_camera: line.world_from_camera,
            timestamp_ns: None,
        });
    }
    model.points = parsed.points;
    Ok(model)
}

/// The inverse distortion: the first terms of the inverse series of `u = m + d m^3`,
/// `m = u - d u^3 + 3 d^2 u^5 - 12 d^3 u^7`.
fn distortion(d: f64) -> Distortion {
    if d == 0.0 {
        return Distortion::None;
    }
    Distortion::RadialTangential {
        k1: -d,
        k2: 3.0 * d * d,
        p1: 0.0,
        p2: 0.0,
        k3: -12.0 * d * d * d,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distortion_is_inverted() {
        let lens = distortion(0.08);
        let camera = Camera::with_distortion(1000.0, 1000.0, 0.0, 0.0, lens).unwrap();
        let measured = 0.3_f64;
        let undistorted = measured * (1.0 + 0.08 * measured * measured);
        let seen = camera.project(&Point3::new(undistorted, 0.0, 1.0)).unwrap();
        assert!((seen.x - 1000.0 * measured).abs() < 1e-3, "{seen}");
    }
}
