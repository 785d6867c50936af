//! A grid of voxels that finds the segments of which an end is near a segment, or that an end of it is near.
//!
//! Bounding boxes of long segments that are not along an axis overlap most of a map; voxels follow the segment.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::representative::WorldSegment;

/// Largest number of voxels along a segment; longer ones are compared with every segment.
const LONGEST: f64 = 1024.0;

type Voxel = [i32; 3];

/// Segments by number, in the voxels of their ends and in those along them.
#[derive(Debug, Clone)]
pub(super) struct SegmentGrid {
    /// Side of a voxel.
    side: f64,
    ends: FxHashMap<Voxel, Vec<u32>>,
    bodies: FxHashMap<Voxel, Vec<u32>>,
    /// Segments too long for the grid.
    long: Vec<u32>,
    /// Number of segments.
    len: usize,
    /// Reused memory: voxels of one segment.
    voxels: Vec<Voxel>,
}

impl SegmentGrid {
    /// An empty grid for queries within `reach`.
    pub(super) fn new(reach: f64) -> Self {
        Self {
            // A place within reach of a segment is within a voxel of a sample, as samples are half a voxel apart.
            side: 2.0 * reach,
            ends: FxHashMap::default(),
            bodies: FxHashMap::default(),
            long: Vec::new(),
            len: 0,
            voxels: Vec::new(),
        }
    }

    /// Number of segments.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Far coordinates saturate, which only makes queries there slower.
    fn voxel(&self, point: &Point3<f64>) -> Voxel {
        [0, 1, 2].map(|k| (point[k] / self.side).floor() as i32)
    }

    /// Samples along a segment, less than half a voxel apart, both ends included; `None` when it is too long.
    fn samples(&self, segment: &WorldSegment) -> Option<impl Iterator<Item = Point3<f64>> + use<>> {
        let [from, to] = segment.ends;
        let count = (2.0 * segment.length() / self.side).ceil();
        (count <= 2.0 * LONGEST).then(|| {
            let count = (count as u32).max(1);
            (0..=count).map(move |k| from + (to - from) * (f64::from(k) / f64::from(count)))
        })
    }

    /// The voxels along a segment, each once.
    fn trace(&mut self, segment: &WorldSegment) -> bool {
        let mut voxels = std::mem::take(&mut self.voxels);
        voxels.clear();
        let samples = self.samples(segment);
        let is_traced = samples.is_some();
        voxels.extend(samples.into_iter().flatten().map(|at| self.voxel(&at)));
        voxels.dedup();
        self.voxels = voxels;
        is_traced
    }

    /// Adds a segment.
    pub(super) fn insert(&mut self, segment: &WorldSegment, id: u32) {
        self.len += 1;
        if !self.trace(segment) {
            self.long.push(id);
            return;
        }
        for voxel in &self.voxels {
            self.bodies.entry(*voxel).or_default().push(id);
        }
        for end in &segment.ends {
            let voxel = self.voxel(end);
            self.ends.entry(voxel).or_default().push(id);
        }
    }

    /// Removes a segment that was added with these ends.
    pub(super) fn remove(&mut self, segment: &WorldSegment, id: u32) {
        self.len -= 1;
        if !self.trace(segment) {
            self.long.retain(|other| *other != id);
            return;
        }
        for voxel in &self.voxels {
            forget(&mut self.bodies, voxel, id);
        }
        for end in &segment.ends {
            let voxel = self.voxel(end);
            forget(&mut self.ends, &voxel, id);
        }
    }

