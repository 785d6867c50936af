//! Poses, lens and focal length that the images contradict.

use linecarve_sequence::Sequence;

use super::{Recording, RecordingError};
use crate::front_end::correct_poses;
use crate::run::{Progress, Verbosity};

impl Recording {
    /// Corrects the poses of the keyframes, and the lens, where the images contradict them; or the focal length, where that explains
    /// the images.
    ///
    /// # Errors
    /// When an image cannot be read, or the estimated lens is no camera.
    pub fn correct_poses(&mut self, verbosity: Verbosity) -> Result<(), RecordingError> {
        let compare = |sequence: &Sequence| {
            let mut progress = Progress::start("poses", self.keyframes.len(), verbosity);
            let corrected = correct_poses(sequence, &self.keyframes, &self.options, || {
                progress.step(|| "comparing poses with images".to_owned());
            });
            progress.finish();
            corrected
        };
        let mut corrected = compare(&self.sequence)?;
        let focal_factor = corrected.summary.focal_factor;
        if let Some(factor) = focal_factor {
            self.sequence.scale_focal_length(factor)?;
            corrected = compare(&self.sequence)?;
            let focal = self.sequence.color_camera().mean_focal_px();
            self.warnings.push(focal_warning(focal, factor));
        }
        let mut summary = corrected.summary;
        summary.focal_factor = focal_factor;
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
        if let Some(k1) = summary.lens_k1 {
            self.sequence.set_radial_distortion(k1)?;
            self.warnings.push(lens_warning(k1));
        }
        self.poses = Some(summary);
        Ok(())
    }
}

/// Says that images and poses belong to another focal length than the given one.
fn focal_warning(focal: f64, factor: f64) -> String {
    format!(
        "the images agree with the poses at a focal length of {focal:.1} pixels, {factor:.4} times the given one, which is used instead \
         ([pose_correction] lens = false keeps the given one; to say what a calibration found: [color] fx, fy in linecarve.toml)"
    )
}

/// Says that images were distorted although their camera is given as a pinhole.
pub(crate) fn lens_warning(k1: f64) -> String {
    format!(
        "the images are not those of a pinhole: radial distortion k1 = {k1:.4} is taken out ([pose_correction] lens = false takes them \
         as they are; to say it, or what a calibration found, in linecarve.toml: [color] model = \"radial-tangential\", distortion = \
         [{k1:.4}, 0.0, 0.0, 0.0])"
    )
}
