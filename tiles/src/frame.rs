//! The points of other tiles that make the cells around a tile's own points those of the whole scene.
//!
//! A cell of any subset of the points is one of the whole when no other point is in conflict with it. A tile begins with its own
//! points and a sample of all, and takes in, for each cell around its own points and each across a facet of these, the point
//! deepest in conflict, until there is none. All cells around a point fill a neighbourhood of it, so they are then its star in the
//! whole. Which points were taken in on the way has no influence on these cells.
//!
//! Thousands of points on one plane or sphere are in doubt for each cell there, and each is tested exactly. When such tests cost more than
//! to take in all points, the tile takes them all.

use std::collections::BinaryHeap;

use linecarve_carving::{CellId, Changes};
use rustc_hash::{FxHashMap, FxHashSet};

use crate::bounds::{Bounds, BoxTree, Node};
use crate::conflict::{Quadratic, is_in_conflict};
use crate::error::TilesError;
use crate::file::{Kind, Reader, Writer};
use crate::plan::Plan;
use crate::stage::{Counts, Item, counts};
use crate::tile::{CellKey, TileCells, Vertex, global, listed, own_vertices, tile_of};
use crate::work::Work;

/// Exact tests for each point of the whole, from which all points are taken in.
const TESTS_PER_POINT: u64 = 8;

/// Largest number of points of which a tile takes in all.
const MOST_TAKEN: usize = 1 << 16;

/// Exact tests after which a tile with more points gives up: about half an hour.
const MOST_TESTS: u64 = 1 << 30;

/// The points of all tiles but one, read block by block where they are needed.
struct OtherPoints {
    readers: Vec<Reader>,
    /// Tile, block and first vertex of each leaf of the tree.
    blocks: Vec<(usize, usize, usize)>,
    tree: BoxTree,
    read: FxHashMap<usize, Vec<[f64; 3]>>,
    /// Number of points.
    count: usize,
    /// Number of exact tests so far that found no conflict.
    vain_tests: u64,
    queue: BinaryHeap<Waiting>,
}

/// A part of the tree with the bound of its depth.
struct Waiting(f64, Node);

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}
impl Eq for Waiting {}
impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

impl OtherPoints {
    fn open(work: &Work, tile: usize) -> Result<Self, TilesError> {
        let mut others = Self {
            readers: Vec::new(),
            blocks: Vec::new(),
            tree: BoxTree::default(),
            read: FxHashMap::default(),
            count: 0,
            vain_tests: 0,
            queue: BinaryHeap::new(),
        };
        let mut boxes: Vec<Bounds> = Vec::new();
        for other in 0..work.plan().tiles.len() {
            let reader = work.open_tile("points", other, Kind::Points)?;
            let own: Vec<Bounds> = reader.records(0)?;
            let mut first = 0;
            for (block, bounds) in own.into_iter().enumerate() {
                if other != tile {
                    others.blocks.push((other, block, first));
                    boxes.push(bounds);
                }
                first += reader.length(block + 1) / 24;
            }
            others.count += if other == tile { 0 } else { first };
            others.readers.push(reader);
        }
        others.tree = BoxTree::new(&boxes);
        Ok(others)
    }

    /// The point that is deepest in conflict with a cell, among those that are not `known`.
    fn deepest(
        &mut self,
        cells: &TileCells,
        cell: CellId,
        known: &FxHashSet<u64>,
    ) -> Result<Option<Vertex>, TilesError> {
        let tetrahedra = &cells.tetrahedra;
        let quadratic = Quadratic::of(tetrahedra, cell);
        let mut found: Option<(f64, Vertex)> = None;
        let most = |tree: &BoxTree, node: Node| Waiting(quadratic.most(tree.bounds(node)), node);
        self.queue.clear();
        let root = self.tree.root().map(|root| most(&self.tree, root));
        self.queue.extend(root.filter(|root| root.0 >= 0.0));
        while let Some(Waiting(bound, node)) = self.queue.pop() {
            if found.is_some_and(|(depth, _)| bound <= depth) {
                break;
            }
            let Some(leaf) = node.leaf() else {
                let children = self
                    .tree
                    .children(node)
                    .map(|child| most(&self.tree, child));
                let reachable = children.into_iter().filter(|child| child.0 >= 0.0);
                self.queue.extend(reachable);
                continue;
            };
            let (tile, block, first) = self.blocks[leaf];
            if !self.read.contains_key(&leaf) {
                self.read
                    .insert(leaf, self.readers[tile].records(block + 1)?);
            }
            for (index, point) in self.read[&leaf].iter().enumerate() {
                let (value, error) = quadratic.at(point);
                let is_deeper = found.is_none_or(|(depth, _)| value > depth);
                let id = global(tile, first + index);
                if value >= -error && is_deeper && !known.contains(&id) {
                    if is_in_conflict(tetrahedra, cell, point) {
                        found = Some((value, (id, *point)));
                    } else {
                        self.vain_tests += 1;
                    }
                }
            }
        }
        Ok(found.map(|(_, vertex)| vertex))
    }

