//! The decoupled baseline: segments are detected in the image first, then a line is fitted to the depths along each.

use std::time::Instant;

use nalgebra::{Point2, Point3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::image_segments::ImageSegments;
use super::line_detection::{LineDetectorOptions, LineSegment2d};
use super::method::{Findings, FoundSegment, LineMethod, Method, MethodError, PosedKeyframe};
use linecarve_lines::depth::InverseDepthMap;
use linecarve_lines::edges::EdgeOptions;
use linecarve_lines::fit::DepthModel;

/// Settings of [`Decoupled`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DecoupledOptions {
    /// Shorter image segments are left out.
    pub minimum_length_px: f64,
    /// The quantity that is fitted as linear along a segment.
    pub depth_model: DepthModel,
    /// A depth is an inlier within this share of the line's depth.
    pub depth_tolerance: f64,
    /// Least share of the pixels along a segment with a depth, and with one that is an inlier.
    pub minimum_inlier_share: f64,
    /// Smallest angle between a segment and the view rays of its ends; segments below it are left out.
    pub minimum_view_angle_rad: f64,
    /// Seed of the samples.
    pub seed: u64,
}

impl Default for DecoupledOptions {
    /// 30 % and 30 degrees are those of the public code of He et al.; inverse depth is linear along a segment, which
    /// makes this a stronger baseline than the depth of the paper.
    fn default() -> Self {
        Self {
            minimum_length_px: 20.0,
            depth_model: DepthModel::InverseDepth,
            depth_tolerance: 0.01,
            minimum_inlier_share: 0.3,
            minimum_view_angle_rad: 30.0_f64.to_radians(),
            seed: 1,
        }
    }
}

impl DecoupledOptions {
    fn validate(&self) -> Result<(), MethodError> {
        let refuse = |name, value| {
            Err(MethodError::Option {
                method: Method::Decoupled,
                name,
                value,
            })
        };
        for (name, value) in [
            ("minimum_length_px", self.minimum_length_px),
            ("minimum_inlier_share", self.minimum_inlier_share),
            ("minimum_view_angle_rad", self.minimum_view_angle_rad),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return refuse(name, value);
            }
        }
        if !(self.depth_tolerance.is_finite() && self.depth_tolerance > 0.0) {
            return refuse("depth_tolerance", self.depth_tolerance);
        }
        Ok(())
    }
}

/// A depth along a segment: share of the way, and the fitted quantity.
#[derive(Debug, Clone, Copy)]
struct Sample {
    share: f64,
    value: f64,
}

/// The decoupled baseline. [`LineDetector`](super::LineDetector) finds segments in the image. RANSAC fits a line to the depths
/// along each segment, with one iteration for each depth, and least squares refines it over the inliers.
/// The 3D ends are those of the image segment at the depth of the line.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV: the "decoupled" method of its tables.
///
/// *Differs from the paper*: the default is inverse depth instead of depth; RANSAC and the fit use the same quantity, which
/// those of the public code do not; samples are seeded, so that runs repeat.
#[derive(Debug, Clone)]
pub struct Decoupled {
    options: DecoupledOptions,
    segments: ImageSegments,
    samples: Vec<Sample>,
}

