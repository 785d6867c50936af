//! Straight segments of an image, the input of the decoupled and the matched baseline.

use std::time::Instant;

use super::line_detection::{LineDetector, LineDetectorOptions, LineSegment2d};
use super::method::{Findings, MethodError, PosedKeyframe};
use linecarve_lines::ExtractError;
use linecarve_lines::edges::{EdgeChains, EdgeDetector, EdgeOptions};

/// Edge and segment detection with buffers that are reused from one image to the next.
#[derive(Debug, Clone)]
pub(super) struct ImageSegments {
    edges: EdgeDetector,
    detector: LineDetector,
    chains: EdgeChains,
}

impl ImageSegments {
    pub(super) fn new(
        edges: EdgeOptions,
        detector: LineDetectorOptions,
    ) -> Result<Self, MethodError> {
        Ok(Self {
            edges: EdgeDetector::new(edges).map_err(ExtractError::from)?,
            detector: LineDetector::new(detector)?,
            chains: EdgeChains::default(),
        })
    }

    /// The segments of a keyframe's image; the time goes to the stages `edges` and `segments`.
    pub(super) fn find(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Vec<LineSegment2d> {
        let start = Instant::now();
        self.edges
            .detect_into(keyframe.image, keyframe.rgb, &mut self.chains);
        let edges = start.elapsed();
        let segments = self.detector.detect(keyframe.image, &self.chains);
        findings.add_time("edges", edges);
        findings.add_time("segments", start.elapsed() - edges);
        segments
    }
}
