//! Straight segments along edge chains, validated against noise.

use std::ops::Range;

use nalgebra::{Point2, Vector2};

use super::options::{LineDetectorOptions, LineDetectorOptionsError};
use super::significance::Significance;
use linecarve_lines::edges::EdgeChains;
use linecarve_lines::fit::ImageMoments;
use linecarve_lines::image::{GrayImage, sobel};

/// A straight segment in an image.
#[derive(Debug, Clone, PartialEq)]
pub struct LineSegment2d {
    /// Its ends: the first and last pixel, projected onto the line.
    pub ends_px: [Point2<f64>; 2],
    /// Its pixels, as positions in [`EdgeChains::pixels`]; outliers between the ends are among them.
    pub pixels: Range<u32>,
    /// The chain of its pixels.
    pub chain: u32,
}

impl LineSegment2d {
    /// Length in pixels.
    pub fn length_px(&self) -> f64 {
        (self.ends_px[1] - self.ends_px[0]).norm()
    }

    /// Unit direction from the first end to the second; `None` when the ends coincide.
    pub fn direction(&self) -> Option<Vector2<f64>> {
        (self.ends_px[1] - self.ends_px[0]).try_normalize(0.0)
    }
}

/// Finds straight segments in images by EDLines.
///
/// A window moves along a chain until its pixels lie on a line; the segment is then extended pixel by pixel while pixels lie
/// within the line error. Neighbouring pieces of one line can be joined. A segment is kept when so many of its pixels
/// have a gradient perpendicular to it that an image of noise is expected to contain less than one such segment.
///
/// # Complexity
/// Linear in the number of chain pixels.
///
/// # Reference
/// C. Akinlar, C. Topal, EDLines: A real-time line segment detector with a false detection control, Pattern Recognition
/// Letters, 2011: line extraction, validation. Joining is that of a later library.
///
/// *Differs from the paper*: the line is refitted while it grows, so that the direction of the first pixels is not
/// extrapolated; pixels are located with sub-pixel precision at the maximum of the gradient, which can be switched off.
#[derive(Debug, Clone, Default)]
pub struct LineDetector {
    options: LineDetectorOptions,
    significance: Significance,
    /// Segments of the current chain, as ranges of positions in it.
    pieces: Vec<Range<usize>>,
}

/// One chain with the positions of its pixels.
struct Chain<'a> {
    pixels: &'a [[u16; 2]],
    positions: &'a [[f32; 2]],
    subpixel: bool,
}

impl Chain<'_> {
    fn at(&self, position: usize) -> Vector2<f64> {
        if self.subpixel {
            let [x, y] = self.positions[position];
            Vector2::new(f64::from(x), f64::from(y))
        } else {
            let [x, y] = self.pixels[position];
            Vector2::new(f64::from(x), f64::from(y))
        }
    }

    /// Sums over a range, relative to a pixel.
    fn sums(&self, range: Range<usize>, origin: Vector2<f64>) -> ImageMoments {
        let mut sums = ImageMoments::default();
        for position in range {
            sums.add(self.at(position) - origin);
        }
        sums
    }
}

impl LineDetector {
    /// A detector with the given settings.
    ///
    /// # Errors
    /// When a setting is out of range.
    pub fn new(options: LineDetectorOptions) -> Result<Self, LineDetectorOptionsError> {
        options.validate()?;
        Ok(Self {
            options,
            ..Self::default()
        })
    }

    /// The segments on the edges of an image, in the order of the chains. `image` is the image that the chains were drawn
    /// on, before smoothing: smoothing aligns the gradients of noise.
    pub fn detect(&mut self, image: &GrayImage, chains: &EdgeChains) -> Vec<LineSegment2d> {
        let chance = self.options.chance();
        self.significance
            .prepare(chains.width(), chains.height(), chance);
        let least = self.significance.least_length(self.options.false_alarms);
        let mut segments = Vec::new();
        for (index, pixels) in chains.iter().enumerate() {
            let start = chains.start(index);
            let chain = Chain {
                pixels,
                positions: &chains.positions()[start..start + pixels.len()],
                subpixel: self.options.subpixel,
            };
            self.split(&chain, least);
            self.join(&chain);
            for piece in std::mem::take(&mut self.pieces) {
                let Some(ends_px) = ends(&chain, &piece) else {
                    continue;
                };
                if self.options.validate && !self.is_meaningful(image, &chain, &piece, ends_px) {
                    continue;
                }
                segments.push(LineSegment2d {
                    ends_px,
                    pixels: (start + piece.start) as u32..(start + piece.end) as u32,
                    chain: index as u32,
                });
            }
        }
        segments
    }