    /// Whether so many points are in doubt that taking in all is quicker.
    ///
    /// # Errors
    /// When they are too many for either.
    fn are_better_taken(&self, own: usize) -> Result<bool, TilesError> {
        if self.count <= MOST_TAKEN {
            return Ok(self.vain_tests > TESTS_PER_POINT * (own + self.count) as u64);
        }
        match self.vain_tests > MOST_TESTS {
            true => Err(TilesError::Cospherical { points: self.count }),
            false => Ok(false),
        }
    }

    /// All points that are not `known`.
    fn all_but(&mut self, known: &FxHashSet<u64>) -> Result<Vec<Vertex>, TilesError> {
        let mut all = Vec::new();
        for &(tile, block, first) in &self.blocks {
            let points: Vec<[f64; 3]> = self.readers[tile].records(block + 1)?;
            let ids = (first..).map(|index| global(tile, index));
            all.extend(ids.zip(points).filter(|(id, _)| !known.contains(id)));
        }
        Ok(all)
    }
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let tile = item.number;
    let own = own_vertices(work, tile)?;
    let sample = work.open_plan_file("sample", Kind::Sample)?;
    let foreign = listed(&sample, 0)?;
    let foreign = foreign.into_iter().filter(|(id, _)| tile_of(*id) != tile);
    let mut pulled: Vec<Vertex> = foreign.collect();
    let mut giants = Vec::new();
    let mut rounds = 0;
    if own.is_empty() {
        pulled.clear();
    } else {
        let mut others = OtherPoints::open(work, tile)?;
        let begin: Vec<Vertex> = own.iter().chain(&pulled).copied().collect();
        let wrong = |error: linecarve_carving::BatchError| {
            TilesError::damaged(sample.path(), error.to_string())
        };
        let mut cells = TileCells::new(tile, &begin).map_err(wrong)?;
        let mut known: FxHashSet<u64> = pulled.iter().map(|(id, _)| *id).collect();
        let mut is_certified: Vec<bool> = Vec::new();
        let mut candidates: Vec<CellId> = cells.tetrahedra.cells().collect();
        'rounds: loop {
            rounds += 1;
            is_certified.resize(cells.tetrahedra.cell_capacity(), false);
            let mut missing: Vec<Vertex> = Vec::new();
            let mut uncertain: Vec<CellId> = Vec::new();
            for &cell in &candidates {
                if is_certified[cell.index()] || !cells.is_near(cell) {
                    continue;
                }
                match others.deepest(&cells, cell, &known)? {
                    Some(vertex) => {
                        missing.push(vertex);
                        uncertain.push(cell);
                    }
                    None => is_certified[cell.index()] = true,
                }
                if others.are_better_taken(own.len())? {
                    let mut all = others.all_but(&known)?;
                    cells.insert(&all, &mut Changes::new()).map_err(wrong)?;
                    pulled.append(&mut all);
                    break 'rounds;
                }
            }
            if missing.is_empty() {
                break;
            }
            missing.sort_unstable_by_key(|(id, _)| *id);
            missing.dedup_by_key(|(id, _)| *id);
            let mut changes = Changes::new();
            cells.insert(&missing, &mut changes).map_err(wrong)?;
            known.extend(missing.iter().map(|(id, _)| *id));
            pulled.append(&mut missing);
            for cell in changes.destroyed {
                is_certified[cell.index()] = false;
            }
            let tetrahedra = &cells.tetrahedra;
            is_certified.resize(tetrahedra.cell_capacity(), false);
            candidates = uncertain;
            candidates.retain(|&cell| tetrahedra.is_cell(cell));
            for &cell in &changes.created {
                is_certified[cell.index()] = false;
                candidates.push(cell);
                candidates.extend(tetrahedra.neighbors(cell));
            }
            candidates.sort_unstable();
            candidates.dedup();
        }
        giants = list_giants(&cells, tile, work.plan());
    }
    let mut writer = work.create_result(item)?;
    writer.section(&pulled.iter().map(|(id, _)| *id).collect::<Vec<u64>>())?;
    writer.section(&pulled.iter().map(|(_, p)| *p).collect::<Vec<[f64; 3]>>())?;
    writer.section(&giants.iter().map(|(key, _)| *key).collect::<Vec<_>>())?;
    writer.section(&giants.iter().map(|(_, p)| *p).collect::<Vec<_>>())?;
    let counted = [
        ("vertices", own.len()),
        ("pulled", pulled.len()),
        ("giants", giants.len()),
        ("rounds", rounds),
    ];
    Ok((writer, counts(counted)))
}

/// The giant cells that belong to the tile, in order, with the positions of their vertices.
fn list_giants(cells: &TileCells, tile: usize, plan: &Plan) -> Vec<(CellKey, [[f64; 3]; 4])> {
    let tetrahedra = &cells.tetrahedra;
    let all = tetrahedra.cells().filter(|&cell| cells.is_star(cell));
    let large = all.filter(|&cell| plan.is_giant(cells.extent(cell)));
    let mut giants: Vec<(CellKey, [[f64; 3]; 4])> = large
        .filter_map(|cell| {
            let vertices = tetrahedra.cell_vertices(cell);
            let position = |place: usize| *tetrahedra.coordinates(vertices[place]);
            Some((cells.key(cell)?, cells.places(cell).map(position)))
        })
        .filter(|(key, _)| tile_of(key[0]) == tile)
        .collect();
    giants.sort_unstable_by_key(|(key, _)| *key);
    giants
}

#[cfg(test)]
mod tests;
