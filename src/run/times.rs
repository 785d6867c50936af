//! Processor time of the stages of a keyframe.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Milliseconds of the stages of one keyframe.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct StageTimes {
    /// Reading and decoding images.
    pub load: f64,
    /// Depth of the keyframe in the colour camera.
    pub depth: f64,
    /// Edge chains.
    pub edges: f64,
    /// Features.
    pub features: f64,
    /// Segments fitted along the chains.
    pub fit: f64,
    /// Segments joined to clusters.
    pub cluster: f64,
    /// Points chosen along the segments and matched with older ones.
    pub points: f64,
    /// Points inserted, rays walked, cells labelled.
    pub carve: f64,
    /// The surface compared with the depth of keyframes, and corrected.
    pub support: f64,
    /// Surface extracted.
    pub surface: f64,
    /// Files written.
    pub write: f64,
}

impl StageTimes {
    /// All stages together.
    pub fn total(&self) -> f64 {
        self.load
            + self.depth
            + self.edges
            + self.features
            + self.fit
            + self.cluster
            + self.points
            + self.carve
            + self.support
            + self.surface
            + self.write
    }

    /// Stage by stage mean over `count`; zero of nothing.
    pub fn divided_by(&self, count: usize) -> Self {
        let mean = |sum: f64| (sum / count.max(1) as f64 * 1e3).round() / 1e3;
        Self {
            load: mean(self.load),
            depth: mean(self.depth),
            edges: mean(self.edges),
            features: mean(self.features),
            fit: mean(self.fit),
            cluster: mean(self.cluster),
            points: mean(self.points),
            carve: mean(self.carve),
            support: mean(self.support),
            surface: mean(self.surface),
            write: mean(self.write),
        }
    }

    /// Stage by stage sum.
    pub fn add(&mut self, other: &Self) {
        self.load += other.load;
        self.depth += other.depth;
        self.edges += other.edges;
        self.features += other.features;
        self.fit += other.fit;
        self.cluster += other.cluster;
        self.points += other.points;
        self.carve += other.carve;
        self.support += other.support;
        self.surface += other.surface;
        self.write += other.write;
    }
}

/// A duration in milliseconds, rounded to microseconds.
pub fn milliseconds(duration: Duration) -> f64 {
    (duration.as_secs_f64() * 1e6).round() / 1e3
}