    /// Fills `found` with the segments of which an end may be within reach of `segment`, or which may be within reach of
    /// one of its ends, ascending; `None` when that may be any.
    ///
    /// # Complexity
    /// Linear in the length of the segment in voxels and in the segments found.
    pub(super) fn near<'a>(
        &self,
        segment: &WorldSegment,
        found: &'a mut Vec<u32>,
    ) -> Option<&'a [u32]> {
        found.clear();
        let mut seen: Option<Voxel> = None;
        for at in self.samples(segment)? {
            let voxel = self.voxel(&at);
            if seen.replace(voxel) != Some(voxel) {
                collect(&self.ends, voxel, found);
            }
        }
        for end in &segment.ends {
            collect(&self.bodies, self.voxel(end), found);
        }
        found.extend(&self.long);
        found.sort_unstable();
        found.dedup();
        Some(found)
    }
}

fn forget(map: &mut FxHashMap<Voxel, Vec<u32>>, voxel: &Voxel, id: u32) {
    if let Some(ids) = map.get_mut(voxel) {
        if let Some(place) = ids.iter().position(|other| *other == id) {
            ids.swap_remove(place);
        }
        if ids.is_empty() {
            map.remove(voxel);
        }
    }
}

/// Appends what a voxel and its neighbours hold.
fn collect(map: &FxHashMap<Voxel, Vec<u32>>, [x, y, z]: Voxel, found: &mut Vec<u32>) {
    for dx in -1..=1 {
        for dy in -1..=1 {
            for dz in -1..=1 {
                let voxel = [
                    x.saturating_add(dx),
                    y.saturating_add(dy),
                    z.saturating_add(dz),
                ];
                if let Some(ids) = map.get(&voxel) {
                    found.extend(ids);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(a: [f64; 3], b: [f64; 3]) -> WorldSegment {
        WorldSegment::new([a.into(), b.into()]).unwrap()
    }

    /// Distance of a point from a segment.
    fn distance(point: &Point3<f64>, segment: &WorldSegment) -> f64 {
        let [a, b] = segment.ends;
        let share = (point - a).dot(&(b - a)) / (b - a).norm_squared();
        (point - (a + share.clamp(0.0, 1.0) * (b - a))).norm()
    }

    #[test]
    fn everything_within_reach_is_found_and_what_is_removed_is_not() {
        let reach = 0.02;
        let mut grid = SegmentGrid::new(reach);
        // A low-discrepancy sequence in place of random numbers.
        let at = |k: u32| {
            [0.7548776662, 0.5698402910, 0.4301597090]
                .map(|step: f64| (step * f64::from(k)).fract())
        };
        let segments: Vec<WorldSegment> = (0..600)
            .map(|k| segment(at(2 * k), at(2 * k + 7)))
            .collect();
        for (id, segment) in (0..).zip(&segments) {
            grid.insert(segment, id);
        }
        let mut found = Vec::new();
        let mut largest = 0;
        for query in &segments {
            let near = grid.near(query, &mut found).unwrap();
            largest = largest.max(near.len());
            for (id, other) in (0..).zip(&segments) {
                let touches = |a: &WorldSegment, b: &WorldSegment| {
                    b.ends.iter().any(|end| distance(end, a) <= reach)
                };
                if touches(query, other) || touches(other, query) {
                    assert!(near.binary_search(&id).is_ok());
                }
            }
        }
        assert!(largest < 500);
        for (id, segment) in (0..).zip(&segments) {
            grid.remove(segment, id);
        }
        assert!(grid.ends.is_empty() && grid.bodies.is_empty() && grid.len() == 0);
    }

    #[test]
    fn a_segment_too_long_for_the_grid_is_compared_with_all() {
        let mut grid = SegmentGrid::new(1e-3);
        let long = segment([0.0; 3], [1e9, 0.0, 0.0]);
        grid.insert(&long, 0);
        let mut found = Vec::new();
        assert!(grid.near(&long, &mut found).is_none());
        let short = segment([0.0; 3], [0.01, 0.0, 0.0]);
        assert_eq!(grid.near(&short, &mut found), Some(&[0][..]));
        grid.remove(&long, 0);
        assert_eq!(grid.near(&short, &mut found), Some(&[][..]));
    }
}
