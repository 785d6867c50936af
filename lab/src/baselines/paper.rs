//! The published fit to the letter, as a method.

use std::time::Instant;

use super::method::{Findings, FoundSegment, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::ExtractError;
use linecarve_lines::edges::{EdgeChains, EdgeDetector, EdgeOptions};
use linecarve_lines::paper::{PaperFitter, PaperInput, PaperOptions};

/// [`PaperFitter`] on the edge chains and depths of each keyframe.
#[derive(Debug, Clone)]
pub struct Paper {
    fitter: PaperFitter,
    detector: EdgeDetector,
    chains: EdgeChains,
}

impl Paper {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(edges: EdgeOptions, options: PaperOptions) -> Result<Self, MethodError> {
        Ok(Self {
            fitter: PaperFitter::new(options).map_err(|error| MethodError::Option {
                method: Method::Paper,
                name: error.name,
                value: error.value,
            })?,
            detector: EdgeDetector::new(edges).map_err(ExtractError::from)?,
            chains: EdgeChains::default(),
        })
    }
}

impl LineMethod for Paper {
    fn method(&self) -> Method {
        Method::Paper
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let depth = keyframe.require_depth(self.method())?;
        let start = Instant::now();
        self.detector
            .detect_into(keyframe.image, None, &mut self.chains);
        findings.add_time("edges", start.elapsed());
        let start = Instant::now();
        let segments = self.fitter.fit(&PaperInput {
            chains: &self.chains,
            depth,
            image: self.detector.smoothed(),
            camera: keyframe.camera,
            keyframe: keyframe.number,
        });
        findings
            .segments
            .extend(segments.iter().map(|segment| FoundSegment {
                ends_in_world: segment.ends_in_world(&keyframe.world_from_camera),
                keyframe: Some(keyframe.number),
            }));
        findings.add_time("fit", start.elapsed());
        Ok(())
    }
}
