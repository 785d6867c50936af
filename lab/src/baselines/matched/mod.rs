//! The matched baseline: line segments of several images, matched, scored and grouped into 3D lines (Line3D++).

mod cut;
mod grouping;
mod line;
mod matching;
mod neighbours;
mod options;
mod scoring;
mod view;

use std::time::Instant;

use rayon::prelude::*;

use self::grouping::{Hypotheses, group};
use self::matching::{ViewMatches, match_view};
use self::view::View;
use super::image_segments::ImageSegments;
use super::line_detection::LineDetectorOptions;
use super::method::{Findings, FoundSegment, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::edges::EdgeOptions;

pub use options::MatchedOptions;

/// 3D lines from images and poses alone.
///
/// 1. Every view finds straight segments in its image.
/// 2. A segment is matched with those segments of each neighbouring view that overlap it between its epipolar lines; a match
///    gives the segment a position in space.
/// 3. The score of a match is the agreement with matches in *other* views: each view adds its best similarity in depth and
///    angle. The best match of a segment, when its score suffices, is the segment's hypothesis.
/// 4. Segments whose hypotheses agree are grouped over views; a group of at least three views gives a line.
/// 5. The line is refined on the images and cut to the parts that at least three views see.
///
/// # Complexity
/// For v views with n neighbours and s segments each, O(v n s²) epipolar tests; this dominates. Memory
/// is linear in the number of matches. The work on views and on groups is spread over threads.
///
/// # Reference
/// M. Hofer, M. Maurer, H. Bischof, Efficient 3D scene abstraction using line segments, Computer Vision and Image
/// Understanding, 2017 (Line3D++).
///
/// *Differs from the paper*: segments come from [`LineDetector`](super::LineDetector) instead of LSD; neighbours are chosen by their poses instead
/// of by shared points; every ordered pair of neighbours is matched, so that the result does
/// not depend on the order of views; groups are merged by dissimilarity, as Felzenszwalb & Huttenlocher define it; diffusion and
/// collinear neighbours, which are off by default there too, are left out.
#[derive(Debug, Clone)]
pub struct Matched {
    options: MatchedOptions,
    segments: ImageSegments,
    views: Vec<View>,
}

impl Matched {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        edges: EdgeOptions,
        detector: LineDetectorOptions,
        options: MatchedOptions,
    ) -> Result<Self, MethodError> {
        options.validate()?;
        Ok(Self {
            options,
            segments: ImageSegments::new(edges, detector)?,
            views: Vec::new(),
        })
    }
}

impl LineMethod for Matched {
    fn method(&self) -> Method {
        Method::Matched
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let segments = self.segments.find(keyframe, findings);
        self.views
            .push(View::new(keyframe, &segments, &self.options));
        Ok(())
    }

    fn finish(&mut self, findings: &mut Findings) {
        let options = &self.options;
        let views = std::mem::take(&mut self.views);
        let start = Instant::now();
        let neighbours = neighbours::choose(&views, options);
        let mut matches: Vec<ViewMatches> = (0..views.len())
            .into_par_iter()
            .map(|view| match_view(&views, view, &neighbours[view], options))
            .collect();
        let matched = start.elapsed();
        let best: Vec<_> = matches
            .par_iter_mut()
            .enumerate()
            .map(|(view, matches)| scoring::score(&views, view, matches, options))
            .collect();
        let scored = start.elapsed();
        let hypotheses = Hypotheses::new(&views, best);
        let groups = group(&views, &matches, &hypotheses, options);
        let grouped = start.elapsed();
        let lines: Vec<_> = groups
            .par_iter()
            .map(|members| {
                let Some(line) = line::fit(&views, &hypotheses, members) else {
                    return Vec::new();
                };
                let line = line::refine(&views, members, line, options);
                cut::cut(&views, members, &line, options)
            })
            .collect();
        findings
            .segments
            .extend(lines.into_iter().flatten().map(|ends| FoundSegment {
                ends_in_world: ends,
                keyframe: None,
            }));
        findings.add_time("match", matched);
        findings.add_time("score", scored - matched);
        findings.add_time("group", grouped - scored);
        findings.add_time("refine", start.elapsed() - grouped);
    }
}

#[cfg(test)]
mod tests;
