//! Regions on one plane share it, whether they touch or not.

use linecarve_mesh::DisjointSets;

use crate::grow::Region;
use crate::plane::{Moments, Plane};

/// Regions whose normals differ by more are not compared: radians.
const ANGLE: f64 = 10.0 * std::f64::consts::PI / 180.0;
/// Residuals of a region on the common plane are at most this many times its own, or the noise.
const RATIO: f64 = 2.0;

/// Root mean square distance of the positions of a region to a plane is what it is to its own plane, up to the noise.
fn lies_on(moments: &Moments, own: &Plane, common: &Plane, sigma: f64) -> bool {
    let own = moments.mean_square(own).sqrt().max(sigma);
    moments.mean_square(common).sqrt() <= RATIO * own && moments.mean(common).abs() <= 1.5 * own
}

/// Joins regions that lie on one plane: the pair that agrees best first, until no pair agrees. Regions are returned by descending number of
/// positions.
///
/// # Complexity
/// Quadratic in the regions.
pub(crate) fn merge(mut regions: Vec<Region>, sigma: f64) -> Vec<Region> {
    regions.sort_by_key(|it| std::cmp::Reverse(it.triangles.len()));
    let mut rounds = 0;
    loop {
        let count = regions.len();
        regions = merge_once(regions, sigma);
        rounds += 1;
        if regions.len() == count || rounds == 16 {
            return regions;
        }
    }
}

/// Every region joins the region that fits it best among larger ones, from the smallest to the largest.
fn merge_once(regions: Vec<Region>, sigma: f64) -> Vec<Region> {
    let mut sets = DisjointSets::new(regions.len());
    let mut grown: Vec<(Moments, Plane)> =
        regions.iter().map(|it| (it.moments, it.plane)).collect();
    for small in (1..regions.len()).rev() {
        let (moments, plane) = grown[small];
        let mut best: Option<(f64, usize, Moments, Plane)> = None;
        for (large, (others, other)) in grown[..small].iter().enumerate() {
            if plane.normal.dot(&other.normal) < ANGLE.cos() {
                continue;
            }
            let both = moments.plus(others);
            let Some(common) = both.plane(&other.normal) else {
                continue;
            };
            let agrees =
                lies_on(&moments, &plane, &common, sigma) && lies_on(others, other, &common, sigma);
            let misfit = moments.mean_square(&common);
            if agrees && best.as_ref().is_none_or(|best| misfit < best.0) {
                best = Some((misfit, large, both, common));
            }
        }
        if let Some((_, large, both, common)) = best {
            sets.join(small as u32, large as u32);
            grown[large] = (both, common);
        }
    }
    let mut merged: Vec<Region> = Vec::new();
    let mut place = vec![usize::MAX; regions.len()];
    for (index, region) in regions.into_iter().enumerate() {
        let root = sets.find(index as u32) as usize;
        if root == index {
            place[index] = merged.len();
            let (moments, plane) = grown[index];
            merged.push(Region {
                plane,
                moments,
                ..region
            });
        } else {
            merged[place[root]].triangles.extend(region.triangles);
        }
    }
    merged.sort_by_key(|it| std::cmp::Reverse(it.triangles.len()));
    merged
}
