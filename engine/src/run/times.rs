//! Processing times of a keyframe by stage.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Milliseconds of each stage of a keyframe.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct StageTimes {
    /// Reading and decoding of images.
    pub load: f64,
    /// Depth in the colour camera.
    pub depth: f64,
    /// Edge detection.
    pub edges: f64,
    /// Feature detection.
    pub features: f64,
    /// Segment fitting along the chains.
    pub fit: f64,
    /// Clustering of segments.
    pub cluster: f64,
    /// Choice of points and association with landmarks.
    pub points: f64,
    /// Insertion of points, ray walks and labelling.
    pub carve: f64,
    /// Validation and correction of the surface with dense depth.
    #[serde(rename = "support")]
    pub validation: f64,
    /// Surface extraction.
    pub surface: f64,
    /// Writing of files.
    pub write: f64,
}

impl StageTimes {
    fn values(&self) -> [f64; 11] {
        let mut times = *self;
        times.values_mut().map(|value| *value)
    }

    fn values_mut(&mut self) -> [&mut f64; 11] {
        [
            &mut self.load,
            &mut self.depth,
            &mut self.edges,
            &mut self.features,
            &mut self.fit,
            &mut self.cluster,
            &mut self.points,
            &mut self.carve,
            &mut self.validation,
            &mut self.surface,
            &mut self.write,
        ]
    }

    /// Sum of all stages.
    pub fn total(&self) -> f64 {
        self.values().iter().sum()
    }

    /// Mean of each stage over `count`, rounded to microseconds; the sum when `count` is 0.
    pub fn divided_by(&self, count: usize) -> Self {
        let mut mean = *self;
        for value in mean.values_mut() {
            *value = (*value / count.max(1) as f64 * 1e3).round() / 1e3;
        }
        mean
    }

    /// Adds the times of each stage.
    pub fn add(&mut self, other: &Self) {
        for (sum, value) in self.values_mut().into_iter().zip(other.values()) {
            *sum += value;
        }
    }
}

/// A duration in milliseconds, rounded to microseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    (duration.as_secs_f64() * 1e6).round() / 1e3
}
