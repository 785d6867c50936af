//! The labels that no tile could prove, found together with all others fixed.
//!
//! With the proved cells fixed, the smallest minimum cut of the others is the smallest minimum cut of all, restricted to them.

use linecarve_carving::internals::flow::{Network, NodeId};
use rustc_hash::FxHashMap;

use crate::error::TilesError;
use crate::file::Writer;
use crate::label::{FREE, OCCUPIED, UNDECIDED, proved};
use crate::network::{Cells, across};
use crate::stage::{Counts, Item, counts};
use crate::tile::CellKey;
use crate::work::Work;

/// A cell that is undecided.
struct Cell {
    key: CellKey,
    terminal: i64,
    apexes: [u64; 4],
    into: [i64; 4],
    out: [i64; 4],
}

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let tiles = 0..work.plan().tiles.len();
    let mut cells: Vec<Cell> = Vec::new();
    for tile in tiles {
        let labels = proved(work, tile, item)?;
        Cells::visit(work, tile, item, |first, network| {
            let labels = labels.get(first..).unwrap_or_default();
            let undecided = (0..network.keys.len()).zip(labels);
            let undecided = undecided.filter(|(_, label)| **label == UNDECIDED);
            cells.extend(undecided.map(|(cell, _)| Cell {
                key: network.keys[cell],
                terminal: network.terminals[cell],
                apexes: network.apexes[cell],
                into: network.into[cell],
                out: network.out[cell],
            }));
        })?;
    }
    cells.sort_unstable_by_key(|cell| cell.key);
    let numbers: FxHashMap<CellKey, u32> = cells.iter().map(|cell| cell.key).zip(0..).collect();
    let around = || {
        let facets = cells
            .iter()
            .flat_map(|cell| (0..4).map(move |facet| (cell, facet)));
        facets.filter_map(|(cell, facet)| across(&cell.key, facet, cell.apexes[facet]))
    };
    // What is proved of the cells around.
    let mut beyond: Vec<CellKey> = around()
        .map(|(key, _)| key)
        .filter(|key| !numbers.contains_key(key))
        .collect();
    beyond.sort_unstable();
    beyond.dedup();
    let mut fixed: FxHashMap<CellKey, bool> = FxHashMap::default();
    let mut of_tile: (usize, Vec<u8>) = (usize::MAX, Vec::new());
    for (key, tile, number) in Cells::numbers(work, item, &beyond)? {
        if of_tile.0 != tile {
            of_tile = (tile, proved(work, tile, item)?);
        }
        fixed.insert(key, of_tile.1.get(number) == Some(&FREE));
    }
    let labels = solve(&cells, &numbers, &fixed);
    let mut writer = work.create_result(item)?;
    writer.section(&cells.iter().map(|cell| cell.key).collect::<Vec<CellKey>>())?;
    writer.section(&labels)?;
    let free = labels.iter().filter(|&&label| label == FREE).count();
    let counted = [("settled", cells.len()), ("free", free)];
    Ok((writer, counts(counted)))
}

fn solve(
    cells: &[Cell],
    numbers: &FxHashMap<CellKey, u32>,
    fixed: &FxHashMap<CellKey, bool>,
) -> Vec<u8> {
    let mut network = Network::new();
    network.grow(cells.len());
    let mut terminals: Vec<i64> = Vec::with_capacity(cells.len());
    for (number, cell) in (0u32..).zip(cells) {
        let mut terminal = cell.terminal;
        for facet in 0..4 {
            let Some((other, back)) = across(&cell.key, facet, cell.apexes[facet]) else {
                continue;
            };
            match (numbers.get(&other), fixed.get(&other)) {
                (Some(&other), _) => network.join(NodeId(number), facet, NodeId(other), back),
                (None, Some(true)) => terminal += cell.into[facet],
                (None, _) => terminal -= cell.out[facet],
            }
        }
        terminals.push(terminal);
    }
    for (number, (cell, &terminal)) in (0u32..).zip(cells.iter().zip(&terminals)) {
        for facet in 0..4 {
            network.set_capacity(NodeId(number), facet, cell.out[facet]);
        }
        network.set_terminal(NodeId(number), terminal);
    }
    network.maximize();
    let numbers = 0..cells.len() as u32;
    numbers
        .map(|number| match network.is_source_side(NodeId(number)) {
            true => FREE,
            false => OCCUPIED,
        })
        .collect()
}
