//! Mean distance from measured depth at the corners of a grid.

use nalgebra::Point3;
use rayon::prelude::*;
use wide::f32x4;

use super::blocks::{Block, CornerBits, CornerSet, Nearby};
use super::grid::{Corner, coordinates_below};
use super::outlines::Outlines;
use super::view::{View, sphere_around};
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
    /// The field of all views. The outlines are shown their images as well.
    pub(super) fn new(
        views: &[PosedDepth<'_>],
        options: &FusionOptions,
        outlines: &mut Outlines<'_>,
    ) -> Self {
        let side = options.side;
        let mut cubes = views
            .par_iter()
            .fold(CornerBits::default, |mut cubes, view| {
                let mut last = None;
                for point in View::new(view).points() {
                    // Neighbouring pixels mostly lie in one cube.
                    let cube = coordinates_below(&point, side);
                    if cube != last {
                        let corner = cube.and_then(|it| Corner::new(it.map(i64::from)));
                        corner.into_iter().for_each(|corner| cubes.insert(corner));
                        last = cube;
                    }
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
        let distances = mean_distances(views, &corners, side, truncation, outlines);
        Self {
            side,
            cubes: set,
            corners,
            distances,
        }
    }

    /// The distance at a corner of some blocks of the corners; NaN where it is unknown.
    #[inline]
    pub(super) fn distance(&self, corners: &Nearby<'_>, corner: Corner) -> f32 {
        let number = corners.number(corner);
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
    outlines: &mut Outlines<'_>,
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
            .for_each_init(Vec::new, |groups, chunk| {
                chunk.add(&views, side, truncation, groups);
            });
        outlines.observe(&views);
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

    /// Adds a distance unless it is unknown or the corner lies too far behind the surface. It selects instead of branching: branches would be
    /// mispredicted, as corners differ without a pattern.
    #[inline]
    fn add(&mut self, distance: f64, truncation: f64) {
        let is_seen = distance >= -truncation;
        let is_near = distance <= truncation;
        let clipped = if is_near { distance } else { truncation };
        let added = if is_seen { clipped } else { 0.0 };
        self.sum = (f64::from_ne_bytes(self.sum) + added).to_ne_bytes();
        self.count = (self.count + 2 * u32::from(is_seen)) | u32::from(is_seen & is_near);
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
        let (center, radius) = sphere_around(positions_of(blocks, side));
        Self {
            blocks,
            center,
            radius,
            sums,
        }
    }

    /// Adds the distances that views measured, in their order. `groups` is reused memory.
    fn add(&mut self, views: &[View], side: f64, truncation: f64, groups: &mut Vec<[f32x4; 3]>) {
        groups.clear();
        for view in views {
            let center = view.in_camera(&self.center);
            if !view.may_see(&center, self.radius) {
                continue;
            }
            if groups.is_empty() {
                self.fill(groups, side);
            }
            for (offsets, sums) in groups.iter().zip(self.sums.chunks_mut(4)) {
                let distances = view.distances(&center, offsets).to_array();
                for (distance, sum) in distances.into_iter().zip(sums) {
                    sum.add(f64::from(distance), truncation);
                }
            }
        }
    }

    /// Offsets of its corners from its center, four together.
    fn fill(&self, groups: &mut Vec<[f32x4; 3]>, side: f64) {
        let mut positions = positions_of(self.blocks, side);
        for _ in 0..self.sums.len().div_ceil(4) {
            let mut group = [[0.0; 4]; 3];
            for (lane, position) in (0..4).zip(&mut positions) {
                for (axis, along) in (position - self.center).iter().enumerate() {
                    group[axis][lane] = *along as f32;
                }
            }
            groups.push(group.map(f32x4::new));
        }
    }
}

fn positions_of(blocks: &[Block], side: f64) -> impl Iterator<Item = Point3<f64>> + '_ {
    let corners = blocks.iter().flat_map(|block| block.corners());
    corners.map(move |corner| corner.position(side))
}
