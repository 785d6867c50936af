//! Regions of triangles on planes, by region growing.
//!
//! 1. **Noise**: planes are fitted to patches of triangles all over the surface. The median of their residuals, by area, is the noise.
//! 2. **Seeds**: triangles in the order of how little normals turn around them.
//! 3. **Growth** over edges, while corners lie within three standard deviations of the plane and the normal is that of the plane, up to what
//!    the noise makes of the normal of so small a triangle. The plane is fitted anew whenever the region has doubled.
//!
//! # Reference
//! F. Lafarge, C. Mallet, *Creating large-scale city models from 3D-point clouds*, IJCV 2012, section 3 (region growing).

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::plane::{Moments, Plane};
use crate::surface::Surface;

/// Triangles of a patch for the measurement of noise. Tuned on the kitchen, the living room, the sample and the bare room.
const PATCH: usize = 200;
/// Patches for it, at most.
const PATCHES: usize = 1000;
/// Triangles that a region has at least.
const LEAST_TRIANGLES: usize = 6;
/// Triangles around a seed to which its plane is fitted first.
const SEED: usize = 12;
/// A normal may differ from that of its plane by this angle without noise, and by twice as much with any: radians.
const ANGLE: f64 = 25.0 * std::f64::consts::PI / 180.0;
/// Corners lie within this many standard deviations of a plane.
pub(crate) const REACH: f64 = 3.0;

/// A region on a plane.
#[derive(Debug, Clone)]
pub(crate) struct Region {
    pub(crate) plane: Plane,
    pub(crate) moments: Moments,
    pub(crate) triangles: Vec<u32>,
}

/// The triangles nearest to one over edges, which turn by less than [`ANGLE`] from it.
fn patch(surface: &Surface, seed: u32, count: usize, is_free: impl Fn(u32) -> bool) -> Vec<u32> {
    let normal = surface.normals[seed as usize];
    let mut found = vec![seed];
    let mut next = 0;
    while next < found.len() && found.len() < count {
        for other in surface.neighbours(found[next]) {
            let turns = normal.dot(&surface.normals[other as usize]);
            if turns > ANGLE.cos() && is_free(other) && !found.contains(&other) {
                found.push(other);
            }
        }
        next += 1;
    }
    found
}

/// Sums over the corners of triangles, each weighted by the inverse of how many of them it has: every vertex counts about once.
pub(crate) fn moments_of(surface: &Surface, triangles: &[u32]) -> Moments {
    let mut moments = Moments::new();
    for vertex in surface.vertices_of(triangles) {
        moments.add(&surface.positions[vertex as usize], 1.0);
    }
    moments
}

/// The mean normal of triangles, by area.
pub(crate) fn mean_normal(surface: &Surface, triangles: &[u32]) -> Vector3<f64> {
    let normals = triangles.iter().map(|it| *it as usize);
    normals
        .map(|it| surface.areas[it] * surface.normals[it])
        .sum()
}

/// Standard deviation of the vertices of a surface across it, where it is flat.
pub(crate) fn noise(surface: &Surface) -> f64 {
    let count = surface.triangles.len();
    let step = count.div_ceil(PATCHES).max(1);
    let mut residuals: Vec<(f64, f64)> = Vec::new();
    for seed in (0..count as u32).step_by(step) {
        let triangles = patch(surface, seed, PATCH, |_| true);
        let moments = moments_of(surface, &triangles);
        let plane = moments.plane(&surface.normals[seed as usize]);
        if let Some(plane) = plane.filter(|_| moments.count > 6.0) {
            let freedom = moments.count / (moments.count - 3.0);
            let residual = (moments.mean_square(&plane) * freedom).sqrt();
            residuals.push((residual, surface.areas[seed as usize]));
        }
    }
    residuals.sort_by(|a, b| a.0.total_cmp(&b.0));
    let half: f64 = 0.5 * residuals.iter().map(|it| it.1).sum::<f64>();
    let mut area = 0.0;
    let median = residuals.iter().find(|(_, own)| {
        area += own;
        area >= half
    });
    // Single precision of files bounds the noise from below.
    let extent = surface.positions.iter().map(|it| it.coords.amax());
    let least = extent.fold(0.0, f64::max) * f64::from(f32::EPSILON);
    median.map_or(least, |(residual, _)| residual.max(least))
}

