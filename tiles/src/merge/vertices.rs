//! The vertices of all tiles in one order.

use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;

use super::scratch::Scratch;
use super::small::TooSmall;
use crate::error::TilesError;
use crate::file::Writer;
use crate::split::by_position;
use crate::surface_file::{SurfaceFile, SurfaceVertex};

/// In place of the number of a vertex that is in no triangle.
pub(super) const NO_NUMBER: u32 = u32::MAX;
/// Most records of a block of the mesh.
pub(super) const BLOCK: usize = 4096;

/// A list of a tile that is read in blocks.
struct Stream<'a> {
    file: &'a SurfaceFile,
    block: usize,
    vertices: std::vec::IntoIter<SurfaceVertex>,
    /// Numbers that have been given but not been written yet.
    numbers: Vec<u32>,
    written: usize,
}

impl Stream<'_> {
    fn next(&mut self) -> Result<Option<SurfaceVertex>, TilesError> {
        if self.vertices.as_slice().is_empty() && self.block < self.file.vertex_blocks() {
            self.vertices = self.file.vertex_block(self.block)?.into_iter();
            self.block += 1;
        }
        Ok(self.vertices.next())
    }
}

/// The next vertex of a tile.
struct Next(SurfaceVertex, usize);

impl Next {
    /// A vertex belongs to one tile, so its copies follow each other.
    fn compare(&self, other: &Self) -> Ordering {
        by_position(&self.0.position, &other.0.position).then(self.1.cmp(&other.1))
    }
}
impl PartialEq for Next {
    fn eq(&self, other: &Self) -> bool {
        self.compare(other).is_eq()
    }
}
impl Eq for Next {}
impl PartialOrd for Next {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Next {
    fn cmp(&self, other: &Self) -> Ordering {
        self.compare(other)
    }
}

/// Numbers of vertices in a file, tile after tile, and what has been written of the mesh.
pub(super) struct Numbers {
    scratch: Scratch,
    /// Where the numbers of each tile begin.
    first: Vec<usize>,
    pub(super) count: u32,
    pub(super) blocks: usize,
    /// The corners of the bounding box.
    pub(super) bounds: [[f64; 3]; 2],
}

impl Numbers {
    /// Merges the lists of all tiles, and writes the positions of the vertices that are in a triangle.
    pub(super) fn merge(
        files: &[SurfaceFile],
        too_small: &TooSmall,
        scratch: Scratch,
        writer: &mut Writer,
    ) -> Result<Self, TilesError> {
        let mut total = 0;
        let first = files.iter().map(|file| {
            total += file.vertices;
            total - file.vertices
        });
        let mut merged = Self {
            scratch,
            first: first.collect(),
            count: 0,
            blocks: 0,
            bounds: [[f64::INFINITY; 3], [f64::NEG_INFINITY; 3]],
        };
        let mut streams: Vec<Stream> = (files.iter())
            .map(|file| Stream {
                file,
                block: 0,
                vertices: Vec::new().into_iter(),
                numbers: Vec::new(),
                written: 0,
            })
            .collect();
        let mut heap = BinaryHeap::new();
        for (tile, stream) in streams.iter_mut().enumerate() {
            heap.extend(stream.next()?.map(|vertex| Reverse(Next(vertex, tile))));
        }
        let mut positions: Vec<[f64; 3]> = Vec::with_capacity(BLOCK);
        // Tile, vertex and copy that the latest number was given to.
        let mut latest = None;
        while let Some(mut top) = heap.peek_mut() {
            let Reverse(Next(vertex, tile)) = &*top;
            let (vertex, tile) = (*vertex, *tile);
            let stream = &mut streams[tile];
            let name = (tile, vertex.local, vertex.copy);
            let number = if too_small.contains(tile, vertex.component) {
                NO_NUMBER
            } else if latest == Some(name) {
                merged.count - 1
            } else {
                latest = Some(name);
                positions.push(vertex.position);
                merged.enter(&vertex.position)?
            };
            stream.numbers.push(number);
            if stream.numbers.len() == BLOCK {
                merged.flush(tile, stream)?;
            }
            if positions.len() == BLOCK {
                writer.section(&positions)?;
                positions.clear();
                merged.blocks += 1;
            }
            match stream.next()? {
                Some(vertex) => *top = Reverse(Next(vertex, tile)),
                None => {
                    std::collections::binary_heap::PeekMut::pop(top);
                }
            }
        }
        for (tile, stream) in streams.iter_mut().enumerate() {
            merged.flush(tile, stream)?;
        }
        if !positions.is_empty() {
            writer.section(&positions)?;
            merged.blocks += 1;
        }
        Ok(merged)
    }

    /// Gives a number to a position.
    pub(super) fn enter(&mut self, position: &[f64; 3]) -> Result<u32, TilesError> {
        let [low, high] = &mut self.bounds;
        for k in 0..3 {
            low[k] = low[k].min(position[k]);
            high[k] = high[k].max(position[k]);
        }
        if self.count == NO_NUMBER {
            return Err(TilesError::TooLarge);
        }
        self.count += 1;
        Ok(self.count - 1)
    }

    fn flush(&mut self, tile: usize, stream: &mut Stream) -> Result<(), TilesError> {
        let at = self.first[tile] + stream.written;
        self.scratch.write(at, &stream.numbers)?;
        stream.written += stream.numbers.len();
        stream.numbers.clear();
        Ok(())
    }

    /// The numbers of the vertices of a tile with so many points.
    pub(super) fn of_tile(
        &mut self,
        tile: usize,
        (file, points): (&SurfaceFile, usize),
    ) -> Result<TileNumbers, TilesError> {
        let numbers: Vec<u32> = self.scratch.read(self.first[tile], file.vertices)?;
        let mut of = vec![[NO_NUMBER; 2]; points];
        let mut next = numbers.iter();
        for block in 0..file.vertex_blocks() {
            for [local, copy, _] in file.vertex_numbers(block)? {
                let number = next.next().copied().unwrap_or(NO_NUMBER);
                let Some(slot) = of.get_mut(local as usize) else {
                    return Err(file.damaged("an unknown vertex"));
                };
                match copy {
                    // Without fans a vertex is listed for each component.
                    0 => slot[0] = slot[0].min(number),
                    _ if slot[1] == NO_NUMBER => slot[1] = next.as_slice().len() as u32,
                    _ => (),
                }
            }
        }
        // Copies from the second on follow the first.
        for [_, later] in &mut of {
            if *later != NO_NUMBER {
                *later = (numbers.len() - 1) as u32 - *later;
            }
        }
        Ok(TileNumbers { of, numbers })
    }
}

/// Numbers of the vertices of a tile.
pub(super) struct TileNumbers {
    /// For each point of the tile the number of its first copy, and where those of the others are listed.
    of: Vec<[u32; 2]>,
    numbers: Vec<u32>,
}

impl TileNumbers {
    /// The number of a copy; `copy` is asked if there is more than one.
    pub(super) fn get(&self, local: usize, copy: impl FnOnce() -> u32) -> Option<u32> {
        let [first, later] = *self.of.get(local)?;
        let number = match later {
            NO_NUMBER => first,
            later => match copy() {
                0 => first,
                copy => *self.numbers.get(later as usize + copy as usize - 1)?,
            },
        };
        (number != NO_NUMBER).then_some(number)
    }
}
