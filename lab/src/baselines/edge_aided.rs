//! Edge-aided fitting behind the trait of the baselines.

use super::method::{Findings, FoundSegment, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::{ExtractOptions, SegmentExtractor};

/// [`SegmentExtractor`] as a [`LineMethod`]: the segments of each keyframe, not clustered.
#[derive(Debug, Clone)]
pub struct EdgeAided {
    extractor: SegmentExtractor,
}

impl EdgeAided {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: ExtractOptions) -> Result<Self, MethodError> {
        Ok(Self {
            extractor: SegmentExtractor::new(options)?,
        })
    }
}

impl LineMethod for EdgeAided {
    fn method(&self) -> Method {
        Method::EdgeAided
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let depth = keyframe.require_depth(self.method())?;
        let extraction = self.extractor.extract(
            keyframe.image,
            keyframe.rgb,
            depth,
            keyframe.camera,
            keyframe.number,
        )?;
        findings.add_time("edges", extraction.durations.edges);
        findings.add_time("edge depth", extraction.durations.edge_depth);
        findings.add_time("fit", extraction.durations.fit);
        findings
            .segments
            .extend(extraction.segments.iter().map(|segment| FoundSegment {
                ends_in_world: segment.ends_in_world(&keyframe.world_from_camera),
                keyframe: Some(keyframe.number),
            }));
        Ok(())
    }
}
