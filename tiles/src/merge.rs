//! One mesh from the triangles of all tiles.

use linecarve_carving::IndexedMesh;
use linecarve_carving::internals::{NO_NEIGHBOR, RankedSurface, RankedTriangle, assemble};
use nalgebra::Point3;

use crate::error::TilesError;
use crate::file::{Reader, Writer};
use crate::split::by_position;
use crate::stage::{Counts, Item, Stage, counts};
use crate::tile::{NO_VERTEX, listed, local_of, tile_of};
use crate::work::Work;

/// In place of the rank of a vertex that is not on the surface.
const NO_RANK: u32 = u32::MAX;

/// Ranks of the vertices of the surface by tile and number.
struct Ranks {
    of_tile: Vec<Vec<u32>>,
    positions: Vec<[f64; 3]>,
}

impl Ranks {
    /// Merges the vertices of all tiles, which are sorted by position in each.
    fn merge(work: &Work, readers: &[Reader]) -> Result<Self, TilesError> {
        let count = readers.iter().map(|reader| reader.length(2) / 8).sum();
        let mut vertices = Vec::with_capacity(count);
        for reader in readers {
            vertices.extend(listed(reader, 2)?);
        }
        // The sort finds the sorted runs of the tiles and merges them.
        vertices.sort_by(|(_, a), (_, b)| by_position(a, b));
        let tiles = work.plan().tiles.iter();
        let mut of_tile: Vec<Vec<u32>> = tiles.map(|tile| vec![NO_RANK; tile.points]).collect();
        for (rank, (id, _)) in (0u32..).zip(&vertices) {
            let slot = (of_tile.get_mut(tile_of(*id))).and_then(|tile| tile.get_mut(local_of(*id)));
            match slot {
                Some(slot) => *slot = rank,
                None => return Err(TilesError::damaged(work.folder(), "an unknown vertex")),
            }
        }
        Ok(Self {
            of_tile,
            positions: vertices.into_iter().map(|(_, position)| position).collect(),
        })
    }

    fn of(&self, id: u64) -> u32 {
        if id == NO_VERTEX {
            return NO_RANK;
        }
        let tile = self.of_tile.get(tile_of(id));
        let rank = tile.and_then(|tile| tile.get(local_of(id)));
        rank.copied().unwrap_or(NO_RANK)
    }
}

/// A triangle by ranks, the smallest first, with the apex of the neighbour across each edge.
type Entry = (RankedTriangle, [u32; 3]);

fn rotated((corners, apexes): ([u32; 3], [u32; 3])) -> Entry {
    let first = (0..3).min_by_key(|&k| corners[k]).unwrap_or(0);
    let rotate = |list: [u32; 3]| std::array::from_fn(|k| list[(first + k) % 3]);
    (rotate(corners), rotate(apexes))
}

/// The triangles of all tiles with the neighbours across their edges.
fn ranked(work: &Work, readers: &[Reader]) -> Result<RankedSurface, TilesError> {
    let ranks = Ranks::merge(work, readers)?;
    // A triangle has 40 bytes in a file.
    let count = readers.iter().map(|reader| reader.length(0) / 40).sum();
    let mut entries: Vec<Entry> = Vec::with_capacity(count);
    for reader in readers {
        let triangles: Vec<[u64; 5]> = reader.records(0)?;
        entries.extend(triangles.into_iter().map(|[a, b, c, ab, ca]| {
            let apexes = [ranks.of(ab), NO_RANK, ranks.of(ca)];
            rotated(([a, b, c].map(|id| ranks.of(id)), apexes))
        }));
    }
    if entries.iter().any(|(key, _)| key.contains(&NO_RANK)) {
        return Err(TilesError::damaged(
            work.folder(),
            "a triangle without its vertices",
        ));
    }
    entries.sort_unstable();
    let find = |entries: &[Entry], triangle: [u32; 3]| {
        let (key, _) = rotated((triangle, [0; 3]));
        entries.binary_search_by_key(&key, |(key, _)| *key).ok()
    };
    for reader in readers {
        let edges: Vec<[u64; 4]> = reader.records(1)?;
        for [a, b, c, apex] in edges {
            let triangle = [a, b, c].map(|id| ranks.of(id));
            let Some(index) = find(&entries, triangle) else {
                return Err(TilesError::damaged(reader.path(), "an unknown triangle"));
            };
            let (key, apexes) = &mut entries[index];
            let edge = key.iter().position(|&rank| rank == triangle[1]);
            apexes[edge.unwrap_or(0)] = ranks.of(apex);
        }
    }
    let neighbors = entries.iter().map(|(key, apexes)| {
        std::array::from_fn(|k| {
            let neighbor = [key[(k + 1) % 3], key[k], apexes[k]];
            // The neighbour may have been left out for a long edge.
            let found = (apexes[k] != NO_RANK)
                .then(|| find(&entries, neighbor))
                .flatten();
            found.map_or(NO_NEIGHBOR, |found| found as u32)
        })
    });
    let neighbors = neighbors.collect();
    Ok(RankedSurface {
        neighbors,
        triangles: entries.into_iter().map(|(key, _)| key).collect(),
        positions: ranks.positions,
    })
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let readers = Stage::Surface.items(work);
    let readers = readers.map(|needed| work.open_result(needed, item));
    let readers: Vec<Reader> = readers.collect::<Result<_, _>>()?;
    let surface = ranked(work, &readers)?;
    let is_wanted = vec![true; surface.triangles.len()];
    let (mesh, _) = assemble(&surface, &is_wanted, &work.plan().export);
    drop((surface, is_wanted));
    let mut writer = work.create_result(item)?;
    let vertices = mesh.vertices.iter().map(|&vertex| vertex.into());
    writer.section(&vertices.collect::<Vec<[f64; 3]>>())?;
    writer.section(&mesh.triangles)?;
    let counted = [
        ("vertices", mesh.vertices.len()),
        ("triangles", mesh.triangles.len()),
    ];
    Ok((writer, counts(counted)))
}

/// The mesh of a plan whose stages are all done.
///
/// # Errors
/// When it is not there, or damaged.
pub fn merged_mesh(work: &Work) -> Result<IndexedMesh, TilesError> {
    let item = Item {
        stage: Stage::Merge,
        number: 0,
    };
    let reader = work.open_result(item, item)?;
    let vertices: Vec<[f64; 3]> = reader.records(0)?;
    Ok(IndexedMesh {
        vertices: vertices.into_iter().map(Point3::from).collect(),
        triangles: reader.records(1)?,
    })
}
