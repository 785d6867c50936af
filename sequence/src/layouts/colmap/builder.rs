//! Builder of COLMAP models, shared by the text and the binary reader.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::super::super::calibration::CalibratedCamera;
use super::super::super::model::{ModelImage, PointBuilder, StoredModel};
use super::super::super::rigid;

/// Builds a model and resolves its ids. Error texts have no location; the readers add file and line or byte.
#[derive(Debug, Default)]
pub(super) struct ModelBuilder {
    model: StoredModel,
    points: PointBuilder,
    camera_of: BTreeMap<u32, u32>,
    view_of: BTreeMap<u32, u32>,
    /// Pairs of point id and image id.
    tracks: Vec<(u64, u32)>,
}

/// An image record of either format.
pub(super) struct ImageRecord {
    pub(super) id: u32,
    /// `qw qx qy qz tx ty tz`, camera from world.
    pub(super) pose: [f64; 7],
    pub(super) camera_id: u32,
    pub(super) name: String,
}

impl ModelBuilder {
    /// Adds a camera. Ids must be unique.
    pub(super) fn add_camera(&mut self, id: u32, camera: CalibratedCamera) -> Result<(), String> {
        let index = self.model.cameras.len() as u32;
        if self.camera_of.insert(id, index).is_some() {
            return Err(format!("camera id {id} is repeated"));
        }
        self.model.cameras.push(camera);
        Ok(())
    }

    /// Adds a point and the image ids of its track.
    pub(super) fn add_point(
        &mut self,
        id: u64,
        point_in_world: Point3<f64>,
        color: [u8; 3],
        images: impl IntoIterator<Item = u32>,
    ) {
        self.points.add(id, point_in_world, Some(color));
        self.tracks
            .extend(images.into_iter().map(|image| (id, image)));
    }

    /// Adds an image and returns its view index. Its camera must exist.
    pub(super) fn add_image(&mut self, record: ImageRecord) -> Result<u32, String> {
        let ImageRecord {
            id,
            pose: [qw, qx, qy, qz, tx, ty, tz],
            camera_id,
            name,
        } = record;
        let camera = *self
            .camera_of
            .get(&camera_id)
            .ok_or_else(|| format!("camera {camera_id} is not in the cameras file"))?;
        let camera_from_world = rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
            .map_err(|problem| format!("the pose of {name} {problem}"))?;
        let view = self.model.images.len() as u32;
        if self.view_of.insert(id, view).is_some() {
            return Err(format!("image id {id} is repeated"));
        }
        self.model.images.push(ModelImage {
            name,
            camera,
            world_from_camera: camera_from_world.inverse(),
            timestamp_ns: None,
        });
        Ok(view)
    }

    /// Adds an observation. The centre of COLMAP's first pixel is (0.5, 0.5).
    pub(super) fn add_observation(&mut self, point: u64, view: u32, [x, y]: [f64; 2]) {
        self.points
            .add_observation(point, view, Some([x - 0.5, y - 0.5]));
    }

    /// The view of each image, in the order of their ids.
    pub(super) fn views(&self) -> Vec<u32> {
        self.view_of.values().copied().collect()
    }

    /// The model. Tracks name views; where those list no pixels, the observation still counts.
    pub(super) fn finish(mut self) -> StoredModel {
        for (point, image) in self.tracks {
            if let Some(&view) = self.view_of.get(&image) {
                self.points.add_observation(point, view, None);
            }
        }
        self.model.points = self.points.finish();
        self.model
    }
}
