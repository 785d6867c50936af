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
use crate::network::{Cells, ELSEWHERE};
use crate::stage::{Counts, Item, Stage, counts};
use crate::tile::{CellKey, tile_of};
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
    Cell(u32, usize),
    /// A cell that is not of the region.
    Outside(CellKey),
}

/// Cells of one or more tiles that are solved together.
struct Region {
    tile: usize,
    /// Those of the tile, then those around.
    cells: Cells,
    /// Number of cells of the tile.
    own: usize,
    /// Numbers of the cells around.
    numbers: FxHashMap<CellKey, u32>,
}

impl Region {
    /// The cells of a tile and those up to `halo` facets away. Giants are reached, but not passed: they lead everywhere.
    fn around(work: &Work, item: Item) -> Result<Self, TilesError> {
        let giants = giants::list(work, item)?;
        let cells = Cells::read(work, item.number, item)?;
        let mut region = Self {
            tile: item.number,
            numbers: FxHashMap::default(),
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
                for facet in 0..4 {
                    if let Across::Outside(key) = region.across(cell, facet) {
                        reached.push(key);
                    }
                }
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

    /// What is across a facet.
    fn across(&self, cell: usize, facet: usize) -> Across {
        let inside = self.cells.inside[cell][facet];
        if inside != ELSEWHERE {
            return Across::Cell(inside / 4, inside as usize % 4);
        }
        let Some((key, back)) = self.cells.neighbor(cell, facet) else {
            return Across::Hull;
        };
        let is_own = cell >= self.own && tile_of(key[0]) == self.tile;
        let number = match is_own {
            true => {
                let own = self.cells.keys[..self.own].binary_search(&key);
                own.ok().map(|number| number as u32)
            }
            false => self.numbers.get(&key).copied(),
        };
        number.map_or(Across::Outside(key), |number| Across::Cell(number, back))
    }

    /// Whether each cell of the tile is free when all cells outside are occupied, and when all are free.
    ///
    /// The second flow begins with the first one: only the supplies at the rim are larger.
    fn solve(&self) -> [Vec<bool>; 2] {
        let cells = &self.cells;
        let mut network = Network::new();
        network.grow(cells.keys.len());
        let mut terminals = cells.terminals.clone();
        let mut rim: Vec<(u32, i64)> = Vec::new();
        for (cell, terminal) in terminals.iter_mut().enumerate() {
            let number = NodeId(cell as u32);
            let mut occupied = *terminal;
            for facet in 0..4 {
                match self.across(cell, facet) {
                    Across::Hull => (),
                    // Once for both sides.
                    Across::Cell(other, back) => {
                        if number.0 < other {
                            network.join(number, facet, NodeId(other), back);
                        }
                    }
                    Across::Outside(_) => {
                        *terminal += cells.into[cell][facet];
                        occupied -= cells.out[cell][facet];
                    }
                }
            }
            if occupied != *terminal {
                rim.push((number.0, *terminal));
                *terminal = occupied;
            }
        }
        for (cell, terminal) in terminals.into_iter().enumerate() {
            let number = NodeId(cell as u32);
            for facet in 0..4 {
                network.set_capacity(number, facet, cells.out[cell][facet]);
            }
            network.set_terminal(number, terminal);
        }
        let solved = |network: &mut Network| -> Vec<bool> {
            network.maximize();
            let own = 0..self.own as u32;
            own.map(|number| network.is_source_side(NodeId(number)))
                .collect()
        };
        let occupied_outside = solved(&mut network);
        for (cell, terminal) in rim {
            network.set_terminal(NodeId(cell), terminal);
        }
        [occupied_outside, solved(&mut network)]
    }
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let region = Region::around(work, item)?;
    let own = region.own;
    let [least, most] = region.solve();
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
        let mut of_tile: (usize, Vec<u8>) = (usize::MAX, Vec::new());
        let mut cells = Vec::with_capacity(keys.len());
        for (key, tile, number) in Cells::numbers(work, item, &keys)? {
            if of_tile.0 != tile {
                let mut labels = proved(work, tile, item)?;
                let mut settled_of_tile = settled.records::<u8>(tile)?.into_iter();
                for label in labels.iter_mut().filter(|label| **label == UNDECIDED) {
                    let missing = || TilesError::damaged(settled.path(), "a label is missing");
                    *label = settled_of_tile.next().ok_or_else(missing)?;
                }
                of_tile = (tile, labels);
            }
            let label = of_tile.1.get(number);
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
