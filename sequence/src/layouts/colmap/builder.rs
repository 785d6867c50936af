//! A model under construction, whichever way its files are written.

use std::collections::BTreeMap;

use nalgebra::Point3;

use super::super::super::calibration::CalibratedCamera;
use super::super::super::model::{ModelImage, PointBuilder, StoredModel};
use super::super::super::rigid;

/// What the files say, their ids resolved as far as they are known. Errors are the problem alone; the place is the reader's
/// to name.
#[derive(Debug, Default)]
pub(super) struct ModelBuilder {
    model: StoredModel,
    points: PointBuilder,
    camera_of: BTreeMap<u32, u32>,
    view_of: BTreeMap<u32, u32>,
    /// Pairs of point and image id.
    tracks: Vec<(u64, u32)>,
}

/// An image as either kind of file has it.
pub(super) struct ImageRecord {
    pub(super) id: u32,
    /// `qw qx qy qz tx ty tz`, camera from world.
    pub(super) pose: [f64; 7],
    pub(super) camera_id: u32,
    pub(super) name: String,
}

impl ModelBuilder {
    /// Adds a camera; an id may stand there once.
    pub(super) fn add_camera(&mut self, id: u32, camera: CalibratedCamera) -> Result<(), String> {
        let index = self.model.cameras.len() as u32;
        if self.camera_of.insert(id, index).is_some() {
            return Err(format!("camera {id} stands there before"));
        }
        self.model.cameras.push(camera);
        Ok(())
    }

    /// Adds a point, and the ids of the images that its track names.
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

    /// Adds an image, whose camera must be there; gives its number.
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
            .ok_or_else(|| format!("there is no camera {camera_id} in the file of the cameras"))?;
        let camera_from_world = rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
            .map_err(|problem| format!("the pose of {name} {problem}"))?;
        let view = self.model.images.len() as u32;
        if self.view_of.insert(id, view).is_some() {
            return Err(format!("image {id} stands there before"));
        }
        self.model.images.push(ModelImage {
            name,
            camera,
            world_from_camera: camera_from_world.inverse(),
            timestamp_ns: None,
        });
        Ok(view)
    }

    /// Notes where an image shows a point. COLMAP's first pixel has its centre at (0.5, 0.5).
    pub(super) fn add_observation(&mut self, point: u64, view: u32, [x, y]: [f64; 2]) {
        self.points
            .add_observation(point, view, Some([x - 0.5, y - 0.5]));
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
