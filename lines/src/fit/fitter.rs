//! Growing of segments along edge chains (Algorithm 1 of the paper).

use std::ops::Range;

use nalgebra::Vector2;

use super::build::build;
use super::moments::{DepthLine, DepthMoments, ImageLine, ImageMoments};
use super::options::{DepthModel, FitOptions, FitOptionsError, Limits};
use super::segment::Segment;
use crate::camera::Camera;
use crate::depth::{EdgeDepths, InverseDepth};
use crate::edges::EdgeChains;
use crate::image::GrayImage;

/// Growth ends where the least share of inliers would be reached again after a run of inliers only that is longer than the dense part
/// before, and than this many windows: without this bound sparse depths cost their whole chain at each pixel.
const SPARSE_WINDOWS: usize = 4;

/// Input of a fit: edges, depths and pinhole camera of one keyframe.
#[derive(Debug, Clone, Copy)]
pub struct FitInput<'a> {
    /// Edge chains of the keyframe.
    pub chains: &'a EdgeChains,
    /// The depth of each chain pixel.
    pub depths: &'a EdgeDepths,
    /// The smoothed image, for the gradient along segments.
    pub image: &'a GrayImage,
    /// The pinhole camera of the image.
    pub camera: &'a Camera,
    /// Index of the keyframe, stored with each segment.
    pub keyframe: u32,
}

/// Fits 3D segments along edge chains.
///
/// A segment grows pixel by pixel along its chain as two 2D lines: one in the image, one of depth over the position along the first. The
/// initial fit uses a window of L pixels. A pixel is an inlier when it lies within e1 of the image line and its depth within e2 of the
/// depth line; a pixel without depth is an outlier. L consecutive outliers end the segment, which is cut back to the longest
/// beginning with the least share of inliers. Both lines are then refitted to the inliers, and the first and last inlier,
/// projected onto the lines, are the ends.
///
/// # Complexity
/// Linear in the number of chain pixels: running sums make the cost of a fit independent of its length.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section III-B, Algorithm 1.
///
/// *Differs from the paper*; all but the first and the last can be switched off in [`FitOptions`]:
/// - The initial window is validated, and shifted by one pixel when its pixels do not lie on a line.
/// - Weighted inverse depth is fitted instead of depth, because it is linear along the image of a line.
/// - A depth within its standard deviation is an inlier even beyond e2; at large depths e2 is below the sensor noise.
/// - Both lines are refitted while the segment grows, because the direction of L pixels is too inaccurate to extrapolate.
/// - Pixels are taken at the sub-pixel gradient maximum. On an edge nearly parallel to the pixel rows, whole pixels have the direction of
///   the row, and e1 is smaller than the step to the next row.
/// - A segment is cut back where its inliers become sparse, and growth ends where they stay so. Single inliers at short intervals, as on a line that the chain crosses
///   again and again, would otherwise extend it without support.
/// - The search continues after the last inlier of a segment, not after its trailing outliers, which may start the next segment.
#[derive(Debug, Clone)]
pub struct SegmentFitter {
    options: FitOptions,
}

/// The chain being processed.
struct Chain<'a> {
    pixels: &'a [[u16; 2]],
    positions: &'a [[f32; 2]],
    /// Index of the first pixel among all chain pixels.
    start: usize,
    index: u32,
    depths: &'a EdgeDepths,
    focal_px: f64,
    limits: Limits,
    options: &'a FitOptions,
}

/// The two lines of a segment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lines {
    pub(super) image: ImageLine,
    pub(super) depth: DepthLine,
}

/// The sums of a segment and the pixel that its coordinates are relative to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sums {
    pub(super) origin: Vector2<f64>,
    pub(super) image: ImageMoments,
    pub(super) depth: DepthMoments,
    /// Focal length over the reference depth for [`DepthModel::Depth`].
    pub(super) scale: Option<f64>,
}

