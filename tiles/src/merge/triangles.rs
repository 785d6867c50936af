//! The triangles of a tile with the numbers of their vertices, sorted.

use linecarve_carving::internals::rotate_smallest_first;
use rustc_hash::FxHashSet;

use super::repeated::Repeated;
use super::small::TooSmall;
use super::vertices::{NO_NUMBER, Numbers};
use crate::error::TilesError;
use crate::surface_file::{IdTriangle, Place, SurfaceFile};
use crate::tile::{local_of, tile_of};

/// A corner whose vertex belongs to another tile: that tile, and the corner.
type Foreign = (u32, u32);

/// The number of the fan that a corner is in.
fn fan(fans: &[Place], triangle: &IdTriangle, corner: usize) -> u32 {
    let place = (*triangle, corner as u32);
    let found = fans.binary_search_by(|fan| (fan.triangle, fan.corner).cmp(&place));
    found.map_or(0, |found| fans[found].number)
}

/// The other tiles of some triangles.
fn others(ids: &[IdTriangle], tile: usize) -> Vec<usize> {
    let tiles: FxHashSet<usize> = ids.iter().flatten().map(|&id| tile_of(id)).collect();
    let mut others: Vec<usize> = tiles.into_iter().filter(|&other| other != tile).collect();
    others.sort_unstable();
    others
}

/// The triangles of a tile that are kept, but for those with an edge that may be split.
pub(super) fn of_tile(
    tile: usize,
    (files, points): (&[SurfaceFile], &dyn Fn(usize) -> usize),
    too_small: &TooSmall,
    numbers: &mut Numbers,
    repeated: &mut Repeated,
) -> Result<Vec<[u32; 3]>, TilesError> {
    let file = &files[tile];
    let mut ids: Vec<IdTriangle> = Vec::with_capacity(file.triangles);
    for block in 0..file.triangle_blocks() {
        let triangles = file.triangle_block(block)?.into_iter();
        let kept = triangles.filter(|(_, component)| !too_small.contains(tile, *component));
        ids.extend(kept.map(|(ids, _)| ids));
    }
    let mut triangles = vec![[NO_NUMBER; 3]; ids.len()];
    let mut foreign: Vec<Foreign> = Vec::new();
    for other in std::iter::once(tile).chain(others(&ids, tile)) {
        let Some(vertices) = files.get(other) else {
            return Err(file.damaged("an unknown tile"));
        };
        let fans = vertices.fans()?;
        let vertices = numbers.of_tile(other, (vertices, points(other)))?;
        let mut fill = |corner: u32| {
            let (index, k) = (corner as usize / 3, corner as usize % 3);
            let number = vertices.get(local_of(ids[index][k]), || fan(&fans, &ids[index], k));
            triangles[index][k] = number.ok_or_else(|| file.damaged("an unknown vertex"))?;
            Ok(())
        };
        if other == tile {
            for (corner, &id) in (0u32..).zip(ids.iter().flatten()) {
                match tile_of(id) == tile {
                    true => fill(corner)?,
                    false => foreign.push((tile_of(id) as u32, corner)),
                }
            }
            foreign.sort_unstable();
        } else {
            let from = foreign.partition_point(|(owner, _)| (*owner as usize) < other);
            let own = foreign[from..].iter();
            let mut own = own.take_while(|(owner, _)| *owner as usize == other);
            own.try_for_each(|&(_, corner)| fill(corner))?;
        }
    }
    let first: FxHashSet<u64> = repeated.first_corners(tile);
    let mut index = 0;
    triangles.retain(|triangle| {
        let ids = &ids[index];
        index += 1;
        !(first.contains(&ids[0]) && repeated.take(ids, *triangle))
    });
    for triangle in &mut triangles {
        *triangle = rotate_smallest_first(*triangle);
    }
    triangles.sort_unstable();
    Ok(triangles)
}
