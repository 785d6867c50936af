//! Poses and cameras that the images contradict.

use linecarve_lines::camera::{Camera, CameraCorrection};

use super::{Recording, RecordingError};
use crate::front_end::correct_poses;
use crate::run::ProgressHook;

impl Recording {
    /// Corrects the camera, or the poses of the keyframes, where that explains the images.
    ///
    /// # Errors
    /// When an image cannot be read, or the estimated camera is none.
    pub fn correct_poses(&mut self, progress: &ProgressHook) -> Result<(), RecordingError> {
        let mut task = progress.begin("poses", self.keyframes.len(), "comparing poses with images");
        let step = || task.step();
        let corrected = correct_poses(&self.sequence, &self.keyframes, &self.options, step)?;
        drop(task);
        let summary = corrected.summary;
        if summary.is_corrected {
            let keyframes = || self.keyframes.iter().copied();
            self.sequence.set_poses(keyframes().zip(corrected.placed));
            self.sequence
                .set_fitted_poses(keyframes().zip(corrected.fitted));
            self.warnings.push(format!(
                "the images disagree with the poses of {} keyframes, by {:.1} pixels in direction and {:.1} in place (RMS): \
                 depth comes from corrected poses, keyframes are where the given poses around them say \
                 ([pose_correction] enabled = false takes poses as they are)",
                summary.keyframes, summary.turn_px, summary.shift_px
            ));
        }
        if let Some(readout) = summary.rolling_shutter {
            self.warnings.push(format!(
                "the images are those of a rolling shutter, whose rows take {:.0} % of the time between two frames: the given poses are kept, \
                 and depth from images is less accurate; a slower camera, or one with a global shutter, does better",
                100.0 * readout.abs()
            ));
        }
        if let Some(correction) = &summary.camera {
            let given = self.sequence.stored_color_camera();
            self.warnings.extend(camera_warning(given, correction));
            self.sequence.correct_color_camera(correction)?;
        }
        self.poses = Some(summary);
        Ok(())
    }
}

/// Says that the images are those of another camera than the given one.
pub fn camera_warning(given: &Camera, correction: &CameraCorrection) -> Option<String> {
    let CameraCorrection {
        k1, k2, k3, p1, p2, ..
    } = correction;
    let corrected = correction.applied_to(given).ok()?;
    let [fx, fy, cx, cy] = [
        corrected.fx(),
        corrected.fy(),
        corrected.cx(),
        corrected.cy(),
    ];
    Some(format!(
        "the images are not those of the given camera: focal lengths {fx:.1}, {fy:.1} (given: {:.1}, {:.1}), principal point {cx:.1}, {cy:.1} \
         ({:.1}, {:.1}), distortion {k1:.4}, {k2:.4}, {p1:.4}, {p2:.4}, {k3:.4} (k1, k2, p1, p2, k3) are used instead ([pose_correction] lens = false keeps the given ones; to say \
         them, or what a calibration found, in linecarve.toml: [color] fx = {fx:.2}, fy = {fy:.2}, cx = {cx:.2}, cy = {cy:.2}, model = \
         \"radial-tangential\", distortion = [{k1:.4}, {k2:.4}, {p1:.4}, {p2:.4}, {k3:.4}])",
        given.fx(),
        given.fy(),
        given.cx(),
        given.cy()
    ))
}