/// The inliers of a range of chain pixels.
struct Inliers {
    sums: Sums,
    /// From the first inlier to after the last one.
    range: Range<usize>,
    /// End of the longest part from the first inlier on with the least share of inliers.
    dense_end: usize,
}

/// A fitted segment before its conversion to 3D.
pub(super) struct Fitted {
    pub(super) sums: Sums,
    pub(super) lines: Lines,
    /// Indices of the first and last inlier in the chain.
    pub(super) first: usize,
    pub(super) last: usize,
    /// Positions of the first and last inlier, relative to the origin of the sums.
    pub(super) ends: [Vector2<f64>; 2],
}

impl SegmentFitter {
    /// A fitter with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: FitOptions) -> Result<Self, FitOptionsError> {
        options.validate()?;
        Ok(Self { options })
    }

    /// The settings.
    pub fn options(&self) -> &FitOptions {
        &self.options
    }

    /// Appends the segments of a keyframe in the order of its chains.
    pub fn fit_into(&self, input: &FitInput<'_>, segments: &mut Vec<Segment>) {
        let limits = Limits::new(&self.options, input.chains.width(), input.chains.height());
        for (index, pixels) in input.chains.iter().enumerate() {
            let start = input.chains.start(index);
            let chain = Chain {
                pixels,
                positions: &input.chains.positions()[start..start + pixels.len()],
                start,
                index: index as u32,
                depths: input.depths,
                focal_px: input.camera.mean_focal_px(),
                limits,
                options: &self.options,
            };
            chain.fit(input, segments);
        }
    }

    /// The segments of a keyframe in the order of its chains.
    pub fn fit(&self, input: &FitInput<'_>) -> Vec<Segment> {
        let mut segments = Vec::new();
        self.fit_into(input, &mut segments);
        segments
    }
}

