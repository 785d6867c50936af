//! Cells wider than an eighth of a tile, which many rays of all tiles cross.

use rustc_hash::FxHashMap;

use crate::blocks::visit_blocks;
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
    for needed in work.items(Stage::Frame) {
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
    for needed in work.items(Stage::Carve) {
        let carved = work.open_result(needed, item)?;
        let partial: Vec<u64> = carved.records(0)?;
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

/// The sums of some cells by their keys.
pub(crate) struct CellSums {
    /// In increasing order.
    keys: Vec<CellKey>,
    sums: Vec<u64>,
    width: usize,
}

impl CellSums {
    /// Those of the cells with these keys, giants included, from the tiles that they belong to.
    pub(crate) fn read(
        work: &Work,
        item: Item,
        mut keys: Vec<CellKey>,
    ) -> Result<Self, TilesError> {
        keys.sort_unstable();
        keys.dedup();
        let width = work.plan().sums();
        let giants = work.open_result(
            Item {
                stage: Stage::Giants,
                number: 0,
            },
            item,
        )?;
        let giant_keys: Vec<CellKey> = giants.records(0)?;
        let giant_sums: Vec<u64> = giants.records(1)?;
        let mut sums = vec![u64::MAX; keys.len() * width];
        let mut small = Vec::with_capacity(keys.len());
        for (number, key) in keys.iter().enumerate() {
            match giant_keys.binary_search(key) {
                Ok(giant) => sums[number * width..(number + 1) * width]
                    .copy_from_slice(&giant_sums[giant * width..(giant + 1) * width]),
                Err(_) => small.push(*key),
            }
        }
        let open = |tile| {
            let stage = Stage::Carve;
            work.open_result(
                Item {
                    stage,
                    number: tile,
                },
                item,
            )
        };
        // Cells are asked for in the order of `keys`.
        let mut number = 0;
        visit_blocks(&small, open, (1, 2), |reader, _, block, needed| {
            let found: Vec<CellKey> = reader.records(block.section)?;
            let values: Vec<u64> = reader.records(block.section + 1)?;
            for key in needed {
                let Ok(at) = found.binary_search(key) else {
                    return Err(TilesError::damaged(reader.path(), "a cell without sums"));
                };
                while keys.get(number).is_some_and(|other| other < key) {
                    number += 1;
                }
                let Some(own) = values.get(at * width..(at + 1) * width) else {
                    return Err(TilesError::damaged(reader.path(), "lists differ in length"));
                };
                sums[number * width..(number + 1) * width].copy_from_slice(own);
            }
            Ok(())
        })?;
        Ok(Self { keys, sums, width })
    }

    /// The number of a cell among these.
    pub(crate) fn number(&self, key: &CellKey) -> Option<u32> {
        self.keys.binary_search(key).ok().map(|at| at as u32)
    }

    /// The sums of a cell by its number; those of facets in the order of the opposite vertices.
    pub(crate) fn at(&self, number: u32) -> Option<&[u64]> {
        let first = number as usize * self.width;
        self.sums.get(first..first + self.width)
    }

    /// The sums of a cell; those of facets in the order of the opposite vertices.
    pub(crate) fn of(&self, key: &CellKey) -> Option<&[u64]> {
        self.at(self.number(key)?)
    }
}
