//! The labels of a minimum cut that hold whatever the labels far away are.
//!
//! The cost of a cut is submodular, so the free cells within some region grow with the free cells outside. A tile solves its cells
//! and a halo around them twice: what is free although everything outside is occupied is free, and what is occupied although
//! everything outside is free is occupied. What differs is settled later (`settle`).

use std::collections::hash_map::Entry;

use linecarve_carving::internals::flow::{Network, NodeId};
use rustc_hash::FxHashMap;

use crate::error::TilesError;
use crate::file::Writer;
use crate::giants;
use crate::network::Cells;
use crate::stage::{Counts, Item, Stage, counts};
use crate::tile::{CellKey, tile_of};
use crate::work::Work;

pub(crate) const OCCUPIED: u8 = 0;
pub(crate) const FREE: u8 = 1;
pub(crate) const UNDECIDED: u8 = 2;

/// Cells of one or more tiles that are solved together.
struct Region {
    networks: FxHashMap<usize, Cells>,
    /// Tile of each cell and its number there.
    cells: Vec<(usize, usize)>,
    numbers: FxHashMap<CellKey, u32>,
}

impl Region {
    /// The cells of a tile and those up to `halo` facets away. Giants are reached, but not passed: they lead everywhere.
    fn around(work: &Work, item: Item) -> Result<Self, TilesError> {
        let giants = giants::list(work, item)?;
        let own = Cells::read(work, item.number, item)?;
        let mut region = Self {
            numbers: (own.keys.iter().copied()).zip(0..).collect(),
            cells: (0..own.keys.len())
                .map(|cell| (item.number, cell))
                .collect(),
            networks: FxHashMap::default(),
        };
        region.networks.insert(item.number, own);
        let mut ring = 0..region.cells.len();
        for _ in 0..work.plan().halo {
            let mut reached = Vec::new();
            for &(tile, cell) in &region.cells[ring.clone()] {
                let network = &region.networks[&tile];
                let is_giant = giants.number(&network.keys[cell]).is_some();
                if is_giant && tile != item.number {
                    continue;
                }
                let neighbors = (0..4).filter_map(|facet| network.neighbor(cell, facet));
                reached.extend(neighbors.map(|(key, _)| key));
            }
            reached.retain(|key| !region.numbers.contains_key(key));
            reached.sort_unstable();
            reached.dedup();
            let before = region.cells.len();
            for key in reached {
                region.take(work, item, key)?;
            }
            ring = before..region.cells.len();
        }
        Ok(region)
    }

    fn take(&mut self, work: &Work, item: Item, key: CellKey) -> Result<(), TilesError> {
        let tile = tile_of(key[0]);
        if let Entry::Vacant(entry) = self.networks.entry(tile) {
            entry.insert(Cells::read(work, tile, item)?);
        }
        let Ok(cell) = self.networks[&tile].keys.binary_search(&key) else {
            return Err(TilesError::damaged(&work.path(item), "a cell without arcs"));
        };
        self.numbers.insert(key, self.cells.len() as u32);
        self.cells.push((tile, cell));
        Ok(())
    }

    /// Whether each cell is free when all cells outside are free, or all are occupied.
    fn solve(&self, is_outside_free: bool) -> Vec<bool> {
        let mut network = Network::new();
        network.grow(self.cells.len());
        let mut terminals = Vec::with_capacity(self.cells.len());
        for (number, &(tile, cell)) in (0u32..).zip(&self.cells) {
            let cells = &self.networks[&tile];
            let mut terminal = cells.terminals[cell];
            for facet in 0..4 {
                let Some((other, back)) = cells.neighbor(cell, facet) else {
                    continue;
                };
                match self.numbers.get(&other) {
                    Some(&other) => network.join(NodeId(number), facet, NodeId(other), back),
                    None if is_outside_free => terminal += cells.into[cell][facet],
                    None => terminal -= cells.out[cell][facet],
                }
            }
            terminals.push(terminal);
        }
        for (number, &(tile, cell)) in (0u32..).zip(&self.cells) {
            for facet in 0..4 {
                let capacity = self.networks[&tile].out[cell][facet];
                network.set_capacity(NodeId(number), facet, capacity);
            }
            network.set_terminal(NodeId(number), terminals[number as usize]);
        }
        network.maximize();
        let numbers = 0..self.cells.len() as u32;
        numbers
            .map(|number| network.is_source_side(NodeId(number)))
            .collect()
    }
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let region = Region::around(work, item)?;
    let own = region.networks[&item.number].keys.len();
    let least = region.solve(false);
    let most = region.solve(true);
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
        ("halo", region.cells.len() - own),
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

/// The final labels of the cells of some tiles.
pub(crate) struct Labels {
    tiles: FxHashMap<usize, (Vec<CellKey>, Vec<u8>)>,
    settled: (Vec<CellKey>, Vec<u8>),
}

impl Labels {
    /// Those of the tiles to which some cells belong.
    pub(crate) fn read(
        work: &Work,
        item: Item,
        keys: impl Iterator<Item = CellKey>,
    ) -> Result<Self, TilesError> {
        let mut tiles: Vec<usize> = keys.map(|key| tile_of(key[0])).collect();
        tiles.sort_unstable();
        tiles.dedup();
        let needed = Item {
            stage: Stage::Settle,
            number: 0,
        };
        let settled = work.open_result(needed, item)?;
        let mut labels = Self {
            tiles: FxHashMap::default(),
            settled: (settled.records(0)?, settled.records(1)?),
        };
        for tile in tiles {
            let network = Item {
                stage: Stage::Network,
                number: tile,
            };
            let keys = work.open_result(network, item)?.records(0)?;
            labels.tiles.insert(tile, (keys, proved(work, tile, item)?));
        }
        Ok(labels)
    }

    /// Whether a cell is free.
    pub(crate) fn is_free(&self, key: &CellKey) -> Option<bool> {
        let look_up = |(keys, labels): &(Vec<CellKey>, Vec<u8>)| {
            let at = keys.binary_search(key).ok()?;
            labels.get(at).copied()
        };
        let proved = look_up(self.tiles.get(&tile_of(key[0]))?)?;
        match proved {
            UNDECIDED => look_up(&self.settled).map(|label| label == FREE),
            label => Some(label == FREE),
        }
    }
}
