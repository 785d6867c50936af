//! The labels of a minimum cut that hold whatever the labels far away are.
//!
//! The cost of a cut is submodular, so the free cells within some region grow with the free cells outside. A tile solves its cells
//! and a halo around them twice: what is free although everything outside is occupied is free, and what is occupied although
//! everything outside is free is occupied. What differs is settled later (`settle`).

use linecarve_carving::internals::flow::{Network, NodeId};
use rustc_hash::FxHashMap;

use crate::error::TilesError;
use crate::file::Writer;
use crate::giants;
use crate::network::Cells;
use crate::stage::{Counts, Item, Stage, counts};
use crate::tile::CellKey;
use crate::work::Work;

pub(crate) const OCCUPIED: u8 = 0;
pub(crate) const FREE: u8 = 1;
pub(crate) const UNDECIDED: u8 = 2;

/// What is across a facet.
#[derive(Clone, Copy)]
enum Across {
    /// Nothing.
    Hull,
    /// A cell of the region, and its facet back.
    Cell(u32, u8),
    /// A cell that is not of the region.
    Outside,
}

/// Cells of one or more tiles that are solved together.
struct Region {
    /// Those of the tile, then those around.
    cells: Cells,
    /// Number of cells of the tile.
    own: usize,
    numbers: FxHashMap<CellKey, u32>,
}

impl Region {
    /// The cells of a tile and those up to `halo` facets away. Giants are reached, but not passed: they lead everywhere.
    fn around(work: &Work, item: Item) -> Result<Self, TilesError> {
        let giants = giants::list(work, item)?;
        let cells = Cells::read(work, item.number, item)?;
        let mut region = Self {
            numbers: (cells.keys.iter().copied()).zip(0..).collect(),
            own: cells.keys.len(),
            cells,
        };
        let mut ring = 0..region.own;
        for _ in 0..work.plan().halo {
            let mut reached = Vec::new();
            for cell in ring.clone() {
                let is_giant =
                    cell >= region.own && giants.number(&region.cells.keys[cell]).is_some();
                if is_giant {
                    continue;
                }
                let neighbors = (0..4).filter_map(|facet| region.cells.neighbor(cell, facet));
                let neighbors = neighbors.map(|(key, _)| key);
                reached.extend(neighbors.filter(|key| !region.numbers.contains_key(key)));
            }
            reached.sort_unstable();
            reached.dedup();
            let before = region.cells.keys.len();
            region.cells.append(work, item, &reached)?;
            ring = before..region.cells.keys.len();
            let keys = region.cells.keys[before..].iter().copied();
            region.numbers.extend(keys.zip(before as u32..));
        }
        Ok(region)
    }

    /// What is across each facet of each cell.
    fn across(&self) -> Vec<[Across; 4]> {
        let across = |cell: usize, facet: usize| match self.cells.neighbor(cell, facet) {
            None => Across::Hull,
            Some((key, back)) => match self.numbers.get(&key) {
                Some(&other) => Across::Cell(other, back as u8),
                None => Across::Outside,
            },
        };
        let cells = 0..self.cells.keys.len();
        cells
            .map(|cell| std::array::from_fn(|facet| across(cell, facet)))
            .collect()
    }

    /// Whether each cell of the tile is free when all cells outside are free, or all are occupied.
    fn solve(&self, across: &[[Across; 4]], is_outside_free: bool) -> Vec<bool> {
        let cells = &self.cells;
        let mut network = Network::new();
        network.grow(across.len());
        let mut terminals = cells.terminals.clone();
        for (cell, (across, terminal)) in across.iter().zip(&mut terminals).enumerate() {
            let number = NodeId(cell as u32);
            for (facet, across) in across.iter().enumerate() {
                match *across {
                    Across::Hull => (),
                    Across::Cell(other, back) => {
                        network.join(number, facet, NodeId(other), back.into());
                    }
                    Across::Outside if is_outside_free => *terminal += cells.into[cell][facet],
                    Across::Outside => *terminal -= cells.out[cell][facet],
                }
            }
        }
        for (cell, terminal) in terminals.into_iter().enumerate() {
            let number = NodeId(cell as u32);
            for facet in 0..4 {
                network.set_capacity(number, facet, cells.out[cell][facet]);
            }
            network.set_terminal(number, terminal);
        }
        network.maximize();
        let own = 0..self.own as u32;
        own.map(|number| network.is_source_side(NodeId(number)))
            .collect()
    }
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let region = Region::around(work, item)?;
    let own = region.own;
    let across = region.across();
    let least = region.solve(&across, false);
    let most = region.solve(&across, true);
    let label = |cell: usize| match (least[cell], most[cell]) {
        (true, _) => FREE,
        (_, false) => OCCUPIED,
        _ => UNDECIDED,
    };
    let labels: Vec<u8> = (0..own).map(label).collect();
    let undecided = labels.iter().filter(|&&label| label == UNDECIDED).count();
    let mut writer = work.create_result(item)?;
    writer.section(&labels)?;
    let counted = [
        ("cells", own),
        ("halo", region.cells.keys.len() - own),
        ("undecided", undecided),
    ];
    Ok((writer, counts(counted)))
}

/// The labels that a tile proved, in the order of its network.
pub(crate) fn proved(work: &Work, tile: usize, item: Item) -> Result<Vec<u8>, TilesError> {
    let needed = Item {
        stage: Stage::Label,
        number: tile,
    };
    work.open_result(needed, item)?.records(0)
}

/// The final labels of some cells.
pub(crate) struct Labels {
    /// Whether each is free, in increasing order.
    cells: Vec<(CellKey, bool)>,
}

impl Labels {
    pub(crate) fn read(
        work: &Work,
        item: Item,
        mut keys: Vec<CellKey>,
    ) -> Result<Self, TilesError> {
        keys.sort_unstable();
        keys.dedup();
        let needed = Item {
            stage: Stage::Settle,
            number: 0,
        };
        let settled = work.open_result(needed, item)?;
        let settled: (Vec<CellKey>, Vec<u8>) = (settled.records(0)?, settled.records(1)?);
        let mut of_tile: (usize, Vec<u8>) = (usize::MAX, Vec::new());
        let mut cells = Vec::with_capacity(keys.len());
        for (key, tile, number) in Cells::numbers(work, item, &keys)? {
            if of_tile.0 != tile {
                of_tile = (tile, proved(work, tile, item)?);
            }
            let label = match of_tile.1.get(number) {
                Some(&UNDECIDED) => {
                    let at = settled.0.binary_search(&key).ok();
                    at.and_then(|at| settled.1.get(at))
                }
                label => label,
            };
            cells.extend(label.map(|&label| (key, label == FREE)));
        }
        Ok(Self { cells })
    }

    /// Whether a cell is free.
    pub(crate) fn is_free(&self, key: &CellKey) -> Option<bool> {
        let at = self.cells.binary_search_by(|(own, _)| own.cmp(key)).ok()?;
        Some(self.cells[at].1)
    }
}