/// How little normals turn around each triangle: 0 where the triangles within two edges have one normal, up to 1.
fn turning(surface: &Surface) -> Vec<f64> {
    let weighted = |it: usize| surface.areas[it] * surface.normals[it];
    let mut sums: Vec<Vector3<f64>> = (0..surface.areas.len()).map(weighted).collect();
    let mut areas = surface.areas.clone();
    for _ in 0..3 {
        let around = |it: u32| std::iter::once(it).chain(surface.neighbours(it));
        let all = 0..surface.areas.len() as u32;
        let next = all
            .clone()
            .map(|it| around(it).map(|at| sums[at as usize]).sum());
        let next_areas = all.map(|it| around(it).map(|at| areas[at as usize]).sum());
        (sums, areas) = (next.collect(), next_areas.collect());
    }
    let flatness = sums.iter().zip(&areas);
    flatness
        .map(|(sum, area)| 1.0 - sum.norm() / area)
        .collect()
}

/// Grows regions until no seed is left; each triangle is in one region at most.
///
/// # Complexity
/// O(n log n).
pub(crate) fn grow(surface: &Surface, sigma: f64) -> Vec<Region> {
    let turning = turning(surface);
    let mut seeds: Vec<u32> = (0..surface.triangles.len() as u32).collect();
    seeds.sort_by(|a, b| turning[*a as usize].total_cmp(&turning[*b as usize]));
    let mut growth = Growth {
        surface,
        reach: REACH * sigma,
        is_taken: vec![false; surface.triangles.len()],
        visited: vec![0; surface.triangles.len()],
        pass: 0,
    };
    let mut regions = Vec::new();
    for seed in seeds {
        if growth.is_taken[seed as usize] {
            continue;
        }
        let start = patch(surface, seed, SEED, |it| !growth.is_taken[it as usize]);
        let moments = moments_of(surface, &start);
        let facing = surface.normals[seed as usize];
        let Some(plane) = moments.plane(&facing) else {
            continue;
        };
        // Grown twice: the second time from the whole region, around the plane that the first growth found.
        let region = growth.region(&start, plane);
        let region = region.and_then(|it| growth.region(&it.triangles, it.plane));
        if let Some(region) = region {
            (region.triangles.iter()).for_each(|it| growth.is_taken[*it as usize] = true);
            regions.push(region);
        }
    }
    regions
}

struct Growth<'a> {
    surface: &'a Surface,
    reach: f64,
    is_taken: Vec<bool>,
    /// The last pass that looked at each triangle.
    visited: Vec<u32>,
    pass: u32,
}

impl Growth<'_> {
    fn fits(&self, triangle: u32, plane: &Plane) -> bool {
        let corners = self.surface.corners(triangle);
        let is_near = corners
            .iter()
            .all(|it| plane.distance(it).abs() <= self.reach);
        is_near && {
            let [a, b, c] = corners;
            let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
            let height = 2.0 * self.surface.areas[triangle as usize] / longest;
            let allowed = (ANGLE + (self.reach / height).atan()).min(2.0 * ANGLE);
            self.surface.normals[triangle as usize].dot(&plane.normal) >= allowed.cos()
        }
    }

    fn region(&mut self, start: &[u32], mut plane: Plane) -> Option<Region> {
        self.pass += 1;
        let mut found: Vec<u32> = Vec::new();
        let mut queue: VecDeque<u32> = VecDeque::new();
        for &triangle in start {
            self.visited[triangle as usize] = self.pass;
            if self.fits(triangle, &plane) {
                found.push(triangle);
                queue.push_back(triangle);
            }
        }
        let mut next_fit = (2 * found.len()).max(2 * SEED);
        while let Some(triangle) = queue.pop_front() {
            for other in self.surface.neighbours(triangle) {
                let is_new = self.visited[other as usize] != self.pass;
                if is_new && !self.is_taken[other as usize] && self.fits(other, &plane) {
                    self.visited[other as usize] = self.pass;
                    found.push(other);
                    queue.push_back(other);
                }
            }
            if found.len() >= next_fit {
                plane = moments_of(self.surface, &found).plane(&plane.normal)?;
                next_fit = 2 * found.len();
            }
        }
        let moments = moments_of(self.surface, &found);
        let plane = moments.plane(&plane.normal)?;
        let region = Region {
            plane,
            moments,
            triangles: found,
        };
        (region.triangles.len() >= LEAST_TRIANGLES).then_some(region)
    }
}
