//! One mesh from the triangles of all tiles, with the memory of one tile.
//!
//! Vertices are merged in the order of their positions and get their numbers, which go to a file. Then each tile's triangles
//! get the numbers of their corners and are sorted; these lists are merged as well. Two things concern more than a tile and are held in
//! memory: components that may be too small, and edges that have to be split or may have to be.

mod mesh;
mod neighbors;
mod repeated;
mod scratch;
mod small;
mod triangles;
mod vertices;

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::collections::binary_heap::PeekMut;

pub use mesh::{MergedMesh, merged_mesh};
pub use neighbors::merged_surface;
use repeated::Repeated;
use scratch::Scratch;
use small::TooSmall;
use vertices::{BLOCK, Numbers};

use crate::error::TilesError;
use crate::file::Writer;
use crate::stage::{Counts, Item, Stage, counts};
use crate::surface_file::SurfaceFile;
use crate::work::Work;

pub(crate) fn run(work: &Work, item: Item) -> Result<(Writer, Counts), TilesError> {
    let files = work.items(Stage::Surface);
    let files = files.map(|needed| SurfaceFile::new(work.open_result(needed, item)?));
    let files: Vec<SurfaceFile> = files.collect::<Result<_, _>>()?;
    let mut writer = work.create_result(item)?;
    let path = work.path(item);
    let folder = path.parent().unwrap_or(work.folder());
    let too_small = TooSmall::among(&files, work.plan().export.minimum_component)?;
    let mut numbers = Numbers::merge(&files, &too_small, Scratch::new(folder)?, &mut writer)?;
    let mut repeated = Repeated::read(&files)?;
    let mut runs = Runs::new(Scratch::new(folder)?);
    let points = |tile: usize| work.plan().tiles.get(tile).map_or(0, |tile| tile.points);
    for tile in 0..files.len() {
        let at = (files.as_slice(), &points as &dyn Fn(usize) -> usize);
        let sorted = triangles::of_tile(tile, at, &too_small, &mut numbers, &mut repeated)?;
        runs.add(&sorted)?;
    }
    let (parts, midpoints) = repeated.split(&mut numbers)?;
    runs.add(&parts)?;
    for block in midpoints.chunks(BLOCK) {
        writer.section(block)?;
        numbers.blocks += 1;
    }
    let (triangles, blocks) = runs.write(&mut writer)?;
    let lengths = [u64::from(numbers.count), numbers.blocks as u64];
    writer.section(&[lengths, [triangles as u64, blocks as u64]])?;
    writer.section(&numbers.bounds)?;
    let counted = [
        ("vertices", numbers.count as usize),
        ("triangles", triangles),
    ];
    Ok((writer, counts(counted)))
}

/// Sorted lists of triangles in a file.
struct Runs {
    scratch: Scratch,
    /// Where each begins and ends.
    runs: Vec<[usize; 2]>,
    end: usize,
}

impl Runs {
    fn new(scratch: Scratch) -> Self {
        Self {
            scratch,
            runs: Vec::new(),
            end: 0,
        }
    }

    fn add(&mut self, triangles: &[[u32; 3]]) -> Result<(), TilesError> {
        for block in triangles.chunks(BLOCK) {
            self.scratch.write(self.end, block)?;
            self.end += block.len();
        }
        self.runs.push([self.end - triangles.len(), self.end]);
        Ok(())
    }

    /// Merges all lists; returns the number of triangles and of blocks.
    fn write(mut self, writer: &mut Writer) -> Result<(usize, usize), TilesError> {
        let mut streams: Vec<std::vec::IntoIter<[u32; 3]>> = Vec::new();
        let mut heap = BinaryHeap::new();
        for run in 0..self.runs.len() {
            let mut stream = self.block(run)?;
            heap.extend(stream.next().map(|triangle| Reverse((triangle, run))));
            streams.push(stream);
        }
        let mut merged: Vec<[u32; 3]> = Vec::with_capacity(BLOCK);
        let mut blocks = 0;
        while let Some(mut top) = heap.peek_mut() {
            let Reverse((triangle, run)) = *top;
            merged.push(triangle);
            if merged.len() == BLOCK {
                writer.section(&merged)?;
                merged.clear();
                blocks += 1;
            }
            if streams[run].as_slice().is_empty() {
                streams[run] = self.block(run)?;
            }
            match streams[run].next() {
                Some(next) => *top = Reverse((next, run)),
                None => {
                    PeekMut::pop(top);
                }
            }
        }
        if !merged.is_empty() {
            writer.section(&merged)?;
            blocks += 1;
        }
        Ok((self.end, blocks))
    }

    /// The next block of a list.
    fn block(&mut self, run: usize) -> Result<std::vec::IntoIter<[u32; 3]>, TilesError> {
        let [begin, end] = &mut self.runs[run];
        let count = BLOCK.min(*end - *begin);
        *begin += count;
        Ok(self.scratch.read(*begin - count, count)?.into_iter())
    }
}
