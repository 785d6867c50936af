//! Test of depth registration: distances of depth discontinuities to colour edges, as read and after a shift and scale.

use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
use linecarve_lines::image::GrayImage;
use nalgebra::Point2;
use rayon::prelude::*;
use serde::Serialize;

use super::evenly_spaced;
use crate::{DepthCalibration, DepthImage, Sequence};

/// Smallest relative depth step of a discontinuity.
const MIN_DEPTH_STEP: f64 = 0.05;

/// Widest run of unknown depth (sensor shadow) that a discontinuity may span.
const MAX_SHADOW_PX: usize = 16;

/// Distances are clamped here, so that discontinuities without a colour edge do not dominate.
const MAX_DISTANCE_PX: u8 = 8;

/// Distance units per pixel.
const UNITS_PER_PX: u8 = 3;

/// Upper bound of the number of compared pixels over all images.
pub(super) const MAX_PIXELS: usize = 6000;

/// Smallest number of pixels for a comparison.
const MIN_PIXELS: usize = 200;

/// A shift is reported if it lowers the mean distance below this share. Noise lowers it by a few per cent, the
/// unregistered depth of 7-Scenes by a third and more.
const CLEARLY_BETTER: f64 = 0.8;

/// Distances of depth discontinuities to colour edges.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct RegistrationFacts {
    /// Number of image pairs.
    pub frames: usize,
    /// Number of discontinuity pixels.
    pub pixels: usize,
    /// Mean distance of a discontinuity pixel to the nearest colour edge as read, each clamped to 8 px.
    pub mean_distance_px: f64,
    /// Mean distance after the best scale about the principal point and shift.
    pub best_distance_px: f64,
    /// Best scale.
    pub best_scale: f64,
    /// Best shift in x and y.
    pub best_shift_px: [f64; 2],
    /// Whether the best scale and shift of each half of the images also fit the other half much better than as read. A few outlines can
    /// lie nearer to other edges by chance, but not in all images alike.
    pub is_confirmed: bool,
}

/// A scale and shift move pixels far if the sides of the image move by more than this share of its width: a depth camera beside the colour
/// camera, or with a lens of its own. Tuned on rendered rooms, with depth that is moved and with depth that is right.
const FAR: f64 = 0.02;

impl RegistrationFacts {
    /// Whether the best scale and shift move pixels far.
    pub(super) fn is_far(&self, width: f64) -> bool {
        let [x, y] = self.best_shift_px;
        x.hypot(y) + 0.5 * width * (self.best_scale - 1.0).abs() > FAR * width
    }

    /// A warning if a scale or shift fits much better.
    pub(super) fn warning(&self) -> Option<String> {
        let is_moved =
            self.best_scale != 1.0 || self.best_shift_px.iter().any(|shift| shift.abs() > 2.0);
        let is_better = self.best_distance_px < CLEARLY_BETTER * self.mean_distance_px;
        (is_moved && is_better && self.is_confirmed).then(|| {
            format!(
                "depth discontinuities lie {:.1} px from colour edges, but {:.1} px when scaled by {:.2} and shifted by \
                 ({:.0}, {:.0}) px: depth is probably not registered to colour; give the depth camera in a [depth] section \
                 of linecarve.toml",
                self.mean_distance_px,
                self.best_distance_px,
                self.best_scale,
                self.best_shift_px[0],
                self.best_shift_px[1]
            )
        })
    }
}

/// An image pair: depth discontinuities in the colour image, and its distance transform.
struct RegistrationPair {
    discontinuities: Vec<Point2<f64>>,
    width: usize,
    height: usize,
    /// Distance of each pixel to the nearest colour edge, in thirds of a pixel.
    distances: Vec<u8>,
}

