//! Map points that were dumped without what sees them: `x y z` a line or PLY, as many patches of ORB-SLAM write.
//!
//! Which frame sees which point is guessed from where they fall: inside the image, and not clearly behind a nearer point in
//! the same part of it. That is weaker than what a model knows, and said so.

use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3};

use super::super::layout::{Folder, Recording};
use super::super::text::{TextFile, parse_number};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning};
use crate::sparse_model::{ModelObservation, ModelPoint, ModelView, SparseModel};
use linecarve_mesh::read_geometry;

/// Usual names of dumps.
const NAMES: [&str; 9] = [
    "MapPoints.ply",
    "map_points.ply",
    "MapPointsSave.ply",
    "MapPointsSave.txt",
    "MapPoints.txt",
    "map_points.txt",
    "PointCloud.txt",
    "pointcloud.txt",
    "points.txt",
];

/// An image is divided into so many parts along its longer side.
const PARTS: u32 = 24;

/// A point further than this times the nearest in its part of an image may be hidden there.
const HIDDEN_BEYOND: f64 = 1.15;

/// Adds the points of a dump to a recording, when there is one.
pub(super) fn read_into(folder: &Folder, recording: &mut Recording) -> Result<(), SequenceError> {
    let Some(path) = folder.first_entry(&NAMES) else {
        return Ok(());
    };
    let points = read(&path, &mut recording.warnings)?;
    let Some(color) = recording
        .calibration
        .color
        .as_ref()
        .filter(|_| recording.frames.iter().all(|frame| frame.pose.is_some()))
    else {
        return Ok(());
    };
    let camera = color.camera.clone();
    // Without a stated size the principal point lies in the middle.
    let size = color
        .size
        .map_or([2.0 * camera.cx() + 1.0, 2.0 * camera.cy() + 1.0], |size| {
            [f64::from(size.width), f64::from(size.height)]
        });
    let views: Vec<ModelView> = recording
        .frames
        .iter()
        .map(|frame| ModelView {
            name: frame.name.clone(),
            world_from_camera: frame.pose.unwrap_or_default(),
            camera: Some(camera.clone()),
            size_px: None,
        })
        .collect();
    let mut model = SparseModel {
        views,
        points: points
            .into_iter()
            .map(|point_in_world| ModelPoint {
                point_in_world,
                color: None,
                observations: Vec::new(),
            })
            .collect(),
    };
    guess_observations(&mut model, &camera, size);
    recording.warnings.push(Warning::statement(format!(
        "{}: {} points without the frames that see them; these are guessed by projection, which is weaker than a model's \
         own tracks",
        path.display(),
        model.points.len()
    )));
    recording.sparse_model = Some(model);
    Ok(())
}

/// Lines `x y z` and what may follow.
fn read(path: &Path, warnings: &mut Vec<Warning>) -> Result<Vec<Point3<f64>>, SequenceError> {
    if path.extension().is_some_and(|end| end == "ply") {
        let shape = read_geometry(path).map_err(|error| SequenceError::Content {
            path: path.to_owned(),
            problem: error.to_string(),
        })?;
        return Ok(shape.positions);
    }
    let file = TextFile::read(path)?;
    let mut points = Vec::new();
    let (mut not_finite, mut total) = (WarningCounter::default(), 0);
    for row in file.rows() {
        if total == 0 && row.fields().next().and_then(parse_number).is_none() {
            continue;
        }
        total += 1;
        let point = Point3::from(row.numbers_from::<3>(0)?);
        if point.iter().all(|value| value.is_finite()) {
            points.push(point);
        } else {
            not_finite.add(format!("line {}", row.number()));
        }
    }
    warnings.extend(not_finite.into_warning(total, "map points are not finite and were left out"));
    Ok(points)
}

/// For each view the points that fall into its image and are not clearly behind the nearest in their part of it.
fn guess_observations(model: &mut SparseModel, camera: &Camera, [width, height]: [f64; 2]) {
    let part = (width.max(height) / f64::from(PARTS)).max(1.0);
    let columns = (width / part).ceil().max(1.0) as usize;
    let rows = (height / part).ceil().max(1.0) as usize;
    let mut nearest = vec![f64::INFINITY; columns * rows];
    let mut seen: Vec<(usize, usize, f64, [f64; 2])> = Vec::new();
    for (view, posed) in (0_u32..).zip(&model.views) {
        nearest.fill(f64::INFINITY);
        seen.clear();
        let camera_from_world: Isometry3<f64> = posed.world_from_camera.inverse();
        for (index, point) in model.points.iter().enumerate() {
            let point_in_camera = camera_from_world * point.point_in_world;
            let Some(pixel) = camera
                .project(&point_in_camera)
                .filter(|_| point_in_camera.z > 0.0)
            else {
                continue;
            };
            let (x, y) = (pixel.x + 0.5, pixel.y + 0.5);
            if !(x >= 0.0 && y >= 0.0 && x < width && y < height) {
                continue;
            }
            let cell = ((y / part) as usize).min(rows - 1) * columns
                + ((x / part) as usize).min(columns - 1);
            nearest[cell] = nearest[cell].min(point_in_camera.z);
            seen.push((index, cell, point_in_camera.z, [pixel.x, pixel.y]));
        }
        for &(index, cell, depth, pixel) in &seen {
            if depth <= HIDDEN_BEYOND * nearest[cell] {
                model.points[index].observations.push(ModelObservation {
                    view,
                    pixel: Some(pixel),
                });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_behind_others_or_the_camera_are_not_seen() {
        let camera = Camera::pinhole(100.0, 100.0, 49.5, 49.5).unwrap();
        let point = |x: f64, y: f64, z: f64| ModelPoint {
            point_in_world: Point3::new(x, y, z),
            color: None,
            observations: Vec::new(),
        };
        let mut model = SparseModel {
            views: vec![ModelView {
                name: "0".to_owned(),
                world_from_camera: Isometry3::identity(),
                camera: None,
                size_px: None,
            }],
            points: vec![
                point(0.01, 0.01, 1.0),
                point(0.02, 0.02, 2.0),
                point(0.5, 0.5, 2.0),
                point(0.0, 0.0, -1.0),
                point(9.0, 0.0, 1.0),
            ],
        };
        guess_observations(&mut model, &camera, [100.0, 100.0]);
        let seen: Vec<bool> = model
            .points
            .iter()
            .map(|p| !p.observations.is_empty())
            .collect();
        assert_eq!(seen, [true, false, true, false, false]);
    }
}
