//! Edges with the same ends in the same fans: all but the first are split at their midpoints.

use linecarve_carving::internals::{cut_at_midpoints, rotate_smallest_first};
use rustc_hash::{FxHashMap, FxHashSet};

use super::vertices::Numbers;
use crate::error::TilesError;
use crate::surface_file::{IdTriangle, Place, SurfaceFile};
use crate::tile::tile_of;

/// An edge by its ends and its number among those with the same ids at the ends.
type Edge = (u32, u32, u32);

/// Sorted triangles.
type Parts = Vec<[u32; 3]>;

/// Edges that may be repeated, and their triangles.
#[derive(Default)]
pub(super) struct Repeated {
    /// Sorted.
    places: Vec<(Place, [f64; 3])>,
    /// Triangles with the numbers of their vertices, the smallest first, and the number of each edge that may be repeated.
    taken: Vec<([u32; 3], [Option<u32>; 3])>,
    midpoints: FxHashMap<Edge, [f64; 3]>,
}

fn ends(triangle: [u32; 3], k: usize, number: u32) -> Edge {
    let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
    (a.min(b), a.max(b), number)
}

impl Repeated {
    pub(super) fn read(files: &[SurfaceFile]) -> Result<Self, TilesError> {
        let mut found = Self::default();
        for file in files {
            found.places.extend(file.repeated()?);
        }
        found.places.sort_unstable_by_key(|(place, _)| *place);
        Ok(found)
    }

    /// The first corners of the triangles of a tile that have such an edge.
    pub(super) fn first_corners(&self, tile: usize) -> FxHashSet<u64> {
        let first = self.places.iter().map(|(place, _)| place.triangle[0]);
        first.filter(|&id| tile_of(id) == tile).collect()
    }

    /// Takes a triangle if it has such an edge.
    pub(super) fn take(&mut self, ids: &IdTriangle, triangle: [u32; 3]) -> bool {
        let first = self
            .places
            .partition_point(|(place, _)| place.triangle < *ids);
        let own = self.places[first..].iter();
        let mut numbers = [None; 3];
        for (place, midpoint) in own.take_while(|(place, _)| place.triangle == *ids) {
            let k = place.corner as usize % 3;
            numbers[k] = Some(place.number);
            let edge = ends(triangle, k, place.number);
            self.midpoints.insert(edge, *midpoint);
        }
        let is_taken = numbers != [None; 3];
        if is_taken {
            let smallest = (0..3).min_by_key(|&k| triangle[k]).unwrap_or(0);
            let rotate = |k: usize| (smallest + k) % 3;
            self.taken.push((
                [0, 1, 2].map(|k| triangle[rotate(k)]),
                [0, 1, 2].map(|k| numbers[rotate(k)]),
            ));
        }
        is_taken
    }

    /// The triangles that were taken, split where they have to be, sorted; and the positions of new vertices.
    pub(super) fn split(self, numbers: &mut Numbers) -> Result<(Parts, Vec<[f64; 3]>), TilesError> {
        let mut edges: Vec<Edge> = self.midpoints.keys().copied().collect();
        edges.sort_unstable();
        let mut positions = Vec::new();
        let mut middle: FxHashMap<Edge, u32> = FxHashMap::default();
        for pair in edges.windows(2) {
            if (pair[0].0, pair[0].1) == (pair[1].0, pair[1].1) {
                let midpoint = self.midpoints[&pair[1]];
                positions.push(midpoint);
                middle.insert(pair[1], numbers.enter(&midpoint)?);
            }
        }
        let mut parts = Vec::new();
        for (triangle, edges) in self.taken {
            let of = |k: usize| Some(*middle.get(&ends(triangle, k, edges[k]?))?);
            cut_at_midpoints(triangle, [0, 1, 2].map(of), 0, &mut parts);
        }
        for part in &mut parts {
            *part = rotate_smallest_first(*part);
        }
        parts.sort_unstable();
        Ok((parts, positions))
    }
}
