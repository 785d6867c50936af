//! The network of the cells that belong to a tile: what a minimum cut needs to know of them.

use linecarve_carving::Labels;
use linecarve_carving::internals::{FREE_SUM, FacetShape, OCCUPIED_SUM, cosines};
use linecarve_carving::{CellId, CutOptions};

use crate::error::TilesError;
use crate::file::Writer;
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
}

impl Cells {
    /// The network of a tile.
    pub(crate) fn read(work: &Work, tile: usize, item: Item) -> Result<Self, TilesError> {
        let needed = Item {
            stage: Stage::Network,
            number: tile,
        };
        let reader = work.open_result(needed, item)?;
        let cells = Self {
            keys: reader.records(0)?,
            terminals: reader.records(1)?,
            apexes: reader.records(2)?,
            into: reader.records(3)?,
            out: reader.records(4)?,
        };
        let count = cells.keys.len();
        let lengths = [
            cells.terminals.len(),
            cells.apexes.len(),
            cells.into.len(),
            cells.out.len(),
        ];
        match lengths == [count; 4] {
            true => Ok(cells),
            false => Err(TilesError::damaged(reader.path(), "lists differ in length")),
        }
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
    let sums = CellSums::read(work, item)?;
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
    let missing = || TilesError::damaged(&work.path(item), "a cell without sums");
    let mut network = Cells::default();
    for (key, cell) in own {
        let evidence = sums.of(&key).ok_or_else(missing)?;
        let places = cells.places(cell);
        let own_cosines = cell_cosines(&cells, cell);
        let mut terminal = evidence[FREE_SUM] as i64 - evidence[OCCUPIED_SUM] as i64;
        let (mut apexes, mut into, mut out) = ([NO_VERTEX; 4], [0; 4], [0; 4]);
        for k in 0..4 {
            let (other, back) = tetrahedra.neighbor(cell, places[k]);
            let Some(other_key) = cells.key(other) else {
                terminal += evidence[k] as i64;
                continue;
            };
            apexes[k] = cells.id(tetrahedra.cell_vertices(other)[back]);
            let behind = sums.of(&other_key).ok_or_else(missing)?;
            let facet = other_key.iter().position(|&id| id == apexes[k]);
            let cost = shape.cost([own_cosines[places[k]], cell_cosines(&cells, other)[back]]);
            into[k] = evidence[k] as i64 + cost;
            out[k] = behind[facet.unwrap_or(0)] as i64 + cost;
        }
        network.keys.push(key);
        network.terminals.push(terminal);
        network.apexes.push(apexes);
        network.into.push(into);
        network.out.push(out);
    }
    let mut writer = work.create_result(item)?;
    writer.section(&network.keys)?;
    writer.section(&network.terminals)?;
    writer.section(&network.apexes)?;
    writer.section(&network.into)?;
    writer.section(&network.out)?;
    Ok((writer, counts([("cells", network.keys.len())])))
}

/// The cosines of the facets of a finite cell by their places.
fn cell_cosines(cells: &TileCells, cell: CellId) -> [i16; 4] {
    let vertices = cells.tetrahedra.cell_vertices(cell);
    cosines(vertices.map(|vertex| cells.tetrahedra.coordinates(vertex)))
}
