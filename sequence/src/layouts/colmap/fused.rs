//! The dense cloud of COLMAP: `fused.ply`, and in `fused.ply.vis` the images that see each point.

use std::path::{Path, PathBuf};

use linecarve_mesh::read_geometry;

use super::super::super::SequenceError;
use super::super::super::bytes::{ByteReader, read_file};
use super::super::super::layout::Folder;
use crate::sparse_model::{ModelObservation, ModelPoint};

const NAME: &str = "fused.ply";

/// Whether a file of this name is a dense cloud.
pub(super) fn is_cloud(name: &str) -> bool {
    name.eq_ignore_ascii_case(NAME)
}

/// The dense cloud that the user named, if it is one.
pub(super) fn named_cloud(folder: &Folder) -> Option<PathBuf> {
    let name = folder.file().filter(|name| is_cloud(name))?;
    Some(folder.path().join(name))
}

/// The file beside a cloud that lists the images of each point.
pub(super) fn visibility(cloud: &Path) -> PathBuf {
    let mut seen = cloud.as_os_str().to_owned();
    seen.push(".vis");
    PathBuf::from(seen)
}

/// Demands the file beside a cloud that lists the images of each point.
///
/// # Errors
/// When it is missing.
pub(super) fn demand_visibility(cloud: &Path) -> Result<(), SequenceError> {
    let path = visibility(cloud);
    if path.exists() {
        return Ok(());
    }
    Err(SequenceError::Content {
        problem: format!(
            "is missing, which lists the images that see each point of {}: fuse again (colmap stereo_fusion writes both), or give the \
             cameras to linecarve mesh with --cameras, which takes the normals of the points in its place",
            cloud.display()
        ),
        path,
    })
}

/// The points of a cloud. `view_of` has the view of each image, in the order of their ids.
pub(super) fn read_cloud(path: &Path, view_of: &[u32]) -> Result<Vec<ModelPoint>, SequenceError> {
    let content = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem,
    };
    let shape = read_geometry(path).map_err(|error| content(error.to_string()))?;
    demand_visibility(path)?;
    let seen = visibility(path);
    let bytes = read_file(&seen)?;
    let mut reader = ByteReader::new(&seen, &bytes);
    let count = reader.count("points", 4)?;
    if count != shape.positions.len() {
        return Err(content(format!(
            "has {} points, {} has {count}: fuse both again",
            shape.positions.len(),
            seen.display()
        )));
    }
    let mut points = Vec::with_capacity(count);
    for (index, &point_in_world) in shape.positions.iter().enumerate() {
        let mut observations = Vec::new();
        for _ in 0..reader.u32()? {
            let image = reader.u32()?;
            let Some(&view) = view_of.get(image as usize) else {
                return Err(reader.error(format!(
                    "names image {image}, and the model has {}: give the model that was fused",
                    view_of.len()
                )));
            };
            observations.push(ModelObservation { view, pixel: None });
        }
        points.push(ModelPoint {
            point_in_world,
            color: shape.colors.as_ref().map(|colors| colors[index]),
            observations,
        });
    }
    Ok(points)
}