impl Decoupled {
    /// The method with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(
        edges: EdgeOptions,
        detector: LineDetectorOptions,
        options: DecoupledOptions,
    ) -> Result<Self, MethodError> {
        options.validate()?;
        Ok(Self {
            options,
            segments: ImageSegments::new(edges, detector)?,
            samples: Vec::new(),
        })
    }

    /// The depths at the two ends of an image segment; `None` when too few depths agree on a line.
    fn end_depths(
        &mut self,
        segment: &LineSegment2d,
        depth: &InverseDepthMap,
        rng: &mut ChaCha8Rng,
    ) -> Option<[f64; 2]> {
        let pixels = segment.length_px().ceil() as usize + 1;
        let along = segment.ends_px[1] - segment.ends_px[0];
        self.samples.clear();
        for step in 0..pixels {
            let share = step as f64 / (pixels - 1).max(1) as f64;
            let pixel = segment.ends_px[0] + share * along;
            if let Some(rho) = inverse_depth(depth, &pixel, 2.0 * self.options.depth_tolerance) {
                self.samples.push(Sample {
                    share,
                    value: self.value(rho),
                });
            }
        }
        let least = (self.options.minimum_inlier_share * pixels as f64).max(3.0);
        if (self.samples.len() as f64) < least {
            return None;
        }
        let mut line = self.sample_line(rng)?;
        // Twice, as the inliers of the refined line differ from those of the sampled one.
        for _ in 0..2 {
            line = self.least_squares(line)?;
        }
        let inliers = self
            .samples
            .iter()
            .filter(|sample| self.is_inlier(line, sample))
            .count();
        if (inliers as f64) < least {
            return None;
        }
        let depths = [0.0, 1.0].map(|share| self.depth(line[0] + line[1] * share));
        depths
            .iter()
            .all(|depth| depth.is_finite() && *depth > 0.0)
            .then_some(depths)
    }

    fn value(&self, rho: f64) -> f64 {
        match self.options.depth_model {
            DepthModel::InverseDepth => rho,
            DepthModel::Depth => 1.0 / rho,
        }
    }

    fn depth(&self, value: f64) -> f64 {
        match self.options.depth_model {
            DepthModel::InverseDepth => 1.0 / value,
            DepthModel::Depth => value,
        }
    }

    /// Whether a depth lies within the tolerance of a line `[at the start, slope]`.
    fn is_inlier(&self, line: [f64; 2], sample: &Sample) -> bool {
        let fitted = line[0] + line[1] * sample.share;
        // Both quantities have the same relative error, up to second order.
        fitted > 0.0 && (sample.value - fitted).abs() <= self.options.depth_tolerance * fitted
    }

    /// The line through two samples that has most inliers.
    fn sample_line(&self, rng: &mut ChaCha8Rng) -> Option<[f64; 2]> {
        let count = self.samples.len();
        let mut best = None;
        for _ in 0..count {
            let a = self.samples[rng.random_range(0..count)];
            let b = self.samples[rng.random_range(0..count)];
            // Two neighbouring depths do not determine the slope.
            if (a.share - b.share).abs() < 0.1 {
                continue;
            }
            let slope = (b.value - a.value) / (b.share - a.share);
            let line = [a.value - slope * a.share, slope];
            let inliers = self
                .samples
                .iter()
                .filter(|sample| self.is_inlier(line, sample))
                .count();
            if best.is_none_or(|(most, _)| inliers > most) {
                best = Some((inliers, line));
            }
        }
        best.map(|(_, line)| line)
    }

    /// The least squares line through the inliers of another.
    fn least_squares(&self, line: [f64; 2]) -> Option<[f64; 2]> {
        let (mut n, mut s, mut v, mut ss, mut sv) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for sample in self.samples.iter().filter(|s| self.is_inlier(line, s)) {
            n += 1.0;
            s += sample.share;
            v += sample.value;
            ss += sample.share * sample.share;
            sv += sample.share * sample.value;
        }
        let spread = n * ss - s * s;
        if n < 3.0 || spread <= 0.0 {
            return None;
        }
        let slope = (n * sv - s * v) / spread;
        Some([(v - slope * s) / n, slope])
    }

    /// The segment in the camera; `None` when it runs along the view ray.
    fn lift(
        &self,
        segment: &LineSegment2d,
        depths: [f64; 2],
        keyframe: &PosedKeyframe<'_>,
    ) -> Option<[Point3<f64>; 2]> {
        let at = |end: usize| {
            keyframe
                .camera
                .point_at_depth(&segment.ends_px[end], depths[end])
                .ok()
        };
        let ends = [at(0)?, at(1)?];
        let along = (ends[1] - ends[0]).try_normalize(0.0)?;
        let largest_cosine = self.options.minimum_view_angle_rad.cos();
        ends.iter()
            .all(|end| along.dot(&end.coords).abs() <= largest_cosine * end.coords.norm())
            .then_some(ends)
    }
}

