//! COLMAP's text model: cameras, images with observations, points with tracks.

use std::path::Path;

use linecarve_lines::camera::{Camera, Distortion};
use nalgebra::{Isometry3, Quaternion};

use super::posed_images;
use crate::Sequence;
use linecarve_mesh::files::{WriteError, write_atomically};

/// Why a COLMAP model cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum ColmapError {
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A view of the model has no camera.
    #[error("view {name} has no camera: COLMAP needs one for each image")]
    NoCamera {
        /// Name of the view.
        name: String,
    },
}

/// An image of the COLMAP model.
struct Image {
    name: String,
    camera: usize,
    world_from_camera: Isometry3<f64>,
    /// Pixels with point indices; the centre of the first pixel is (0, 0).
    observations: Vec<([f64; 2], usize)>,
}

/// Writes `cameras.txt`, `images.txt` and `points3D.txt` into an existing folder.
///
/// Writes all views and points of the sparse model, if there is one; observations without a pixel are written at the
/// projection of the point. Otherwise writes the frames and no points.
///
/// # Errors
/// If a file cannot be written, or a view has no camera.
pub fn write_colmap(folder: &Path, sequence: &Sequence) -> Result<(), ColmapError> {
    let color_size = sequence.color_size();
    let color_size = [color_size.width, color_size.height];
    // Models without image size and images: the principal point is near the centre.
    let size_for = |camera: &Camera| match sequence.frames() {
        [] => [camera.cx(), camera.cy()].map(|c| (2.0 * c + 1.0).clamp(1.0, 65535.0) as u32),
        _ => color_size,
    };
    let mut cameras: Vec<(Camera, [u32; 2])> = Vec::new();
    let mut camera_index = |camera: &Camera, size: [u32; 2]| {
        cameras
            .iter()
            .position(|(other, other_size)| other == camera && *other_size == size)
            .unwrap_or_else(|| {
                cameras.push((camera.clone(), size));
                cameras.len() - 1
            })
    };
    let mut images = Vec::new();
    let points = match sequence.sparse_model() {
        Some(model) => {
            for view in &model.views {
                let camera = view.camera.as_ref().ok_or_else(|| ColmapError::NoCamera {
                    name: view.name.clone(),
                })?;
                images.push(Image {
                    name: view.name.clone(),
                    camera: camera_index(camera, view.size_px.unwrap_or_else(|| size_for(camera))),
                    world_from_camera: view.world_from_camera,
                    observations: Vec::new(),
                });
            }
            model.points.as_slice()
        }
        None => {
            for (index, image) in posed_images(sequence).into_iter().enumerate() {
                let size = sequence.stored_size(index);
                images.push(Image {
                    camera: camera_index(&image.camera, [size.width, size.height]),
                    name: image.file,
                    world_from_camera: image.world_from_camera,
                    observations: Vec::new(),
                });
            }
            &[]
        }
    };
    // For each point: image, and index of the observation in that image.
    let mut tracks: Vec<Vec<(usize, usize)>> = Vec::with_capacity(points.len());
    for (index, point) in points.iter().enumerate() {
        let mut track = Vec::new();
        for observation in &point.observations {
            let Some(image) = images.get_mut(observation.view as usize) else {
                continue;
            };
            let pixel = observation.pixel.or_else(|| {
                let point_in_camera = image.world_from_camera.inverse() * point.point_in_world;
                cameras[image.camera]
                    .0
                    .project(&point_in_camera)
                    .map(|seen| [seen.x, seen.y])
            });
            if let Some(pixel) = pixel {
                track.push((observation.view as usize, image.observations.len()));
                image.observations.push((pixel, index));
            }
        }
        tracks.push(track);
    }
    write_atomically(&folder.join("cameras.txt"), |out| {
        writeln!(out, "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]")?;
        for (index, (camera, [width, height])) in cameras.iter().enumerate() {
            let (model, parameters) = parameters(camera);
            let parameters: Vec<String> = parameters.iter().map(ToString::to_string).collect();
            writeln!(
                out,
                "{} {model} {width} {height} {}",
                index + 1,
                parameters.join(" ")
            )?;
        }
        Ok(())
    })?;
    write_atomically(&folder.join("images.txt"), |out| {
        writeln!(out, "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")?;
        writeln!(out, "# POINTS2D[] as X Y POINT3D_ID")?;
        for (index, image) in images.iter().enumerate() {
            let pose = image.world_from_camera.inverse();
            let Quaternion { coords } = *pose.rotation.quaternion();
            let t = pose.translation.vector;
            writeln!(
                out,
                "{} {} {} {} {} {} {} {} {} {}",
                index + 1,
                coords.w,
                coords.x,
                coords.y,
                coords.z,
                t.x,
                t.y,
                t.z,
                image.camera + 1,
                image.name
            )?;
            let mut separator = "";
            for ([x, y], point) in &image.observations {
                write!(out, "{separator}{} {} {}", x + 0.5, y + 0.5, point + 1)?;
                separator = " ";
            }
            writeln!(out)?;
        }
        Ok(())
    })?;
    write_atomically(&folder.join("points3D.txt"), |out| {
        writeln!(
            out,
            "# POINT3D_ID X Y Z R G B ERROR TRACK[] as IMAGE_ID POINT2D_IDX"
        )?;
        for (index, (point, track)) in points.iter().zip(&tracks).enumerate() {
            let p = point.point_in_world;
            let [r, g, b] = point.color.unwrap_or([128; 3]);
            write!(out, "{} {} {} {} {r} {g} {b} 0", index + 1, p.x, p.y, p.z)?;
            for (image, index) in track {
                write!(out, " {} {index}", image + 1)?;
            }
            writeln!(out)?;
        }
        Ok(())
    })?;
    Ok(())
}

/// COLMAP's model name and parameters of a camera; the centre of COLMAP's first pixel is (0.5, 0.5).
fn parameters(camera: &Camera) -> (&'static str, Vec<f64>) {
    let mut values = vec![
        camera.fx(),
        camera.fy(),
        camera.cx() + 0.5,
        camera.cy() + 0.5,
    ];
    match *camera.distortion() {
        Distortion::None => ("PINHOLE", values),
        Distortion::RadialTangential { k1, k2, p1, p2, k3 } => {
            values.extend([k1, k2, p1, p2]);
            if k3 == 0.0 {
                return ("OPENCV", values);
            }
            values.extend([k3, 0.0, 0.0, 0.0]);
            ("FULL_OPENCV", values)
        }
        Distortion::KannalaBrandt { k1, k2, k3, k4 } => {
            values.extend([k1, k2, k3, k4]);
            ("OPENCV_FISHEYE", values)
        }
    }
}