/// Compares depth and colour of `samples` frames, of those that can be loaded; `None` if there are too few pixels.
pub(super) fn measure(
    sequence: &Sequence,
    samples: usize,
    most_pixels: usize,
) -> Option<RegistrationFacts> {
    let calibration = sequence.depth_calibration()?;
    let with_depth: Vec<usize> = (0..sequence.frames().len())
        .filter(|&index| sequence.frames()[index].depth.is_some())
        .collect();
    let pairs: Vec<Option<RegistrationPair>> = evenly_spaced(with_depth.len(), samples)
        .par_iter()
        .map(|&at| {
            let index = with_depth[at];
            let color = sequence.load_gray(index).ok()?;
            let depth = sequence.load_depth(index).ok()??;
            pair(sequence, calibration, &color, &depth)
        })
        .collect();
    let mut pairs: Vec<RegistrationPair> = pairs.into_iter().flatten().collect();
    let total: usize = pairs.iter().map(|pair| pair.discontinuities.len()).sum();
    if total < MIN_PIXELS {
        return None;
    }
    let step = total.div_ceil(most_pixels);
    for pair in &mut pairs {
        pair.discontinuities = pair.discontinuities.iter().copied().step_by(step).collect();
    }
    let center = Point2::new(sequence.color_camera().cx(), sequence.color_camera().cy());
    let search = Search {
        pairs: &pairs,
        center,
    };
    let as_read = search.candidate((1.0, [0.0, 0.0]));
    let [all, even, odd] = search.best(as_read);
    let is_better = |found: Candidate, of: usize| {
        found.mean_distances[of] < CLEARLY_BETTER * as_read.mean_distances[of]
    };
    Some(RegistrationFacts {
        frames: pairs.len(),
        pixels: pairs.iter().map(|pair| pair.discontinuities.len()).sum(),
        mean_distance_px: as_read.mean_distances[ALL],
        best_distance_px: all.mean_distances[ALL],
        best_scale: all.scale,
        best_shift_px: all.shift,
        is_confirmed: is_better(odd, EVEN) && is_better(even, ODD),
    })
}

/// Indices of the means over all images, over those with even numbers, and over those with odd numbers.
const ALL: usize = 0;
const EVEN: usize = 1;
const ODD: usize = 2;

#[derive(Debug, Clone, Copy, PartialEq)]
struct Candidate {
    scale: f64,
    shift: [f64; 2],
    /// Over all, even and odd images; not a number where these have no discontinuities.
    mean_distances: [f64; 3],
}

struct Search<'a> {
    pairs: &'a [RegistrationPair],
    center: Point2<f64>,
}

impl Search<'_> {
    /// The scale and shift with the smallest mean distance over all, even and odd images, the first of equal ones; `as_read` if none is
    /// better. A coarse search over shifts and ratios of focal lengths, then single pixels around the best.
    fn best(&self, as_read: Candidate) -> [Candidate; 3] {
        let around = |middle: f64, reach: i32, step: i32| {
            (-reach..=reach).map(move |i| middle + f64::from(i * step))
        };
        let coarse = (-8..=8).flat_map(|scale| {
            let scale = 1.0 + 0.02 * f64::from(scale);
            around(0.0, 8, 3).flat_map(move |x| around(0.0, 8, 3).map(move |y| (scale, [x, y])))
        });
        let coarse = self.candidates(coarse.collect());
        [ALL, EVEN, ODD].map(|of| {
            let Candidate {
                scale,
                shift: [x, y],
                ..
            } = least(&coarse, as_read, of);
            let fine = (-1..=1).flat_map(|step| {
                let scale = scale + 0.01 * f64::from(step);
                around(x, 2, 1).flat_map(move |x| around(y, 2, 1).map(move |y| (scale, [x, y])))
            });
            least(&self.candidates(fine.collect()), as_read, of)
        })
    }

    fn candidates(&self, moves: Vec<(f64, [f64; 2])>) -> Vec<Candidate> {
        moves
            .into_par_iter()
            .map(|each| self.candidate(each))
            .collect()
    }

    fn candidate(&self, (scale, shift): (f64, [f64; 2])) -> Candidate {
        let mut halves = [(0_u64, 0_u64); 2];
        for (at, pair) in self.pairs.iter().enumerate() {
            let (sum, count) = &mut halves[at % 2];
            *sum += pair.distance(&self.center, scale, shift);
            *count += pair.discontinuities.len() as u64;
        }
        let [even, odd] = halves;
        let mean = |(sum, count): (u64, u64)| sum as f64 / (count as f64 * f64::from(UNITS_PER_PX));
        Candidate {
            scale,
            shift,
            mean_distances: [(even.0 + odd.0, even.1 + odd.1), even, odd].map(mean),
        }
    }
}

