//! Map points without observations, as written by patches of ORB-SLAM: `x y z` a line, or PLY.
//!
//! Observations are estimated by projection: a view observes a point that projects into its image and is not clearly
//! behind a nearer point in the same image cell. A warning says so, since these are less reliable than feature tracks.

use std::path::Path;

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3};

use super::super::layout::{Folder, Recording};
use super::super::text::{TextFile, parse_number};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning};
use crate::sparse_model::{ModelObservation, ModelPoint, ModelView, SparseModel};
use linecarve_mesh::read_geometry;

/// Usual file names.
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

/// Number of visibility cells along the longer image side.
const CELLS: u32 = 24;

/// Depth relative to the nearest point of a cell beyond which a point counts as occluded.
const MAX_RELATIVE_DEPTH: f64 = 1.15;

/// Adds the points of a dump, if any, to a recording.
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
    // Without an image size the principal point is assumed at the centre.
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
    estimate_observations(&mut model, &camera, size);
    recording.warnings.push(Warning::statement(format!(
        "{}: {} points without observations; these are estimated by projection, which is less reliable than feature \
         tracks",
        path.display(),
        model.points.len()
    )));
    recording.sparse_model = Some(model);
    Ok(())
}

/// Reads a PLY file, or lines `x y z`; further fields are ignored.
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
    warnings.extend(not_finite.into_warning(total, "map points are not finite and were skipped"));
    Ok(points)
}

/// Adds an observation for each point that projects into a view and is not occluded in its cell.
fn estimate_observations(model: &mut SparseModel, camera: &Camera, [width, height]: [f64; 2]) {
    let cell_px = (width.max(height) / f64::from(CELLS)).max(1.0);
    let columns = (width / cell_px).ceil().max(1.0) as usize;
    let rows = (height / cell_px).ceil().max(1.0) as usize;
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
            let cell = ((y / cell_px) as usize).min(rows - 1) * columns
                + ((x / cell_px) as usize).min(columns - 1);
            nearest[cell] = nearest[cell].min(point_in_camera.z);
            seen.push((index, cell, point_in_camera.z, [pixel.x, pixel.y]));
        }
        for &(index, cell, depth, pixel) in &seen {
            if depth <= MAX_RELATIVE_DEPTH * nearest[cell] {
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
    fn points_behind_others_or_the_camera_are_not_observed() {
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
        estimate_observations(&mut model, &camera, [100.0, 100.0]);
        let seen: Vec<bool> = model
            .points
            .iter()
            .map(|p| !p.observations.is_empty())
            .collect();
        assert_eq!(seen, [true, false, true, false, false]);
    }
}
