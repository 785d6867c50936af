//! The nearest edge pixel of similar direction, for every pixel of an image.

use linecarve_lines::edges::EdgeChains;
use nalgebra::{Point2, Vector2};

/// Number of direction bins, of 22.5 degrees each; an edge counts in its own bin and the two next to it.
const BINS: usize = 8;
/// Half the length over which the direction of an edge is measured, in pixels of its chain.
const REACH: usize = 3;
/// No edge.
const NONE: u32 = u32::MAX;

/// An edge pixel: sub-pixel position and unit direction.
#[derive(Debug, Clone, Copy)]
struct Seed {
    position: Vector2<f32>,
    direction: Vector2<f32>,
}

/// Distances to the nearest edge of an image, by direction.
pub(super) struct EdgeField {
    width: usize,
    height: usize,
    seeds: Vec<Seed>,
    /// Index of the nearest seed of every pixel, bin by bin.
    nearest: Vec<u32>,
}

/// The bin of an undirected direction, of `bins` over half a turn.
pub(super) fn direction_bin(direction: Vector2<f64>, bins: usize) -> usize {
    let angle = direction
        .y
        .atan2(direction.x)
        .rem_euclid(std::f64::consts::PI);
    let bin = angle / std::f64::consts::PI * bins as f64;
    (bin.round() as usize) % bins
}

impl EdgeField {
    /// Largest distance, in pixels; longer ones are cut off.
    pub(super) const CAP: f64 = 10.0;

    pub(super) fn new(chains: &EdgeChains) -> Self {
        let (width, height) = (chains.width(), chains.height());
        let mut seeds = Vec::with_capacity(chains.pixels().len());
        let mut nearest = vec![NONE; BINS * width * height];
        for (index, pixels) in chains.iter().enumerate() {
            let start = chains.start(index);
            let positions = &chains.positions()[start..start + pixels.len()];
            for (index_in_chain, &[x, y]) in pixels.iter().enumerate() {
                let vector = |i: usize| Vector2::from(positions[i]);
                let ahead = vector((index_in_chain + REACH).min(pixels.len() - 1));
                let behind = vector(index_in_chain.saturating_sub(REACH));
                let Some(direction) = (ahead - behind).try_normalize(0.0) else {
                    continue;
                };
                let bin = direction_bin(direction.map(f64::from), BINS);
                let pixel = usize::from(y) * width + usize::from(x);
                for bin in [bin, bin + 1, bin + BINS - 1] {
                    nearest[(bin % BINS) * width * height + pixel] = seeds.len() as u32;
                }
                seeds.push(Seed {
                    position: vector(index_in_chain),
                    direction,
                });
            }
        }
        let mut field = Self {
            width,
            height,
            seeds,
            nearest,
        };
        for bin in 0..BINS {
            field.spread(bin);
        }
        field
    }

    /// Distance transform in two passes: each pixel takes the nearest seed of its neighbours.
    fn spread(&mut self, bin: usize) {
        let (width, height) = (self.width, self.height);
        if width < 2 || height < 2 {
            return;
        }
        let plane = &mut self.nearest[bin * width * height..(bin + 1) * width * height];
        let seeds = &self.seeds;
        let mut improve = |x: usize, y: usize, neighbours: [(isize, isize); 4]| {
            let here = Vector2::new(x as f32, y as f32);
            let squared = |seed: u32| (seeds[seed as usize].position - here).norm_squared();
            let mut best = plane[y * width + x];
            let mut least = if best == NONE {
                f32::INFINITY
            } else {
                squared(best)
            };
            for (dx, dy) in neighbours {
                let (nx, ny) = (x as isize + dx, y as isize + dy);
                if nx < 0 || ny < 0 || nx >= width as isize || ny >= height as isize {
                    continue;
                }
                let seed = plane[ny as usize * width + nx as usize];
                if seed != NONE && seed != best {
                    let distance = squared(seed);
                    if distance < least {
                        (best, least) = (seed, distance);
                    }
                }
            }
            plane[y * width + x] = best;
        };
        for y in 0..height {
            for x in 0..width {
                improve(x, y, [(-1, 0), (-1, -1), (0, -1), (1, -1)]);
            }
        }
        for y in (0..height).rev() {
            for x in (0..width).rev() {
                improve(x, y, [(1, 0), (1, 1), (0, 1), (-1, 1)]);
            }
        }
    }

    /// The bin of lines along a direction.
    pub(super) fn bin(direction: Vector2<f64>) -> usize {
        direction_bin(direction, BINS)
    }

    /// Distance in pixels from a position to the nearest edge of a bin, at most [`EdgeField::CAP`]: perpendicular to the edge
    /// where it passes the position, otherwise to its nearest pixel.
    pub(super) fn distance(&self, position: Point2<f64>, bin: usize) -> f64 {
        let (x, y) = (position.x.round(), position.y.round());
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64) {
            return Self::CAP;
        }
        let pixel = y as usize * self.width + x as usize;
        let seed = self.nearest[bin * self.width * self.height + pixel];
        if seed == NONE {
            return Self::CAP;
        }
        let seed = &self.seeds[seed as usize];
        let offset = position.coords - seed.position.map(f64::from);
        let direction = seed.direction.map(f64::from);
        let distance = if offset.dot(&direction).abs() <= 1.5 {
            offset.perp(&direction).abs()
        } else {
            offset.norm()
        };
        distance.min(Self::CAP)
    }
}

#[cfg(test)]
mod tests {
    use linecarve_lines::edges::{EdgeDetector, EdgeOptions};
    use linecarve_lines::image::GrayImage;

    use super::*;

    fn step() -> EdgeField {
        let samples = (0..64 * 48).map(|i| if i % 64 < 30 { 40 } else { 200 });
        let image = GrayImage::new(64, 48, samples.collect()).unwrap();
        let mut detector = EdgeDetector::new(EdgeOptions::default()).unwrap();
        EdgeField::new(&detector.detect(&image))
    }

    #[test]
    fn distance_is_across_the_edge() {
        let field = step();
        let vertical = EdgeField::bin(Vector2::new(0.0, -1.0));
        let at = |x: f64| field.distance(Point2::new(x, 24.3), vertical);
        assert!(at(29.5) < 0.51);
        assert!((at(34.0) - at(32.0) - 2.0).abs() < 1e-6);
        assert_eq!(at(60.0), EdgeField::CAP);
        assert_eq!(
            field.distance(Point2::new(-5.0, 3.0), vertical),
            EdgeField::CAP
        );
    }

    #[test]
    fn edges_of_another_direction_do_not_count() {
        let field = step();
        let horizontal = EdgeField::bin(Vector2::new(1.0, 0.02));
        assert_eq!(
            field.distance(Point2::new(29.5, 24.0), horizontal),
            EdgeField::CAP
        );
        assert_eq!(EdgeField::bin(Vector2::new(1.0, -0.01)), 0);
        assert_eq!(EdgeField::bin(Vector2::new(-1.0, 0.01)), 0);
    }

    #[test]
    fn no_edges_are_far_away() {
        let field = EdgeField::new(&EdgeChains::new(0, 0));
        assert_eq!(field.distance(Point2::origin(), 0), EdgeField::CAP);
    }
}
