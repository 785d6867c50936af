//! Mean distance from measured depth at the corners of a grid.

use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::grid::Corner;
use super::{FusionOptions, PosedDepth};

/// Corners that are looked at together: views that see none of them are skipped.
const CHUNK: usize = 512;

/// Mean signed distances at the corners of the cubes around measured points.
pub(super) struct Field {
    pub(super) side: f64,
    /// Cubes near measured points by their lowest corners, ascending.
    pub(super) cubes: Vec<Corner>,
    /// All corners of these cubes, ascending.
    pub(super) corners: Vec<Corner>,
    /// Distance at each corner, positive before the surface; NaN where no view measured one.
    pub(super) distances: Vec<f32>,
    numbers: FxHashMap<Corner, u32>,
}

impl Field {
    pub(super) fn new(views: &[PosedDepth<'_>], options: &FusionOptions) -> Self {
        let side = options.side;
        let mut cubes: Vec<Corner> = views
            .par_iter()
            .flat_map_iter(|view| {
                let mut cubes: Vec<Corner> = Vec::new();
                for point in view.points() {
                    // Neighbouring pixels mostly lie in one cube.
                    if let Some(cube) = Corner::below(&point, side)
                        && cubes.last() != Some(&cube)
                    {
                        cubes.push(cube);
                    }
                }
                sort(&mut cubes);
                cubes
            })
            .collect();
        sort(&mut cubes);
        for axis in 0..3 {
            let around = |cube: &Corner| [cube.previous(axis), *cube, cube.next(axis)];
            cubes = cubes.iter().flat_map(around).collect();
            sort(&mut cubes);
        }
        let mut corners = cubes.clone();
        for axis in 0..3 {
            corners = corners.iter().flat_map(|it| [*it, it.next(axis)]).collect();
            sort(&mut corners);
        }
        let truncation = options.truncation_sides * side;
        let distances = corners
            .par_chunks(CHUNK)
            .flat_map_iter(|chunk| mean_distances(views, chunk, side, truncation))
            .collect();
        let numbers = corners
            .iter()
            .zip(0..)
            .map(|(corner, number)| (*corner, number));
        Self {
            side,
            numbers: numbers.collect(),
            cubes,
            corners,
            distances,
        }
    }

    /// Number of a corner, for [`distances`](Self::distances).
    pub(super) fn number(&self, corner: Corner) -> Option<usize> {
        self.numbers.get(&corner).map(|number| *number as usize)
    }
}

fn sort(corners: &mut Vec<Corner>) {
    corners.par_sort_unstable();
    corners.dedup();
}

/// Mean distances at near corners. Each view that measured a surface behind a corner, or at most `truncation` before it, counts alike; more than
/// `truncation` before the surface is as good as `truncation`. A corner that none measured closer than that is unknown.
fn mean_distances(
    views: &[PosedDepth<'_>],
    corners: &[Corner],
    side: f64,
    truncation: f64,
) -> Vec<f32> {
    let positions: Vec<Point3<f64>> = corners.iter().map(|it| it.position(side)).collect();
    let mut sums = vec![(0.0_f64, 0_u32, false); positions.len()];
    let (mut low, mut high) = (positions[0], positions[0]);
    for position in &positions {
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
