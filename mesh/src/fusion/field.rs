//! Mean distance from measured depth at the corners of a grid.

use nalgebra::Point3;
use rayon::prelude::*;

use super::blocks::{Block, CornerBits, CornerSet};
use super::grid::Corner;
use super::view::View;
use super::{FusionOptions, PosedDepth};

/// Blocks of corners that are looked at together: views that see none of them are skipped.
const CHUNK: usize = 16;
/// Views whose images are unpacked at a time.
const UNPACKED_VIEWS: usize = 16;

/// Mean signed distances at the corners of the cubes around measured points.
pub(super) struct Field {
    pub(super) side: f64,
    /// Cubes near measured points by their lowest corners.
    pub(super) cubes: CornerSet,
    /// All corners of these cubes.
    pub(super) corners: CornerSet,
    /// Distance at each corner, positive before the surface; NaN where no view measured one.
    pub(super) distances: Vec<f32>,
}

impl Field {
    pub(super) fn new(views: &[PosedDepth<'_>], options: &FusionOptions) -> Self {
        let side = options.side;
        let mut cubes = views
            .par_iter()
            .fold(CornerBits::default, |mut cubes, view| {
                let mut last = None;
                for point in View::new(view).points() {
                    // Neighbouring pixels mostly lie in one cube.
                    let cube = Corner::below(&point, side);
                    if let Some(cube) = cube.filter(|_| cube != last) {
                        cubes.insert(cube);
                    }
                    last = cube;
                }
                cubes
            })
            .reduce(CornerBits::default, CornerBits::union);
        for axis in 0..3 {
            cubes = cubes.with_previous(axis).union(cubes.with_next(axis));
        }
        let set = CornerSet::new(&cubes);
        for axis in 0..3 {
            cubes = cubes.with_next(axis);
        }
        let corners = CornerSet::new(&cubes);
        let truncation = options.truncation_sides * side;
        let distances = mean_distances(views, &corners, side, truncation);
        Self {
            side,
            cubes: set,
            corners,
            distances,
        }
    }

    /// The distance at a corner; NaN where it is unknown.
    #[inline]
    pub(super) fn distance(&self, corner: Corner) -> f32 {
        let number = self.corners.number(corner);
        number.map_or(f32::NAN, |number| self.distances[number])
    }
}

/// Mean distances at the corners of a set, which lie `side` apart. Each view that measured a surface behind a corner, or at most `truncation`
/// before it, counts alike; more than `truncation` before the surface is as good as `truncation`. A corner that none measured closer than
/// that is unknown.
fn mean_distances(
    views: &[PosedDepth<'_>],
    corners: &CornerSet,
    side: f64,
    truncation: f64,
) -> Vec<f32> {
    let mut sums = vec![DistanceSum::default(); corners.len()];
    let mut chunks: Vec<Chunk<'_>> = Vec::with_capacity(corners.blocks().len() / CHUNK + 1);
    let mut rest = sums.as_mut_slice();
    for blocks in corners.blocks().chunks(CHUNK) {
        let len = blocks.iter().map(|block| block.len()).sum();
        let (sums, after) = rest.split_at_mut(len);
        chunks.push(Chunk::new(blocks, side, sums));
        rest = after;
    }
    for views in views.chunks(UNPACKED_VIEWS) {
        let views: Vec<View> = views.par_iter().map(View::new).collect();
        chunks
            .par_iter_mut()
            .for_each_init(Vec::new, |positions, chunk| {
                chunk.add(&views, side, truncation, positions);
            });
    }
    drop(chunks);
    sums.iter().map(DistanceSum::mean).collect()
}

/// The distances that views measured at a corner, in 12 bytes.
#[derive(Clone, Copy, Default)]
struct DistanceSum {
    /// The sum, a double, as bytes.
    sum: [u8; 8],
    /// Twice the number of views, plus one when a view measured a surface closer than the truncation.
    count: u32,
}

impl DistanceSum {
    /// NaN where the distance is unknown.
    fn mean(&self) -> f32 {
        match self.count & 1 {
            1 => (f64::from_ne_bytes(self.sum) / f64::from(self.count >> 1)) as f32,
            _ => f32::NAN,
        }
    }

    #[inline]
    fn add(&mut self, distance: f64, is_near: bool) {
        self.sum = (f64::from_ne_bytes(self.sum) + distance).to_ne_bytes();
        self.count = (self.count + 2) | u32::from(is_near);
    }
}

/// Some blocks of corners, with a sphere around them.
struct Chunk<'a> {
    blocks: &'a [Block],
    center: Point3<f64>,
    radius: f64,
    sums: &'a mut [DistanceSum],
}

impl<'a> Chunk<'a> {
    fn new(blocks: &'a [Block], side: f64, sums: &'a mut [DistanceSum]) -> Self {
        let first = blocks[0].corners().next();
        let first = first.map_or(Point3::origin(), |corner| corner.position(side));
        let (mut low, mut high) = (first, first);
        for position in positions_of(blocks, side) {
            (low, high) = (low.inf(&position), high.sup(&position));
        }
        let center = nalgebra::center(&low, &high);
        Self {
            blocks,
            center,
            radius: (high - center).norm(),
            sums,
        }
    }

    /// Adds the distances that views measured, in their order. `positions` is reused memory.
    fn add(
        &mut self,
        views: &[View],
        side: f64,
        truncation: f64,
        positions: &mut Vec<Point3<f64>>,
    ) {
        positions.clear();
        for view in views {
            if !view.may_see(&self.center, self.radius) {
                continue;
            }
            if positions.is_empty() {
                positions.extend(positions_of(self.blocks, side));
            }
            for (position, sum) in positions.iter().zip(&mut *self.sums) {
                let Some(distance) = view.distance(position) else {
                    continue;
                };
                if distance >= -truncation {
                    sum.add(distance.min(truncation), distance <= truncation);
                }
            }
        }
    }
}

fn positions_of(blocks: &[Block], side: f64) -> impl Iterator<Item = Point3<f64>> + '_ {
    let corners = blocks.iter().flat_map(|block| block.corners());
    corners.map(move |corner| corner.position(side))
}
