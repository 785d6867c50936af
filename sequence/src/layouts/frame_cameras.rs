//! Cameras of recordings with intrinsics for each frame, as of phones that refocus.

use std::cmp::Ordering;

use linecarve_lines::camera::Camera;

use super::super::calibration::{CalibratedCamera, ImageSize};
use super::super::layout::Recording;

/// The cameras of frames, equal ones once.
#[derive(Debug, Default)]
pub(super) struct FrameCameras {
    cameras: Vec<CalibratedCamera>,
}

impl FrameCameras {
    /// Adds the camera of a frame; returns its index.
    pub(super) fn add(&mut self, camera: CalibratedCamera) -> u32 {
        // Equal cameras follow each other.
        if self
            .cameras
            .last()
            .is_none_or(|last| last.camera != camera.camera || last.size != camera.size)
        {
            self.cameras.push(camera);
        }
        (self.cameras.len() - 1) as u32
    }

    /// The camera to which the images of all frames are resampled: the one with the median focal length, and among equal
    /// ones with the median principal point.
    pub(super) fn main(&self) -> Option<CalibratedCamera> {
        let mut sorted: Vec<&CalibratedCamera> = self.cameras.iter().collect();
        let key = |one: &CalibratedCamera| [one.camera.fx(), one.camera.cx(), one.camera.cy()];
        sorted.sort_by(|a, b| {
            let mut orders = key(a).into_iter().zip(key(b)).map(|(a, b)| a.total_cmp(&b));
            let first = orders.find(|order| order.is_ne());
            first.unwrap_or(Ordering::Equal)
        });
        sorted.get(sorted.len() / 2).map(|camera| (*camera).clone())
    }

    /// Gives the cameras to a recording whose frames refer to them. One camera for all frames needs none.
    pub(super) fn give_to(self, recording: &mut Recording) {
        if self.cameras.len() < 2 {
            for frame in &mut recording.frames {
                frame.camera = None;
            }
            return;
        }
        recording.conventions.push(format!(
            "intrinsics: {} cameras, of one frame or a few; images and depth are resampled to one of them",
            self.cameras.len()
        ));
        recording.cameras = self.cameras;
    }
}

/// A pinhole camera of `fx fy cx cy`, where the centre of the first pixel is (0, 0).
///
/// # Errors
/// When the numbers are no camera.
pub(super) fn pinhole(
    [fx, fy, cx, cy]: [f64; 4],
    size: Option<ImageSize>,
    source: &str,
) -> Result<CalibratedCamera, String> {
    let camera = Camera::pinhole(fx, fy, cx, cy).map_err(|error| error.to_string())?;
    Ok(CalibratedCamera::known(camera, size, source))
}
