//! Cells wider than an eighth of a tile, which many rays of all tiles cross.

use rustc_hash::FxHashMap;

use crate::error::TilesError;
use crate::file::Writer;
use crate::stage::{Counts, Item, Stage, counts};
use crate::tile::{CellKey, Vertex};
use crate::work::Work;

/// The giants of all tiles.
pub(crate) struct Giants {
    /// In increasing order.
    pub(crate) keys: Vec<CellKey>,
    /// Their vertices: with these a tile has all giants among its cells.
    pub(crate) vertices: Vec<Vertex>,
}

impl Giants {
    /// The number of a giant.
    pub(crate) fn number(&self, key: &CellKey) -> Option<usize> {
        self.keys.binary_search(key).ok()
    }
}

/// Reads the giants that `frame` found.
pub(crate) fn list(work: &Work, item: Item) -> Result<Giants, TilesError> {
    let mut keys: Vec<CellKey> = Vec::new();
    let mut vertices: FxHashMap<u64, [f64; 3]> = FxHashMap::default();
    for needed in Stage::Frame.items(work) {
        let frame = work.open_result(needed, item)?;
        let own: Vec<CellKey> = frame.records(2)?;
        let positions: Vec<[[f64; 3]; 4]> = frame.records(3)?;
        for (key, positions) in own.iter().zip(&positions) {
            vertices.extend(key.iter().copied().zip(*positions));
        }
        keys.extend(own);
    }
    keys.sort_unstable();
    let mut vertices: Vec<Vertex> = vertices.into_iter().collect();
    vertices.sort_unstable_by_key(|(id, _)| *id);
    Ok(Giants { keys, vertices })
}

/// Adds up what the rays of all tiles say.
pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let giants = list(work, item)?;
    let width = work.plan().sums();
    let mut sums = vec![0u64; giants.keys.len() * width];
    for needed in Stage::Carve.items(work) {
        let carved = work.open_result(needed, item)?;
        let partial: Vec<u64> = carved.records(2)?;
        for entry in partial.chunks_exact(1 + width) {
            let first = entry[0] as usize * width;
            let Some(own) = sums.get_mut(first..first + width) else {
                return Err(TilesError::damaged(carved.path(), "an unknown giant"));
            };
            for (sum, more) in own.iter_mut().zip(&entry[1..]) {
                *sum += more;
            }
        }
    }
    let mut writer = work.create_result(item)?;
    writer.section(&giants.keys)?;
    writer.section(&sums)?;
    Ok((writer, counts([("giants", giants.keys.len())])))
}

/// The sums of cells by their keys, from one or more results.
pub(crate) struct CellSums {
    tables: Vec<(Vec<CellKey>, Vec<u64>)>,
    width: usize,
}

impl CellSums {
    /// Those of a tile, giants included.
    pub(crate) fn read(work: &Work, item: Item) -> Result<Self, TilesError> {
        let carve = Item {
            stage: Stage::Carve,
            number: item.number,
        };
        let giants = Item {
            stage: Stage::Giants,
            number: 0,
        };
        let table = |needed| {
            let reader = work.open_result(needed, item)?;
            Ok((reader.records(0)?, reader.records(1)?))
        };
        Ok(Self {
            tables: vec![table(carve)?, table(giants)?],
            width: work.plan().sums(),
        })
    }

    /// The sums of a cell; those of facets in the order of the opposite vertices.
    pub(crate) fn of(&self, key: &CellKey) -> Option<&[u64]> {
        self.tables.iter().find_map(|(keys, sums)| {
            let at = keys.binary_search(key).ok()?;
            sums.get(at * self.width..(at + 1) * self.width)
        })
    }
}
