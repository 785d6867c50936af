//! Depth images that disagree with each other: layers that are moved onto one surface, and what their confidence is worth.

use nalgebra::Isometry3;

use super::{Recording, RecordingError};
use crate::front_end::{
    ImagePosesError, KeyframeDepths, LayerSummary, class_noise, measure_confidence,
    read_keyframe_depth,
};
use crate::run::ProgressHook;
use linecarve_tracking::{LayerAlignment, align_layers, compare_layers};

/// Pairs of keyframes that are compared first.
const FIRST_PAIRS: usize = 8;

impl Recording {
    /// Compares the depth of 16 keyframes and, if these can be brought closer or have a confidence, of all. Corrects their poses and the scale and
    /// shift of their depth where held-back overlaps say that their surfaces then agree, and measures what classes of confidence are worth.
    ///
    /// # Errors
    /// When an image cannot be read, and the error is not limited to it.
    pub fn compare_depth(&mut self, progress: &ProgressHook) -> Result<(), RecordingError> {
        let is_corrected = self.options.pose_correction.enabled && !self.is_tracked;
        let Some(sensor) = self.source.sensor() else {
            return Ok(());
        };
        if !is_corrected && !self.sequence.has_confidence() {
            return Ok(());
        }
        let noise = sensor.noise;
        let read = |frames: &[usize]| {
            let read = read_keyframe_depth(&self.sequence, frames, noise);
            read.map_err(ImagePosesError::Image)
        };
        let mut task = progress.begin("depth", self.keyframes.len(), "comparing depth images");
        let first = first_compared(&self.keyframes);
        if !self.sequence.has_confidence() && first.len() < self.keyframes.len() {
            let KeyframeDepths { layers, .. } = read(&first)?;
            let alignment = align_layers(&layers);
            if alignment.model.is_none() {
                self.layers = Some(LayerSummary::of(&layers, &alignment));
                task.set(self.keyframes.len());
                return Ok(());
            }
        }
        let keyframes = read(&self.keyframes)?;
        task.set(self.keyframes.len());
        drop(task);
        let layers = &keyframes.layers;
        let alignment = match is_corrected {
            true => align_layers(layers),
            false => compare_layers(layers),
        };
        if let Some(classes) = measure_confidence(&keyframes, &alignment) {
            self.sequence.set_class_noise(&class_noise(&classes));
            self.confidence = classes;
        }
        if is_corrected {
            let summary = LayerSummary::of(layers, &alignment);
            self.layers = Some(summary);
            if alignment.model.is_some() {
                self.place_layers(&keyframes.frames, &alignment);
                self.warnings.push(layer_warning(&summary));
            }
        }
        Ok(())
    }

    fn place_layers(&mut self, frames: &[usize], alignment: &LayerAlignment) {
        let calibration = self.sequence.depth_calibration();
        let color_from_depth =
            calibration.map_or_else(Isometry3::identity, |it| it.color_from_depth);
        let depth_from_color = color_from_depth.inverse();
        let placed = || frames.iter().copied().zip(&alignment.placements);
        let poses = placed().map(|(frame, one)| (frame, one.world_from_camera * depth_from_color));
        self.sequence.set_poses(poses);
        let corrections = placed().map(|(frame, one)| (frame, one.depth));
        self.sequence.set_depth_corrections(corrections);
    }

    /// Whether the images changed poses, camera or depth, or say what confidence is worth.
    pub(crate) fn is_corrected_by_images(&self) -> bool {
        self.has_corrected_poses()
            || self.poses.is_some_and(|poses| poses.camera.is_some())
            || !self.confidence.is_empty()
    }

    /// Whether keyframes are not where the recording says.
    pub(crate) fn has_corrected_poses(&self) -> bool {
        self.poses.is_some_and(|poses| poses.is_corrected)
            || self.layers.is_some_and(|layers| layers.corrected != "none")
    }
}

/// Keyframes whose depth is compared first: pairs of neighbours, spread evenly. Errors of single keyframes show between neighbours, drift
/// between pairs.
fn first_compared(keyframes: &[usize]) -> Vec<usize> {
    if keyframes.len() <= 2 * FIRST_PAIRS {
        return keyframes.to_vec();
    }
    let pairs = (0..FIRST_PAIRS).map(|pair| pair * (keyframes.len() - 2) / (FIRST_PAIRS - 1));
    pairs
        .flat_map(|at| [keyframes[at], keyframes[at + 1]])
        .collect()
}

fn layer_warning(summary: &LayerSummary) -> String {
    let is_moved = summary.translation > 0.0 || summary.rotation_deg > 0.0;
    let what = match (summary.corrected, is_moved) {
        ("poses", _) => "poses",
        ("scales", true) => "poses and scales",
        ("scales", false) => "scales",
        (_, true) => "poses, scales and shifts",
        (_, false) => "scales and shifts",
    };
    format!(
        "the depth images of keyframes disagree with each other by {:.1} % of the depth: corrected {what} bring that to {:.1} % \
         ([pose_correction] enabled = false takes poses and depth as they are)",
        100.0 * summary.distance,
        100.0 * summary.corrected_distance
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_compared_first_from_the_first_to_the_last() {
        let keyframes: Vec<usize> = (0..100).map(|number| 3 * number).collect();
        let first = first_compared(&keyframes);
        assert_eq!(first.len(), 16);
        assert!(first.is_sorted_by(|a, b| a < b));
        assert_eq!(
            (first[..2].to_vec(), first[14..].to_vec()),
            (vec![0, 3], vec![294, 297])
        );
        assert!(first.chunks(2).all(|pair| pair[1] == pair[0] + 3));
        assert_eq!(first_compared(&keyframes[..16]), keyframes[..16]);
        assert_eq!(first_compared(&keyframes[..17]).len(), 16);
    }
}
