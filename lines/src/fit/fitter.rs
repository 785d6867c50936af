//! Algorithm 1: growing segments along edge chains.

use nalgebra::Vector2;

use super::build::build;
use super::moments::{DepthLine, DepthMoments, ImageLine, ImageMoments};
use super::options::{DepthModel, FitOptions, FitOptionsError, Limits};
use super::segment::Segment;
use crate::camera::Camera;
use crate::depth::{EdgeDepths, InverseDepth};
use crate::edges::EdgeChains;
use crate::image::GrayImage;

/// What a fit reads: the edges of one keyframe, their depths and the pinhole camera.
#[derive(Debug, Clone, Copy)]
pub struct FitInput<'a> {
    /// Edge chains of the keyframe.
    pub chains: &'a EdgeChains,
    /// The depth of each chain pixel.
    pub depths: &'a EdgeDepths,
    /// The (smoothed) image, for the gradient along segments.
    pub image: &'a GrayImage,
    /// The pinhole camera of the image.
    pub camera: &'a Camera,
    /// Index of the keyframe, stored with each segment.
    pub keyframe: u32,
}

/// Fits 3D segments along edge chains.
///
/// A segment is grown pixel by pixel along its chain as two 2D lines: one in the image, one of depth over the distance
/// along it. The first fit takes a window of L pixels; a pixel is an inlier when it is within e1 of the image line and its
/// depth within e2 of the depth line; pixels without depth are outliers; L outliers in a row end the segment. Both lines
/// are refitted to the inliers at the end, and the ends are the first and the last inlier, put on the lines.
///
/// # Complexity
/// Linear in the number of chain pixels: sums are kept running, so a fit costs the same for any length.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section III-B, Algorithm 1.
///
/// *Differs from the paper*; all but the first and the last can be switched off in [`FitOptions`]:
/// - The first window is tested, and slid by one pixel when its pixels are on no line, instead of being taken as it is.
/// - Inverse depth, weighted, is fitted instead of depth: it is what is linear along the image of a line.
/// - A depth within a few of its own standard deviations is an inlier even beyond e2, which far away is below any
///   sensor's noise.
/// - Both lines follow their inliers while the segment grows; the direction of L pixels is too rough to be extrapolated.
/// - Pixels count where the crest of the gradient crosses them: of an edge nearly level with the pixel grid, ten pixels
///   in a row show nothing but the row, and e1 is less than the step to the next.
/// - After a segment the search goes on behind its last inlier, not behind the outliers that ended it: they are the
///   beginning of the next one.
#[derive(Debug, Clone)]
pub struct SegmentFitter {
    options: FitOptions,
}

/// One chain under way.
struct Chain<'a> {
    pixels: &'a [[u16; 2]],
    positions: &'a [[f32; 2]],
    /// Position of the chain's first pixel among all chain pixels.
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

/// A finished segment before it becomes 3D.
pub(super) struct Fitted {
    pub(super) sums: Sums,
    pub(super) lines: Lines,
    /// First and last inlier, as positions in the chain.
    pub(super) first: usize,
    pub(super) last: usize,
    /// Their places in the image, relative to the origin of the sums.
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
        if self.options.subpixel {
            let [x, y] = self.positions[position];
            Vector2::new(f64::from(x), f64::from(y))
        } else {
            let [x, y] = self.pixels[position];
            Vector2::new(f64::from(x), f64::from(y))
        }
    }

    fn depth(&self, position: usize) -> Option<InverseDepth> {
        self.depths.get(self.start + position)
    }

    /// The fitted value of a measurement and its weight.
    fn value(&self, depth: InverseDepth) -> (f64, f64) {
        match self.options.depth_model {
            DepthModel::InverseDepth => {
                let sigma = f64::from(depth.sigma);
                (f64::from(depth.rho), 1.0 / (sigma * sigma))
            }
            DepthModel::Depth => (depth.depth(), 1.0),
        }
    }

    /// The first window from `start` on whose pixels lie on two lines.
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

    /// Adds a pixel of the first window: every pixel counts for the image line.
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

    /// The lines of a window when its pixels agree with them.
    fn window_lines(&self, begin: usize, sums: &mut Sums) -> Option<Lines> {
        let window = self.limits.window;
        // Half the window must have a depth, and at least the three pixels that can contradict a line.
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
        // Nearly all depths of the window fit, or the line is made of two surfaces.
        (agreeing as f64 >= 0.8 * sums.depth.n).then_some(lines)
    }

    /// The position along the image line and the measurement of a pixel that is an inlier of both lines.
    fn inlier(&self, position: usize, sums: &Sums, lines: &Lines) -> Option<InverseDepth> {
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

    /// Extends a window to a segment; `None` when too few pixels agree in the end.
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
        for position in begin + window..self.pixels.len() {
            if position - last > window {
                break;
            }
            let Some(depth) = self.inlier(position, &sums, &lines) else {
                continue;
            };
            self.add_inlier(position, depth, &mut sums);
            last = position;
            if self.options.refit_while_growing && sums.image.n >= refit_at {
                if let Some(refitted) = self.lines(&sums, lines.image.direction) {
                    lines = refitted;
                }
                // Refitting after every eighth more inliers keeps the cost per pixel constant and lags by little.
                refit_at = sums.image.n * 1.125;
            }
        }
        // Membership is decided once more by the lines of all inliers, which the first pixels never saw.
        let lines = self.lines(&sums, lines.image.direction)?;
        let mut refined = empty;
        let mut ends = None;
        for position in begin..=last {
            if let Some(depth) = self.inlier(position, &sums, &lines) {
                self.add_inlier(position, depth, &mut refined);
                ends = Some((ends.map_or(position, |(first, _)| first), position));
            }
        }
        let (first, last) = ends?;
        if refined.image.n <= window as f64 {
            return None;
        }
        let lines = self.lines(&refined, lines.image.direction)?;
        let ends = [first, last].map(|position| self.pixel(position) - refined.origin);
        Some(Fitted {
            sums: refined,
            lines,
            first,
            last,
            ends,
        })
    }
}

#[cfg(test)]
mod tests;
