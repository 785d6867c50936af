//! OpenMVS: a scene in the interface format (`scene.mvs`) with cameras, poses, and points with visibility.
//!
//! The format stores the fields of each structure in sequence, little-endian: lists as a 64-bit count and their items,
//! text as a list of bytes. Later versions, given in the head, have more fields.

use std::path::{Path, PathBuf};

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3};

use super::super::bytes::{ByteReader, read_file};
use super::super::calibration::{CalibratedCamera, ImageSize};
use super::super::layout::{Folder, Layout, PoseSource, Recording};
use super::super::model::{ModelImage, StoredModel};
use super::super::{SequenceError, rigid};
use crate::sparse_model::{ModelObservation, ModelPoint};

/// Reader of OpenMVS.
pub(in super::super) struct OpenMvs;

const DEFAULT_NAME: &str = "scene.mvs";

/// Marks an absent id.
const NO_ID: u32 = u32::MAX;

/// The newest supported version of the format.
const MAX_VERSION: u32 = 7;

fn is_scene(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".mvs")
}

fn scene_path(folder: &Folder) -> Option<PathBuf> {
    if let Some(name) = folder.file() {
        return Some(folder.path().join(name));
    }
    folder.entry(DEFAULT_NAME).or_else(|| {
        let mut scenes = folder.names().iter().filter(|name| is_scene(name));
        let only = scenes.next().filter(|_| scenes.next().is_none());
        only.and_then(|name| folder.entry(name))
    })
}

impl Layout for OpenMvs {
    fn name(&self) -> &'static str {
        "openmvs"
    }

    fn expected_files(&self) -> &'static str {
        "scene.mvs, or one file *.mvs"
    }

    fn recognises(&self, folder: &Folder) -> bool {
        scene_path(folder).is_some()
    }

    fn recognises_file(&self, name: &str) -> bool {
        is_scene(name)
    }

    fn accepts_external_poses(&self) -> bool {
        false
    }

    fn read(&self, folder: &Folder, _origin: PoseSource) -> Result<Recording, SequenceError> {
        let path = scene_path(folder).ok_or_else(|| SequenceError::Content {
            path: folder.path().join(DEFAULT_NAME),
            problem: "is missing: give the file *.mvs itself".to_owned(),
        })?;
        let bytes = read_file(&path)?;
        let model = read_scene(&path, &bytes)?;
        // Image names are relative to the folder of the scene.
        let roots = [folder.path().to_owned(), folder.path().join("images")];
        let mut recording = model.into_recording(&path, &roots)?;
        recording.conventions.push(format!(
            "poses: {}, rotation camera from world and camera centre; images are undistorted",
            path.display()
        ));
        Ok(recording)
    }
}

/// A camera on a platform.
struct PlatformCamera {
    /// `Err` if unsupported; this affects only images that refer to it.
    camera: Result<CalibratedCamera, String>,
    camera_from_platform: [[f64; 3]; 3],
    center_in_platform: [f64; 3],
}

struct Platform {
    cameras: Vec<PlatformCamera>,
    /// Rotation platform from world, and the platform centre in world coordinates.
    poses: Vec<([[f64; 3]; 3], [f64; 3])>,
}

fn text(reader: &mut ByteReader) -> Result<String, SequenceError> {
    let length = reader.count("letters", 1)?;
    reader.text_of(length)
}

fn matrix(reader: &mut ByteReader) -> Result<[[f64; 3]; 3], SequenceError> {
    Ok([reader.f64s()?, reader.f64s()?, reader.f64s()?])
}

fn read_scene(path: &Path, bytes: &[u8]) -> Result<StoredModel, SequenceError> {
    let mut reader = ByteReader::new(path, bytes);
    if bytes.get(..4) != Some(b"MVSI") {
        return Err(reader.error(
            "is not a scene in OpenMVS's interface format, which starts with MVSI: save it with --archive-type 0",
        ));
    }
    reader.take(4)?;
    let version = reader.u32()?;
    if version > MAX_VERSION {
        return Err(reader.error(format!(
            "version {version} of the format is not supported; the newest supported is {MAX_VERSION}"
        )));
    }
    let _reserved = reader.u32()?;
    let platforms = read_platforms(&mut reader, version)?;
    let mut model = StoredModel::default();
    let view_of = read_images(&mut reader, version, &platforms, &mut model)?;
    read_vertices(&mut reader, &view_of, &mut model)?;
    Ok(model)
}

fn read_platforms(reader: &mut ByteReader, version: u32) -> Result<Vec<Platform>, SequenceError> {
    let mut platforms = Vec::new();
    for _ in 0..reader.count("platforms", 24)? {
        let _name = text(reader)?;
        let mut cameras = Vec::new();
        for _ in 0..reader.count("cameras", 8 + 21 * 8)? {
            let name = text(reader)?;
            if version > 3 {
                let _band = text(reader)?;
            }
            let (width, height) = if version > 0 {
                (reader.u32()?, reader.u32()?)
            } else {
                (0, 0)
            };
            let k = matrix(reader)?;
            cameras.push(PlatformCamera {
                camera: camera(&name, k, width, height),
                camera_from_platform: matrix(reader)?,
                center_in_platform: reader.f64s()?,
            });
        }
        let mut poses = Vec::new();
        for _ in 0..reader.count("poses", 12 * 8)? {
            poses.push((matrix(reader)?, reader.f64s()?));
        }
        platforms.push(Platform { cameras, poses });
    }
    Ok(platforms)
}

