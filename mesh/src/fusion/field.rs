//! Mean distance from measured depth at the corners of a grid.

use nalgebra::Point3;
use rayon::prelude::*;

use super::blocks::{CornerBits, CornerSet};
use super::grid::Corner;
use super::{FusionOptions, PosedDepth};

/// Blocks of corners that are looked at together: views that see none of them are skipped.
const CHUNK: usize = 16;

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
                for point in view.points() {
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
        let distances = corners
            .blocks()
            .par_chunks(CHUNK)
            .flat_map_iter(|chunk| {
                let corners = chunk.iter().flat_map(|block| block.corners());
                let positions: Vec<_> = corners.map(|it| it.position(side)).collect();
                mean_distances(views, &positions, truncation)
            })
            .collect();
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

/// Mean distances at near positions. Each view that measured a surface behind a position, or at most `truncation` before it, counts alike; more than
/// `truncation` before the surface is as good as `truncation`. A position that none measured closer than that is unknown.
fn mean_distances(
    views: &[PosedDepth<'_>],
    positions: &[Point3<f64>],
    truncation: f64,
) -> Vec<f32> {
    let mut sums = vec![(0.0_f64, 0_u32, false); positions.len()];
    let (mut low, mut high) = (positions[0], positions[0]);
    for position in positions {
        (low, high) = (low.inf(position), high.sup(position));
    }
    let center = nalgebra::center(&low, &high);
    let radius = (high - center).norm();
    for view in views.iter().filter(|view| view.may_see(&center, radius)) {
        for (position, (sum, count, is_near)) in positions.iter().zip(&mut sums) {
            let Some(distance) = view.distance(position) else {
                continue;
            };
            if distance >= -truncation {
                *sum += distance.min(truncation);
                *count += 1;
                *is_near |= distance <= truncation;
            }
        }
    }
    let mean = |(sum, count, is_near): (f64, u32, bool)| match is_near {
        true => (sum / f64::from(count)) as f32,
        false => f32::NAN,
    };
    sums.into_iter().map(mean).collect()
}

impl PosedDepth<'_> {
    /// Whether a sphere may be seen: not behind the camera, and not beside all of its image.
    fn may_see(&self, center: &Point3<f64>, radius: f64) -> bool {
        let center = self.depth_from_world * center;
        if center.z < -radius {
            return false;
        }
        self.depth
            .sides()
            .iter()
            .all(|inward| inward.dot(&center.coords) >= -radius)
    }
}