impl Chain<'_> {
    fn fit(&self, input: &FitInput<'_>, segments: &mut Vec<Segment>) {
        let mut start = 0;
        while let Some((begin, sums, lines)) = self.find_window(start) {
            let Some(fitted) = self.grow(begin, sums, lines) else {
                start = begin + 1;
                continue;
            };
            start = fitted.last + 1;
            let range = (self.start + fitted.first) as u32..(self.start + fitted.last + 1) as u32;
            if let Some(segment) = build(
                &fitted,
                range,
                self.index,
                input,
                self.options,
                |position| self.inlier(position, &fitted.sums, &fitted.lines).is_some(),
            ) {
                segments.push(segment);
            }
        }
    }

    pub(super) fn pixel(&self, position: usize) -> Vector2<f64> {
        let [x, y] = self.positions[position];
        Vector2::new(f64::from(x), f64::from(y))
    }

    fn depth(&self, position: usize) -> Option<InverseDepth> {
        self.depths.get(self.start + position)
    }

    /// Value and weight of a measurement in the depth fit.
    fn value(&self, depth: InverseDepth) -> (f64, f64) {
        match self.options.depth_model {
            DepthModel::InverseDepth => {
                let sigma = f64::from(depth.sigma);
                (f64::from(depth.rho), 1.0 / (sigma * sigma))
            }
            DepthModel::Depth => (depth.depth(), 1.0),
        }
    }

    /// The first window at or after `start` that fits both lines.
    fn find_window(&self, start: usize) -> Option<(usize, Sums, Lines)> {
        let window = self.limits.window;
        if start + window > self.pixels.len() {
            return None;
        }
        let mut sums = Sums {
            origin: self.pixel(start),
            image: ImageMoments::default(),
            depth: DepthMoments::default(),
            scale: None,
        };
        for position in start..start + window {
            self.include(position, &mut sums);
        }
        let mut begin = start;
        loop {
            if let Some(lines) = self.window_lines(begin, &mut sums) {
                return Some((begin, sums, lines));
            }
            if begin + window >= self.pixels.len() {
                return None;
            }
            self.exclude(begin, &mut sums);
            self.include(begin + window, &mut sums);
            begin += 1;
        }
    }

    /// Adds a pixel of the initial window; pixels without depth count for the image line only.
    fn include(&self, position: usize, sums: &mut Sums) {
        let p = self.pixel(position) - sums.origin;
        sums.image.add(p);
        if let Some(depth) = self.depth(position) {
            let (value, weight) = self.value(depth);
            sums.depth.add(p, value, weight);
        }
    }

    fn exclude(&self, position: usize, sums: &mut Sums) {
        let p = self.pixel(position) - sums.origin;
        sums.image.remove(p);
        if let Some(depth) = self.depth(position) {
            let (value, weight) = self.value(depth);
            sums.depth.remove(p, value, weight);
        }
    }

    /// The lines of a window, if its pixels fit them.
    fn window_lines(&self, begin: usize, sums: &mut Sums) -> Option<Lines> {
        let window = self.limits.window;
        // Half of the window, and at least three pixels, must have a depth.
        if sums.depth.n < (0.5 * window as f64).max(3.0) {
            return None;
        }
        if self.options.depth_model == DepthModel::Depth {
            sums.scale = Some(self.focal_px / sums.depth.mean());
        }
        let towards = self.pixel(begin + window - 1) - self.pixel(begin);
        let image = sums.image.line(towards)?;
        if image.rms_px > self.limits.image_px {
            return None;
        }
        let depth = sums.depth.line(&image, sums.scale)?;
        let lines = Lines { image, depth };
        let range = begin..begin + window;
        let on_line = range
            .clone()
            .all(|i| image.distance(self.pixel(i) - sums.origin) <= self.limits.image_px);
        if !on_line {
            return None;
        }
        let agreeing = range
            .filter(|&i| self.inlier(i, sums, &lines).is_some())
            .count();
        // A window with many depth outliers lies on two surfaces.
        (agreeing as f64 >= 0.8 * sums.depth.n).then_some(lines)
    }

    /// The measurement of a pixel, if it is an inlier of both lines.
    fn inlier(&self, position: usize, sums: &Sums, lines: &Lines) -> Option<InverseDepth> {
        #[cfg(test)]
        tests::TESTED.set(tests::TESTED.get() + 1);
        let p = self.pixel(position) - sums.origin;
        if lines.image.distance(p) > self.limits.image_px {
            return None;
        }
        let depth = self.depth(position)?;
        let line = lines.depth.at(lines.image.position(p));
        let is_inlier = match sums.scale {
            None => {
                let residual = (f64::from(depth.rho) - line).abs();
                line > 0.0
                    && (self.focal_px * residual <= self.limits.depth_px * line
                        || residual <= self.options.depth_gate_sigmas * f64::from(depth.sigma))
            }
            Some(scale) => {
                // Distance from the line in the plane of (position, scaled depth).
                let residual = scale * (depth.depth() - line).abs();
                let slope = scale * lines.depth.slope;
                let distance = residual / (1.0 + slope * slope).sqrt();
                // dz = z^2 d rho
                let sigma = f64::from(depth.sigma) * depth.depth() * depth.depth();
                distance <= self.limits.depth_px
                    || residual <= self.options.depth_gate_sigmas * scale * sigma
            }
        };
        is_inlier.then_some(depth)
    }

    fn add_inlier(&self, position: usize, depth: InverseDepth, sums: &mut Sums) {
        let p = self.pixel(position) - sums.origin;
        let (value, weight) = self.value(depth);
        sums.image.add(p);
        sums.depth.add(p, value, weight);
    }

    fn lines(&self, sums: &Sums, towards: Vector2<f64>) -> Option<Lines> {
        let image = sums.image.line(towards)?;
        let depth = sums.depth.line(&image, sums.scale)?;
        Some(Lines { image, depth })
    }

    /// Number of inliers without an outlier between them that would bring the least share of inliers; at most 0 where it is reached.
    fn missing(&self, inliers: f64, length: f64) -> f64 {
        let share = self.options.minimum_inlier_share;
        let behind = share * length - inliers;
        if behind > 0.0 {
            behind / (1.0 - share)
        } else {
            behind
        }
    }

    /// Extends a window to a segment; `None` when the result has too few inliers.
    fn grow(&self, begin: usize, window_sums: Sums, mut lines: Lines) -> Option<Fitted> {
        let window = self.limits.window;
        let empty = Sums {
            image: ImageMoments::default(),
            depth: DepthMoments::default(),
            ..window_sums
        };
        let mut sums = empty;
        let mut last = begin;
        for position in begin..begin + window {
            if let Some(depth) = self.inlier(position, &window_sums, &lines) {
                self.add_inlier(position, depth, &mut sums);
                last = position;
            }
        }
        let mut refit_at = sums.image.n + 1.0;
        let mut dense_end = begin + window;
        for position in begin + window..self.pixels.len() {
            if position - last > window {
                break;
            }
            let Some(depth) = self.inlier(position, &sums, &lines) else {
                continue;
            };
            self.add_inlier(position, depth, &mut sums);
            last = position;
            let length = position + 1 - begin;
            let missing = self.missing(sums.image.n, length as f64);
            if missing <= 0.0 {
                dense_end = position + 1;
            } else if missing > (dense_end - begin).max(SPARSE_WINDOWS * window) as f64 {
                break;
            }
            if sums.image.n >= refit_at {
                if let Some(refitted) = self.lines(&sums, lines.image.direction) {
                    lines = refitted;
                }
                // Refitting whenever the number of inliers has grown by an eighth keeps the cost per pixel constant.
                refit_at = sums.image.n * 1.125;
            }
        }
        self.settle(begin..last + 1, sums, lines.image.direction)
    }

    /// Classifies the pixels of a range again, with the lines of all its inliers, and cuts it back to the longest beginning with
    /// the least share of inliers. `None` when too few inliers are left.
    ///
    /// # Complexity
    /// Linear in the length of the range without a cut. Each cut repeats it on the rest.
    fn settle(
        &self,
        mut range: Range<usize>,
        mut sums: Sums,
        direction: Vector2<f64>,
    ) -> Option<Fitted> {
        loop {
            let lines = self.lines(&sums, direction)?;
            let found = self.classify(range.clone(), &sums, &lines)?;
            if found.sums.image.n <= self.limits.window as f64 {
                return None;
            }
            if found.dense_end == found.range.end {
                let Range { start: first, end } = found.range;
                let last = end - 1;
                let ends = [first, last].map(|position| self.pixel(position) - found.sums.origin);
                return Some(Fitted {
                    lines: self.lines(&found.sums, direction)?,
                    sums: found.sums,
                    first,
                    last,
                    ends,
                });
            }
            range = found.range.start..found.dense_end;
            sums = self.classify(range.clone(), &sums, &lines)?.sums;
        }
    }

    /// The inliers of a range; `None` without any.
    fn classify(&self, range: Range<usize>, sums: &Sums, lines: &Lines) -> Option<Inliers> {
        let mut inliers = Inliers {
            sums: Sums {
                image: ImageMoments::default(),
                depth: DepthMoments::default(),
                ..*sums
            },
            range: 0..0,
            dense_end: 0,
        };
        for position in range {
            let Some(depth) = self.inlier(position, sums, lines) else {
                continue;
            };
            self.add_inlier(position, depth, &mut inliers.sums);
            if inliers.range.is_empty() {
                inliers.range.start = position;
            }
            inliers.range.end = position + 1;
            let share = inliers.sums.image.n / inliers.range.len() as f64;
            if share >= self.options.minimum_inlier_share {
                inliers.dense_end = position + 1;
            }
        }
        (!inliers.range.is_empty()).then_some(inliers)
    }
}

#[cfg(test)]
mod tests;
