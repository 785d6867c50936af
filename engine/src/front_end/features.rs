//! ORB features of a keyframe.

use std::time::Instant;

use linecarve_points::{FeatureDetector, MapPointOptions};
use linecarve_sequence::Sequence;

use super::error::FrontEndError;
use super::keyframe::{FeatureKeyframe, Keyframe};
use super::{Arrivals, Group, prepare_independent};
use crate::run::{Checkpoint, StageTimes, milliseconds};

/// Detects ORB features in frames of a sequence. Needs no depth.
#[derive(Debug, Clone, Copy)]
pub struct FeatureFrontEnd {
    options: MapPointOptions,
}

impl FeatureFrontEnd {
    /// A front end with these options.
    pub fn new(options: MapPointOptions) -> Self {
        Self { options }
    }

    /// Loads one frame and detects its features.
    ///
    /// # Errors
    /// When the image cannot be read.
    pub fn process(
        &self,
        sequence: &Sequence,
        frame: usize,
    ) -> Result<FeatureKeyframe, FrontEndError> {
        let start = Instant::now();
        let image = sequence.load_gray(frame)?;
        let loaded = start.elapsed();
        let features = FeatureDetector::new(self.options).detect(&image);
        Ok(FeatureKeyframe {
            frame,
            world_from_camera: sequence.frames()[frame].world_from_camera,
            features,
            times: StageTimes {
                load: milliseconds(loaded),
                features: milliseconds(start.elapsed() - loaded),
                ..StageTimes::default()
            },
        })
    }

    pub(super) fn prepare(
        &self,
        sequence: &Sequence,
        group: Group<'_>,
        checkpoint: Option<&Checkpoint>,
    ) -> Arrivals {
        prepare_independent(
            self,
            group,
            checkpoint,
            |front_end, _, frame| front_end.process(sequence, frame),
            |keyframe| Keyframe::Features(Box::new(keyframe)),
        )
    }
}