fn camera(
    name: &str,
    k: [[f64; 3]; 3],
    width: u32,
    height: u32,
) -> Result<CalibratedCamera, String> {
    if width == 0 || height == 0 {
        return Err(format!(
            "camera {name} has no image size, to which its focal length is relative: save the scene with a newer version"
        ));
    }
    if k[0][1].abs() > 1e-6 * k[0][0].abs() {
        return Err(format!(
            "camera {name} has a skew of {}, which is not supported",
            k[0][1]
        ));
    }
    let camera = Camera::pinhole(k[0][0], k[1][1], k[0][2], k[1][2])
        .map_err(|error| format!("camera {name}: {error}"))?;
    Ok(CalibratedCamera::known(
        camera,
        Some(ImageSize { width, height }),
        DEFAULT_NAME,
    ))
}

/// Adds the posed images; returns the view index of each image, `None` without a pose.
fn read_images(
    reader: &mut ByteReader,
    version: u32,
    platforms: &[Platform],
    model: &mut StoredModel,
) -> Result<Vec<Option<u32>>, SequenceError> {
    // Camera indices by platform and camera id.
    let mut camera_of = std::collections::BTreeMap::new();
    let mut view_of = Vec::new();
    for _ in 0..reader.count("images", 20)? {
        let name = text(reader)?;
        if version > 4 {
            let _mask = text(reader)?;
        }
        let (platform_id, camera_id, pose_id) = (reader.u32()?, reader.u32()?, reader.u32()?);
        if version > 2 {
            let _id = reader.u32()?;
        }
        if version > 6 {
            let _depths = [reader.f32()?, reader.f32()?, reader.f32()?];
            let scores = reader.count("scores of views", 24)?;
            reader.take(24 * scores)?;
        }
        if pose_id == NO_ID {
            view_of.push(None);
            continue;
        }
        let missing =
            |what: &str, id: u32| format!("image {name} refers to the missing {what} {id}");
        let platform = platforms
            .get(platform_id as usize)
            .ok_or_else(|| reader.error(missing("platform", platform_id)))?;
        let mounted = platform
            .cameras
            .get(camera_id as usize)
            .ok_or_else(|| reader.error(missing("camera", camera_id)))?;
        let pose = platform
            .poses
            .get(pose_id as usize)
            .ok_or_else(|| reader.error(missing("pose", pose_id)))?;
        let camera = match camera_of.get(&(platform_id, camera_id)) {
            Some(&index) => index,
            None => {
                let camera = mounted
                    .camera
                    .clone()
                    .map_err(|problem| reader.error(problem))?;
                let index = model.cameras.len() as u32;
                model.cameras.push(camera);
                camera_of.insert((platform_id, camera_id), index);
                index
            }
        };
        let platform_pose = pose_from_centre(&pose.0, &pose.1);
        let camera_pose =
            pose_from_centre(&mounted.camera_from_platform, &mounted.center_in_platform);
        let world_from_camera = match (platform_pose, camera_pose) {
            (Ok(platform), Ok(camera)) => platform * camera,
            (Err(problem), _) | (_, Err(problem)) => {
                return Err(reader.error(format!("the pose of image {name} {problem}")));
            }
        };
        view_of.push(Some(model.images.len() as u32));
        model.images.push(ModelImage {
            name,
            camera,
            world_from_camera,
            timestamp_ns: None,
        });
    }
    Ok(view_of)
}

/// The transform outer from inner, of the rotation inner from outer and the inner origin in outer coordinates.
fn pose_from_centre(
    rotation: &[[f64; 3]; 3],
    centre: &[f64; 3],
) -> Result<Isometry3<f64>, rigid::RigidTransformError> {
    let r = rotation;
    let c = centre;
    // The transposed rotation is outer from inner.
    rigid::from_matrix(&[
        [r[0][0], r[1][0], r[2][0], c[0]],
        [r[0][1], r[1][1], r[2][1], c[1]],
        [r[0][2], r[1][2], r[2][2], c[2]],
        [0.0, 0.0, 0.0, 1.0],
    ])
}

fn read_vertices(
    reader: &mut ByteReader,
    view_of: &[Option<u32>],
    model: &mut StoredModel,
) -> Result<(), SequenceError> {
    for _ in 0..reader.count("points", 20)? {
        let [x, y, z] = [reader.f32()?, reader.f32()?, reader.f32()?].map(f64::from);
        let mut observations = Vec::new();
        for _ in 0..reader.count("observations of a point", 8)? {
            let image = reader.u32()?;
            let _confidence = reader.f32()?;
            match view_of.get(image as usize) {
                Some(Some(view)) => observations.push(ModelObservation {
                    view: *view,
                    pixel: None,
                }),
                Some(None) => {}
                None => {
                    return Err(reader.error(format!(
                        "a point is observed by image {image} of {}",
                        view_of.len()
                    )));
                }
            }
        }
        model.points.push(ModelPoint {
            point_in_world: Point3::new(x, y, z),
            color: None,
            observations,
        });
    }
    // Normals, then colours in order blue, green, red. Either list may be empty, or both absent.
    if reader.is_at_end() {
        return Ok(());
    }
    let normals = reader.count("normals", 12)?;
    reader.take(12 * normals)?;
    let colors = reader.count("colours", 3)?;
    if colors == model.points.len() {
        for point in &mut model.points {
            let [blue, green, red] = [reader.u8()?, reader.u8()?, reader.u8()?];
            point.color = Some([red, green, blue]);
        }
    }
    Ok(())
}