/// The candidate with the smallest of these mean distances, if it is smaller than as read.
fn least(candidates: &[Candidate], as_read: Candidate, of: usize) -> Candidate {
    let mut found = as_read;
    for candidate in candidates {
        if candidate.mean_distances[of] < found.mean_distances[of] {
            found = *candidate;
        }
    }
    found
}

impl RegistrationPair {
    /// Sum of the distances of all discontinuities, in units.
    fn distance(&self, center: &Point2<f64>, scale: f64, shift: [f64; 2]) -> u64 {
        let (width, height) = (self.width as f64, self.height as f64);
        let of = |discontinuity: &Point2<f64>| {
            let x = center.x + scale * (discontinuity.x - center.x) + shift[0] + 0.5;
            let y = center.y + scale * (discontinuity.y - center.y) + shift[1] + 0.5;
            if x >= 0.0 && y >= 0.0 && x < width && y < height {
                u64::from(self.distances[y as usize * self.width + x as usize])
            } else {
                u64::from(MAX_DISTANCE_PX * UNITS_PER_PX)
            }
        };
        self.discontinuities.iter().map(of).sum()
    }
}

fn pair(
    sequence: &Sequence,
    calibration: &DepthCalibration,
    color: &GrayImage,
    depth: &DepthImage,
) -> Option<RegistrationPair> {
    let mut detector = EdgeDetector::new(EdgeOptions::default()).ok()?;
    let chains = detector.detect(color);
    let (width, height) = (color.width(), color.height());
    let mut distances = vec![MAX_DISTANCE_PX * UNITS_PER_PX; width * height];
    for [x, y] in chains.pixels() {
        distances[usize::from(*y) * width + usize::from(*x)] = 0;
    }
    chamfer_distance_transform(&mut distances, width, height);
    let discontinuities = discontinuities(depth)
        .into_iter()
        .filter_map(|[x, y]| {
            let pixel = Point2::new(x as f64, y as f64);
            if calibration.registered {
                return Some(pixel);
            }
            let z = f64::from(*depth.get(x, y)?);
            let point = calibration.camera.point_at_depth(&pixel, z).ok()?;
            sequence
                .color_camera()
                .project(&(calibration.color_from_depth * point))
        })
        .collect();
    Some(RegistrationPair {
        discontinuities,
        width,
        height,
        distances,
    })
}

/// Pixels on the nearer side of depth discontinuities along rows and columns.
fn discontinuities(depth: &DepthImage) -> Vec<[usize; 2]> {
    let mut found = Vec::new();
    let (width, height) = (depth.width(), depth.height());
    let mut scan = |line: &mut dyn Iterator<Item = [usize; 2]>| {
        let mut last: Option<([usize; 2], f64)> = None;
        let mut unknown = 0;
        for pixel in line {
            let z = depth
                .get(pixel[0], pixel[1])
                .copied()
                .map_or(0.0, f64::from);
            if z <= 0.0 {
                unknown += 1;
                continue;
            }
            if let Some((before, nearer)) = last
                && unknown <= MAX_SHADOW_PX
                && (z - nearer).abs() > MIN_DEPTH_STEP * z.min(nearer)
            {
                found.push(if z < nearer { pixel } else { before });
            }
            last = Some((pixel, z));
            unknown = 0;
        }
    };
    for y in 0..height {
        scan(&mut (0..width).map(|x| [x, y]));
    }
    for x in 0..width {
        scan(&mut (0..height).map(|y| [x, y]));
    }
    found
}