/// The inverse depth at a position: bilinear between the four pixels around it, which is exact on a plane, or that of the nearest
/// pixel where one is unknown or they differ by more than the share `jump`.
pub(super) fn inverse_depth(
    depth: &InverseDepthMap,
    pixel: &Point2<f64>,
    jump: f64,
) -> Option<f64> {
    let rho = |x: f64, y: f64| {
        let measured = (x >= 0.0 && y >= 0.0).then(|| depth.get(x as usize, y as usize))?;
        Some(f64::from(measured?.rho))
    };
    let (x, y) = (pixel.x.floor(), pixel.y.floor());
    let (right, down) = (pixel.x - x, pixel.y - y);
    let around = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
    if let [Some(a), Some(b), Some(c), Some(d)] = around.map(|(dx, dy)| rho(x + dx, y + dy)) {
        let (least, most) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        if most - least <= jump * most {
            let (above, below) = (a + right * (b - a), c + right * (d - c));
            return Some(above + down * (below - above));
        }
    }
    rho(pixel.x.round(), pixel.y.round())
}

impl LineMethod for Decoupled {
    fn method(&self) -> Method {
        Method::Decoupled
    }

    fn process(
        &mut self,
        keyframe: &PosedKeyframe<'_>,
        findings: &mut Findings,
    ) -> Result<(), MethodError> {
        let depth = keyframe.require_depth(self.method())?;
        let segments = self.segments.find(keyframe, findings);
        let start = Instant::now();
        // A stream for each keyframe: its samples do not depend on earlier keyframes.
        let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed);
        rng.set_stream(u64::from(keyframe.number));
        for segment in &segments {
            if segment.length_px() < self.options.minimum_length_px {
                continue;
            }
            let lifted = self
                .end_depths(segment, depth, &mut rng)
                .and_then(|depths| self.lift(segment, depths, keyframe));
            if let Some(ends) = lifted {
                findings.segments.push(FoundSegment {
                    ends_in_world: ends.map(|end| keyframe.world_from_camera * end),
                    keyframe: Some(keyframe.number),
                });
            }
        }
        findings.add_time("fit", start.elapsed());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::depth::InverseDepth;

    use super::*;

    #[test]
    fn depth_is_that_of_the_position_and_not_across_a_jump() {
        let mut depth = InverseDepthMap::unknown(8, 6).unwrap();
        let plane = |x: f64, y: f64| 0.5 + 0.002 * x + 0.001 * y;
        for (x, y) in (0..6).flat_map(|y| (0..7).map(move |x| (x, y))) {
            let rho = if x < 5 {
                plane(x as f64, y as f64)
            } else {
                0.3
            };
            depth.set(x, y, InverseDepth::new(rho as f32, 0.01));
        }
        let at = |x, y| inverse_depth(&depth, &Point2::new(x, y), 0.02);
        for (x, y) in [(2.0, 3.0), (2.4, 3.7), (0.0, 0.5), (3.9, 4.9)] {
            assert!((at(x, y).unwrap() - plane(x, y)).abs() < 1e-6);
        }
        // Beside the jump and the unknown column that of the nearest pixel, beyond none.
        assert!((at(4.4, 2.0).unwrap() - plane(4.0, 2.0)).abs() < 1e-6);
        assert!((at(6.3, 2.0).unwrap() - 0.3).abs() < 1e-6);
        assert_eq!(
            (at(6.8, 2.0), at(-1.0, 2.0), at(f64::NAN, 2.0)),
            (None, None, None)
        );
    }
}
