//! The noise of points: how far they lie from the plane through the points around them.

use std::ops::Range;

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::octree::DEPTH;

/// Least number of points of a plane: the standard deviation is then known to a fifth.
const LEAST_POINTS: usize = 16;
/// Largest standard deviation of the points of a plane, as a share of the side of their cube.
const LARGEST_SHARE: f64 = 0.1;
/// Standard deviation of a normal distribution over the median of its absolute value.
const SIGMA_OVER_MEDIAN: f64 = 1.4826;
/// Points that are further from a plane than this many deviations do not belong to it.
const LARGEST_SIGMAS: f64 = 4.0;

/// The surface around a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Patch {
    /// Standard deviation of its points across it.
    pub(super) sigma: f64,
    /// Its largest component is positive.
    pub(super) normal: Vector3<f64>,
    /// How far its points are apart.
    pub(super) spacing: f64,
}

/// A plane and the deviation of points from it.
struct Plane {
    center: Point3<f64>,
    normal: Vector3<f64>,
    sigma: f64,
}

impl Plane {
    /// The plane of least squares through points, without those that are far from it.
    fn through(points: &[Point3<f64>], residuals: &mut Vec<f64>) -> Option<Self> {
        let first = Self::of(points.iter(), points, residuals)?;
        let reach = LARGEST_SIGMAS * first.sigma;
        let near = points.iter().filter(|point| first.distance(point) <= reach);
        Self::of(near, points, residuals)
    }

    fn of<'a>(
        near: impl Iterator<Item = &'a Point3<f64>> + Clone,
        all: &[Point3<f64>],
        residuals: &mut Vec<f64>,
    ) -> Option<Self> {
        let first = all.first()?;
        let count = near.clone().count() as f64;
        let sum: Vector3<f64> = near.clone().map(|point| point - first).sum();
        let center = first + sum / count;
        let outer = near.map(|point| (point - center) * (point - center).transpose());
        let covariance: Matrix3<f64> = outer.sum();
        if !covariance.iter().all(|x| x.is_finite()) {
            return None;
        }
        let eigen = SymmetricEigen::new(covariance);
        let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        let normal = match normal[normal.iamax()] > 0.0 {
            true => normal,
            false => -normal,
        };
        let mut plane = Self {
            center,
            normal,
            sigma: 0.0,
        };
        residuals.clear();
        residuals.extend(all.iter().map(|point| plane.distance(point)));
        let middle = residuals.len() / 2;
        let (_, median, _) = residuals.select_nth_unstable_by(middle, f64::total_cmp);
        let freedom = (all.len() as f64 / (all.len() as f64 - 3.0)).sqrt();
        plane.sigma = SIGMA_OVER_MEDIAN * freedom * *median;
        Some(plane)
    }

    fn distance(&self, point: &Point3<f64>) -> f64 {
        (point - self.center).dot(&self.normal).abs()
    }
}

/// The surface around each point of a cube of side `side`, from the smallest cube of the octree in which the points lie on a plane. `points`
/// are sorted by `codes`, which say where they are along the curve.
///
/// # Complexity
/// `n log n` in the number of points.
pub(super) fn patches(points: &[Point3<f64>], codes: &[u64], side: f64) -> Vec<Option<Patch>> {
    let mut found = Found {
        points,
        codes,
        patches: vec![None; points.len()],
        residuals: Vec::new(),
    };
    found.search(0..points.len(), 0, side);
    found.patches
}

struct Found<'a> {
    points: &'a [Point3<f64>],
    codes: &'a [u64],
    patches: Vec<Option<Patch>>,
    residuals: Vec<f64>,
}

impl Found<'_> {
    fn search(&mut self, range: Range<usize>, depth: u32, side: f64) {
        if range.len() < LEAST_POINTS {
            return;
        }
        let points = &self.points[range.clone()];
        if let Some(plane) = Plane::through(points, &mut self.residuals)
            && plane.sigma <= LARGEST_SHARE * side
        {
            let patch = Patch {
                sigma: plane.sigma,
                normal: plane.normal,
                spacing: side / (range.len() as f64).sqrt(),
            };
            for index in range.clone() {
                let is_near = plane.distance(&self.points[index]) <= LARGEST_SIGMAS * plane.sigma;
                self.patches[index] = is_near.then_some(patch).or(self.patches[index]);
            }
        }
        if depth == DEPTH {
            return;
        }
        let shift = 3 * (DEPTH - depth - 1);
        let mut start = range.start;
        while start < range.end {
            let octant = self.codes[start] >> shift;
            let rest = &self.codes[start..range.end];
            let end = start + rest.partition_point(|code| code >> shift == octant);
            self.search(start..end, depth + 1, 0.5 * side);
            start = end;
        }
    }
}
