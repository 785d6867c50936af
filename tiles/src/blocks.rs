//! Cells of a tile in a file, in blocks of sections, so that a few cells of another tile are read without the rest of it.

use crate::error::TilesError;
use crate::file::{Reader, Writer};
use crate::tile::{CellKey, tile_of};

/// Most cells of a block.
pub(crate) const BLOCK: usize = 4096;

/// Writes a section with the first key of each block, then the sections of each block: `write` gets a range of cells.
pub(crate) fn write_blocks(
    writer: &mut Writer,
    keys: &[CellKey],
    mut write: impl FnMut(&mut Writer, std::ops::Range<usize>) -> Result<(), TilesError>,
) -> Result<(), TilesError> {
    let firsts: Vec<CellKey> = keys.iter().step_by(BLOCK).copied().collect();
    writer.section(&firsts)?;
    (0..keys.len())
        .step_by(BLOCK)
        .try_for_each(|first| write(writer, first..keys.len().min(first + BLOCK)))
}

/// Where a block is in its file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    /// Its first section.
    pub(crate) section: usize,
    /// Number of its first cell in the tile.
    pub(crate) first: usize,
}

/// All blocks of a file whose index is the section `index`, with so many sections each.
pub(crate) fn all_blocks(
    reader: &Reader,
    index: usize,
    sections: usize,
) -> impl Iterator<Item = Block> + use<> {
    (0..reader.length(index) / 32).map(move |block| Block {
        section: index + 1 + block * sections,
        first: block * BLOCK,
    })
}

/// Finds cells: `needed` is sorted, `open` opens the file of a tile, `take` gets each block with the cells that may be in it.
pub(crate) fn visit_blocks(
    mut needed: &[CellKey],
    open: impl Fn(usize) -> Result<Reader, TilesError>,
    (index, sections): (usize, usize),
    mut take: impl FnMut(&Reader, usize, Block, &[CellKey]) -> Result<(), TilesError>,
) -> Result<(), TilesError> {
    while let Some(first) = needed.first() {
        let tile = tile_of(first[0]);
        let (mut own, others) =
            needed.split_at(needed.partition_point(|key| tile_of(key[0]) == tile));
        needed = others;
        let reader = open(tile)?;
        let firsts: Vec<CellKey> = reader.records(index)?;
        while let Some(first) = own.first() {
            let after = firsts.partition_point(|key| key <= first);
            let is_before_next = |key: &CellKey| firsts.get(after).is_none_or(|next| key < next);
            let (these, others) = own.split_at(own.partition_point(is_before_next));
            own = others;
            // Cells before the first block are in none.
            if let Some(block) = after.checked_sub(1) {
                let block = Block {
                    section: index + 1 + block * sections,
                    first: block * BLOCK,
                };
                take(&reader, tile, block, these)?;
            }
        }
    }
    Ok(())
}
