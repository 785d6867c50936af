//! The network of the cells that belong to a tile: what a minimum cut needs to know of them.

use linecarve_carving::Labels;
use linecarve_carving::internals::{FREE_SUM, FacetShape, OCCUPIED_SUM, cosines};
use linecarve_carving::{CellId, CutOptions};

use crate::blocks::{BLOCK, Block, all_blocks, visit_blocks, write_blocks};
use crate::error::TilesError;
use crate::file::{Reader, Writer};
use crate::giants::CellSums;
use crate::stage::{Counts, Item, Stage, counts};
use crate::tile::{CellKey, NO_VERTEX, TileCells, tile_of};
use crate::work::Work;

/// The cells of a tile with their arcs. Facets are numbered by the vertex of the key that they lack.
#[derive(Default)]
pub(crate) struct Cells {
    /// In increasing order.
    pub(crate) keys: Vec<CellKey>,
    /// Evidence for free minus that for occupied.
    pub(crate) terminals: Vec<i64>,
    /// For each facet the vertex across it; [`NO_VERTEX`] on the hull.
    pub(crate) apexes: Vec<[u64; 4]>,
    /// For each facet the cost of a surface there with this cell occupied.
    pub(crate) into: Vec<[i64; 4]>,
    /// For each facet the cost of a surface there with this cell free.
    pub(crate) out: Vec<[i64; 4]>,
    /// For each facet the cell across it, where that belongs to the same tile: `4 * cell + facet back`, or [`ELSEWHERE`].
    pub(crate) inside: Vec<[u32; 4]>,
}

/// A cell that belongs to another tile, or none.
pub(crate) const ELSEWHERE: u32 = u32::MAX;

/// Sections of a block: those of [`Cells`].
const SECTIONS: usize = 6;

impl Cells {
    /// The network of a tile.
    pub(crate) fn read(work: &Work, tile: usize, item: Item) -> Result<Self, TilesError> {
        let reader = Self::open(work, tile, item)?;
        let mut cells = Self::default();
        for block in all_blocks(&reader, 0, SECTIONS) {
            let mut more = Self::block(&reader, block)?;
            cells.keys.append(&mut more.keys);
            cells.terminals.append(&mut more.terminals);
            cells.apexes.append(&mut more.apexes);
            cells.into.append(&mut more.into);
            cells.out.append(&mut more.out);
            cells.inside.append(&mut more.inside);
        }
        Ok(cells)
    }

    fn open(work: &Work, tile: usize, item: Item) -> Result<Reader, TilesError> {
        let stage = Stage::Network;
        work.open_result(
            Item {
                stage,
                number: tile,
            },
            item,
        )
    }

    fn block(reader: &Reader, block: Block) -> Result<Self, TilesError> {
        let section = block.section;
        let cells = Self {
            keys: reader.records(section)?,
            terminals: reader.records(section + 1)?,
            apexes: reader.records(section + 2)?,
            into: reader.records(section + 3)?,
            out: reader.records(section + 4)?,
            inside: reader.records(section + 5)?,
        };
        let lengths = [
            cells.terminals.len(),
            cells.apexes.len(),
            cells.into.len(),
            cells.out.len(),
            cells.inside.len(),
        ];
        match lengths == [cells.keys.len(); 5] {
            true => Ok(cells),
            false => Err(TilesError::damaged(reader.path(), "lists differ in length")),
        }
    }

    /// Passes the blocks of a tile that are `wanted` to `take`, each with the number of its first cell; `wanted` gets a range of
    /// numbers that may end beyond the last one.
    pub(crate) fn visit(
        work: &Work,
        (tile, item): (usize, Item),
        wanted: impl Fn(std::ops::Range<usize>) -> bool,
        mut take: impl FnMut(usize, &Cells),
    ) -> Result<(), TilesError> {
        let reader = Self::open(work, tile, item)?;
        let blocks = all_blocks(&reader, 0, SECTIONS);
        let mut blocks = blocks.filter(|block| wanted(block.first..block.first + BLOCK));
        blocks.try_for_each(|block| {
            take(block.first, &Self::block(&reader, block)?);
            Ok(())
        })
    }

    /// Appends cells of any tiles; `keys` is sorted.
    pub(crate) fn append(
        &mut self,
        work: &Work,
        item: Item,
        keys: &[CellKey],
    ) -> Result<(), TilesError> {
        let open = |tile| Self::open(work, tile, item);
        visit_blocks(keys, open, (0, SECTIONS), |reader, _, block, needed| {
            let found = Self::block(reader, block)?;
            for key in needed {
                let Ok(cell) = found.keys.binary_search(key) else {
                    return Err(TilesError::damaged(reader.path(), "a cell without arcs"));
                };
                self.keys.push(*key);
                self.terminals.push(found.terminals[cell]);
                self.apexes.push(found.apexes[cell]);
                self.into.push(found.into[cell]);
                self.out.push(found.out[cell]);
                // The numbers are those of its own tile.
                self.inside.push([ELSEWHERE; 4]);
            }
            Ok(())
        })
    }