    /// Splits a chain into straight segments.
    fn split(&mut self, chain: &Chain<'_>, least: usize) {
        self.pieces.clear();
        let mut start = 0;
        while start + least <= chain.pixels.len() {
            let Some(first) = self.first_window(chain, start, least) else {
                return;
            };
            let end = self.grow(chain, first, least);
            self.pieces.push(first..end);
            start = end;
        }
    }

    /// The first window of `least` pixels that lie on a line.
    fn first_window(&self, chain: &Chain<'_>, start: usize, least: usize) -> Option<usize> {
        let origin = chain.at(start);
        let mut sums = chain.sums(start..start + least, origin);
        for begin in start..=chain.pixels.len() - least {
            let towards = chain.at(begin + least - 1) - chain.at(begin);
            let line = sums.line(towards);
            if line.is_some_and(|line| line.rms_px <= self.options.line_error_px) {
                return Some(begin);
            }
            sums.remove(chain.at(begin) - origin);
            if begin + least < chain.pixels.len() {
                sums.add(chain.at(begin + least) - origin);
            }
        }
        None
    }

    /// The end of the segment that begins with a window: one after its last inlier.
    fn grow(&self, chain: &Chain<'_>, begin: usize, least: usize) -> usize {
        let origin = chain.at(begin);
        let mut end = begin + least;
        let mut sums = chain.sums(begin..end, origin);
        let towards = |end: usize| chain.at(end - 1) - chain.at(begin);
        let Some(mut line) = sums.line(towards(end)) else {
            return end;
        };
        let mut refit_at = sums.n + 1.0;
        for position in begin + least..chain.pixels.len() {
            let pixel = chain.at(position) - origin;
            if line.distance(pixel) > self.options.line_error_px {
                if position + 1 - end >= self.options.outliers_in_a_row {
                    break;
                }
                continue;
            }
            sums.add(pixel);
            end = position + 1;
            if sums.n >= refit_at {
                line = sums.line(towards(end)).unwrap_or(line);
                // Refitting after every eighth more pixels keeps the cost per pixel constant.
                refit_at = sums.n * 1.125;
            }
        }
        end
    }

    /// Joins neighbouring segments of one line.
    fn join(&mut self, chain: &Chain<'_>) {
        if self.options.join_error_px <= 0.0 {
            return;
        }
        let mut joined: usize = 0;
        for index in 1..self.pieces.len() {
            let (before, after) = (self.pieces[joined].clone(), self.pieces[index].clone());
            let gap = (chain.at(after.start) - chain.at(before.end - 1)).norm();
            let origin = chain.at(before.start);
            let is_one_line = gap <= self.options.join_gap_px && {
                let mut sums = chain.sums(before.clone(), origin);
                for position in after.clone() {
                    sums.add(chain.at(position) - origin);
                }
                sums.line(chain.at(after.end - 1) - origin)
                    .is_some_and(|line| line.rms_px <= self.options.join_error_px)
            };
            if is_one_line {
                self.pieces[joined].end = after.end;
            } else {
                joined += 1;
                self.pieces[joined] = after;
            }
        }
        self.pieces.truncate(joined + 1);
    }

    /// Whether a segment is unlikely in noise.
    fn is_meaningful(
        &mut self,
        image: &GrayImage,
        chain: &Chain<'_>,
        piece: &Range<usize>,
        ends_px: [Point2<f64>; 2],
    ) -> bool {
        let Some(along) = (ends_px[1] - ends_px[0]).try_normalize(0.0) else {
            return false;
        };
        let normal = Vector2::new(-along.y, along.x);
        let least_cosine = self.options.alignment_rad.cos();
        // One side of an edge is brighter; the majority of pixels decides which.
        let mut aligned = [0_usize; 2];
        for &[x, y] in &chain.pixels[piece.clone()] {
            let (gx, gy) = sobel(image, usize::from(x), usize::from(y));
            let gradient = Vector2::new(f64::from(gx), f64::from(gy));
            let across = gradient.dot(&normal);
            if across.abs() > least_cosine * gradient.norm() {
                aligned[usize::from(across < 0.0)] += 1;
            }
        }
        let aligned = aligned[0].max(aligned[1]);
        self.significance.ln_false_alarms(piece.len(), aligned) <= self.options.false_alarms.ln()
    }
}

/// The first and last pixel of a segment, projected onto the line through all of its pixels.
fn ends(chain: &Chain<'_>, piece: &Range<usize>) -> Option<[Point2<f64>; 2]> {
    let origin = chain.at(piece.start);
    let sums = chain.sums(piece.clone(), origin);
    let line = sums.line(chain.at(piece.end - 1) - origin)?;
    let on_line = |position: usize| {
        let place = line.position(chain.at(position) - origin);
        Point2::from(origin + line.center + line.direction * place)
    };
    let ends = [on_line(piece.start), on_line(piece.end - 1)];
    ((ends[1] - ends[0]).norm() > 0.0).then_some(ends)
}