/// Chamfer 3-4 distance transform in two passes: lowers each value to the distance to the nearest 0.
///
/// # Reference
/// G. Borgefors, Distance Transformations in Digital Images, CVGIP, 1986: chamfer 3-4.
fn chamfer_distance_transform(distances: &mut [u8], width: usize, height: usize) {
    let mut relax = |x: usize, y: usize, neighbours: [(isize, isize, u8); 4]| {
        let mut least = distances[y * width + x];
        for (dx, dy, step) in neighbours {
            let (Some(nx), Some(ny)) = (x.checked_add_signed(dx), y.checked_add_signed(dy)) else {
                continue;
            };
            if nx < width && ny < height {
                least = least.min(distances[ny * width + nx].saturating_add(step));
            }
        }
        distances[y * width + x] = least;
    };
    for y in 0..height {
        for x in 0..width {
            relax(x, y, [(-1, 0, 3), (-1, -1, 4), (0, -1, 3), (1, -1, 4)]);
        }
    }
    for y in (0..height).rev() {
        for x in (0..width).rev() {
            relax(x, y, [(1, 0, 3), (1, 1, 4), (0, 1, 3), (-1, 1, 4)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::image::Plane;

    #[test]
    fn distances_grow_up_to_the_maximum() {
        let mut distances = vec![24; 20 * 3];
        distances[20] = 0;
        chamfer_distance_transform(&mut distances, 20, 3);
        assert_eq!(distances[20..30], [0, 3, 6, 9, 12, 15, 18, 21, 24, 24]);
        assert_eq!(distances[..3], [3, 4, 7]);
    }

    #[test]
    fn discontinuities_are_on_the_nearer_side_and_span_shadows() {
        let depth = Plane::new(6, 1, vec![2.0, 2.0, 0.0, 1.0, 1.0, 1.01]).unwrap();
        assert_eq!(discontinuities(&depth), [[3, 0]]);
        let wide = Plane::new(30, 1, [vec![2.0], vec![0.0; 28], vec![1.0]].concat()).unwrap();
        assert!(discontinuities(&wide).is_empty());
    }

    /// An image of edges that lie (-4, 3) px beside the discontinuities.
    fn moved(columns: i32) -> RegistrationPair {
        let (width, height) = (400, 400);
        let mut distances = vec![24; width * height];
        let discontinuities: Vec<_> = (5..375)
            .map(|i| Point2::new(f64::from(i + columns * (i % 3)), f64::from(i)))
            .collect();
        for discontinuity in &discontinuities {
            distances[(discontinuity.y as usize + 3) * width + discontinuity.x as usize - 4] = 0;
        }
        chamfer_distance_transform(&mut distances, width, height);
        RegistrationPair {
            discontinuities,
            width,
            height,
            distances,
        }
    }

    #[test]
    fn a_shift_is_found_and_confirmed_by_each_half() {
        let pairs = [moved(7), moved(5)];
        let search = Search {
            pairs: &pairs,
            center: Point2::new(199.5, 199.5),
        };
        let as_read = search.candidate((1.0, [0.0, 0.0]));
        let means = as_read.mean_distances;
        assert!(means.iter().all(|mean| *mean > 1.0), "{means:?}");
        for found in search.best(as_read) {
            assert_eq!((found.scale, found.shift), (1.0, [-4.0, 3.0]));
            assert_eq!(found.mean_distances, [0.0; 3]);
        }
        let one = Search {
            pairs: &pairs[..1],
            ..search
        };
        assert!(one.candidate((1.0, [0.0, 0.0])).mean_distances[ODD].is_nan());
    }
}