    /// Tile and number of cells there; `keys` is sorted, and cells that no tile has are left out.
    pub(crate) fn numbers(
        work: &Work,
        item: Item,
        keys: &[CellKey],
    ) -> Result<Vec<(CellKey, usize, usize)>, TilesError> {
        let open = |tile| Self::open(work, tile, item);
        let mut numbers = Vec::with_capacity(keys.len());
        visit_blocks(keys, open, (0, SECTIONS), |reader, tile, block, needed| {
            let found: Vec<CellKey> = reader.records(block.section)?;
            for key in needed {
                let at = found.binary_search(key).ok();
                numbers.extend(at.map(|at| (*key, tile, block.first + at)));
            }
            Ok(())
        })?;
        Ok(numbers)
    }

    /// The cell across a facet and its facet back; `None` on the hull.
    pub(crate) fn neighbor(&self, cell: usize, facet: usize) -> Option<(CellKey, usize)> {
        across(&self.keys[cell], facet, self.apexes[cell][facet])
    }
}

/// The cell across a facet and its facet back.
pub(crate) fn across(key: &CellKey, facet: usize, apex: u64) -> Option<(CellKey, usize)> {
    let mut other = *key;
    other[facet] = apex;
    other.sort_unstable();
    let back = other.iter().position(|&id| id == apex)?;
    (apex != NO_VERTEX).then_some((other, back))
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let cells = TileCells::framed(work, item)?;
    let options = match work.plan().carver.labels {
        Labels::Cut(options) => options,
        Labels::Votes(_) => CutOptions::default(),
    };
    let shape = FacetShape::new(&options);
    let tetrahedra = &cells.tetrahedra;
    let keyed = tetrahedra
        .cells()
        .filter_map(|cell| Some((cells.key(cell)?, cell)));
    let mut own: Vec<(CellKey, CellId)> = keyed
        .filter(|(key, _)| tile_of(key[0]) == item.number)
        .collect();
    own.sort_unstable();
    // For each cell around the number of its sums, and its cosines: each is asked for five times.
    let mut numbers = vec![u32::MAX; tetrahedra.cell_capacity()];
    let mut angles = vec![[0i16; 4]; tetrahedra.cell_capacity()];
    let mut needed: Vec<(CellKey, CellId)> = Vec::with_capacity(own.len() + own.len() / 8);
    for &(key, cell) in &own {
        for other in tetrahedra.neighbors(cell).into_iter().chain([cell]) {
            if std::mem::replace(&mut numbers[other.index()], 0) == u32::MAX {
                let key = if other == cell {
                    Some(key)
                } else {
                    cells.key(other)
                };
                needed.extend(key.map(|key| (key, other)));
            }
        }
    }
    needed.sort_unstable();
    for (number, &(_, cell)) in (0u32..).zip(&needed) {
        numbers[cell.index()] = number;
        angles[cell.index()] = cell_cosines(&cells, cell);
    }
    let needed = needed.into_iter().map(|(key, _)| key).collect();
    let sums = CellSums::read(work, item, needed)?;
    let missing = || TilesError::damaged(&work.path(item), "a cell without sums");
    let mut places_of = vec![ELSEWHERE; tetrahedra.cell_capacity()];
    for (number, (_, cell)) in (0u32..).zip(&own) {
        places_of[cell.index()] = number;
    }
    let mut network = Cells::default();
    for (key, cell) in own {
        let evidence = sums.at(numbers[cell.index()]).ok_or_else(missing)?;
        let places = cells.places(cell);
        let own_cosines = angles[cell.index()];
        let mut terminal = evidence[FREE_SUM] as i64 - evidence[OCCUPIED_SUM] as i64;
        let (mut apexes, mut into, mut out) = ([NO_VERTEX; 4], [0; 4], [0; 4]);
        let mut inside = [ELSEWHERE; 4];
        for k in 0..4 {
            let (other, back) = tetrahedra.neighbor(cell, places[k]);
            if tetrahedra.is_ghost(other) {
                terminal += evidence[k] as i64;
                continue;
            }
            apexes[k] = cells.id(tetrahedra.cell_vertices(other)[back]);
            let behind = sums.at(numbers[other.index()]).ok_or_else(missing)?;
            let facet = cells.places(other).iter().position(|&place| place == back);
            let facet = facet.unwrap_or(0);
            if places_of[other.index()] != ELSEWHERE {
                inside[k] = 4 * places_of[other.index()] + facet as u32;
            }
            let cost = shape.cost([own_cosines[places[k]], angles[other.index()][back]]);
            into[k] = evidence[k] as i64 + cost;
            out[k] = behind[facet] as i64 + cost;
        }
        network.keys.push(key);
        network.terminals.push(terminal);
        network.apexes.push(apexes);
        network.into.push(into);
        network.out.push(out);
        network.inside.push(inside);
    }
    let mut writer = work.create_result(item)?;
    write_blocks(&mut writer, &network.keys, |writer, block| {
        writer.section(&network.keys[block.clone()])?;
        writer.section(&network.terminals[block.clone()])?;
        writer.section(&network.apexes[block.clone()])?;
        writer.section(&network.into[block.clone()])?;
        writer.section(&network.out[block.clone()])?;
        writer.section(&network.inside[block])
    })?;
    Ok((writer, counts([("cells", network.keys.len())])))
}

/// The cosines of the facets of a finite cell by their places.
fn cell_cosines(cells: &TileCells, cell: CellId) -> [i16; 4] {
    let vertices = cells.tetrahedra.cell_vertices(cell);
    cosines(vertices.map(|vertex| cells.tetrahedra.coordinates(vertex)))
}
