//! Components that may be too small: each tile lists the parts that it sees.

use rustc_hash::{FxHashMap, FxHashSet};

use crate::error::TilesError;
use crate::surface_file::{IdTriangle, SurfaceFile};
use crate::tile::tile_of;

/// Components of tiles that are left out.
#[derive(Default)]
pub(super) struct TooSmall(FxHashSet<(u32, u32)>);

/// A part of a component as a tile sees it: the tile, and its number there.
type Part = (u32, u32);

impl TooSmall {
    /// Joins the parts that share a triangle. What a tile of one of its corners does not list is large enough there.
    pub(super) fn among(files: &[SurfaceFile], least: usize) -> Result<Self, TilesError> {
        let mut listed: Vec<(IdTriangle, Part)> = Vec::new();
        for (tile, file) in (0u32..).zip(files) {
            let small = file.small()?.into_iter();
            listed.extend(small.map(|(triangle, part)| (triangle, (tile, part))));
        }
        listed.sort_unstable();
        let mut parts: Vec<Part> = listed.iter().map(|(_, part)| *part).collect();
        parts.sort_unstable();
        parts.dedup();
        let numbers: FxHashMap<Part, usize> = parts.iter().copied().zip(0..).collect();
        let mut parents: Vec<usize> = (0..parts.len()).collect();
        fn find(parents: &mut [usize], mut part: usize) -> usize {
            while parents[part] != part {
                parents[part] = parents[parents[part]];
                part = parents[part];
            }
            part
        }
        let mut triangles = vec![0usize; parts.len()];
        let mut is_large = vec![false; parts.len()];
        for same in listed.chunk_by(|a, b| a.0 == b.0) {
            let first = numbers[&same[0].1];
            triangles[first] += 1;
            for (_, part) in same {
                let (a, b) = (find(&mut parents, first), find(&mut parents, numbers[part]));
                parents[a.max(b)] = a.min(b);
            }
            let mut tiles = same[0].0.map(|id| tile_of(id) as u32).to_vec();
            tiles.retain(|tile| !same.iter().any(|(_, part)| part.0 == *tile));
            is_large[first] |= !tiles.is_empty();
        }
        for part in 0..parts.len() {
            let root = find(&mut parents, part);
            if root != part {
                triangles[root] += triangles[part];
                is_large[root] |= is_large[part];
            }
        }
        let is_too_small = |part: usize, parents: &mut [usize]| {
            let root = find(parents, part);
            !is_large[root] && triangles[root] < least
        };
        let mut found = FxHashSet::default();
        for (part, &name) in parts.iter().enumerate() {
            if is_too_small(part, &mut parents) {
                found.insert(name);
            }
        }
        Ok(Self(found))
    }

    pub(super) fn contains(&self, tile: usize, component: u32) -> bool {
        component > 0 && self.0.contains(&(tile as u32, component))
    }
}
