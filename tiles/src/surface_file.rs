//! The file of the surface of a tile: what `merge` needs to know of it, in blocks.
//!
//! ```text
//! section 0  numbers of vertices and triangles
//! 1          corners that are in a second or later fan of their vertex
//! 2, 3       edges that a fan may have twice: sides, midpoints
//! 4          triangles of components that may be too small
//! 5          sides of edges whose neighbour is not just the other of two triangles, where the plan asks for them
//! then       blocks of vertices, two sections each, and blocks of triangles, two sections each
//! ```

use crate::error::TilesError;
use crate::file::{Reader, Writer};

/// Most vertices or triangles of a block.
const BLOCK: usize = 4096;
/// The first section of blocks.
const BLOCKS: usize = 6;

/// The corners of a triangle as ids of the whole scene; the one of the lexicographically smallest position first.
pub(crate) type IdTriangle = [u64; 3];

/// A triangle by the positions of its corners, the first two those of an edge, and the third corner of the neighbour across this edge; NaN
/// when there is none.
pub(crate) type Side = [[f64; 3]; 4];

/// A corner or an edge of a triangle, which starts at the corner of the same index, and a number.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug)]
pub(crate) struct Place {
    pub(crate) triangle: IdTriangle,
    pub(crate) corner: u32,
    pub(crate) number: u32,
}

impl Place {
    fn to_record(self) -> [u64; 4] {
        let [a, b, c] = self.triangle;
        [
            a,
            b,
            c,
            u64::from(self.corner) << 32 | u64::from(self.number),
        ]
    }

    fn from_record([a, b, c, packed]: [u64; 4]) -> Self {
        Self {
            triangle: [a, b, c],
            corner: (packed >> 32) as u32,
            number: packed as u32,
        }
    }
}

/// A copy of a vertex of the tile: there is one for each fan of triangles around the vertex.
#[derive(Clone, Copy, PartialEq, Debug)]
pub(crate) struct SurfaceVertex {
    /// Number of the vertex in the tile.
    pub(crate) local: u32,
    /// Number of the copy.
    pub(crate) copy: u32,
    /// The component of its triangles, see [`SurfacePart::triangles`].
    pub(crate) component: u32,
    pub(crate) position: [f64; 3],
}

/// What a tile knows of the surface.
#[derive(Default)]
pub(crate) struct SurfacePart {
    /// Corners at vertices of the tile with the number of their fan, where that is not 0; sorted.
    pub(crate) fans: Vec<Place>,
    /// Edges of the tile whose ends may be those of another edge of the same fans, with their number among these and the midpoint.
    pub(crate) repeated: Vec<(Place, [f64; 3])>,
    /// Triangles of components that may be too small, with the component (from 1 on); sorted. Those of other tiles are included.
    pub(crate) small: Vec<(IdTriangle, u32)>,
    pub(crate) sides: Vec<Side>,
    /// Sorted by position, copies of one vertex in their order.
    pub(crate) vertices: Vec<SurfaceVertex>,
    /// Triangles whose first corner is a vertex of the tile, with their component: 0 if it is large enough.
    pub(crate) triangles: Vec<(IdTriangle, u32)>,
}

impl SurfacePart {
    pub(crate) fn write(&self, writer: &mut Writer) -> Result<(), TilesError> {
        writer.section(&[self.vertices.len() as u64, self.triangles.len() as u64])?;
        let fans = self.fans.iter().map(|place| place.to_record());
        writer.section(&fans.collect::<Vec<_>>())?;
        let repeated = self.repeated.iter().map(|(place, _)| place.to_record());
        writer.section(&repeated.collect::<Vec<_>>())?;
        let midpoints = self.repeated.iter().map(|(_, midpoint)| *midpoint);
        writer.section(&midpoints.collect::<Vec<_>>())?;
        let small = self.small.iter().map(|&([a, b, c], component)| {
            let component = u64::from(component);
            [a, b, c, component]
        });
        writer.section(&small.collect::<Vec<_>>())?;
        writer.section(&self.sides)?;
        for block in self.vertices.chunks(BLOCK) {
            let numbers = block.iter().map(|v| [v.local, v.copy, v.component]);
            writer.section(&numbers.collect::<Vec<[u32; 3]>>())?;
            writer.section(&block.iter().map(|v| v.position).collect::<Vec<_>>())?;
        }
        for block in self.triangles.chunks(BLOCK) {
            writer.section(&block.iter().map(|(ids, _)| *ids).collect::<Vec<_>>())?;
            writer.section(&block.iter().map(|(_, c)| *c).collect::<Vec<u32>>())?;
        }
        Ok(())
    }
}

/// An opened file.
pub(crate) struct SurfaceFile {
    reader: Reader,
    pub(crate) vertices: usize,
    pub(crate) triangles: usize,
}

impl SurfaceFile {
    pub(crate) fn new(reader: Reader) -> Result<Self, TilesError> {
        let counts: Vec<u64> = reader.records(0)?;
        let [vertices, triangles] = counts[..] else {
            return Err(TilesError::damaged(reader.path(), "no numbers"));
        };
        Ok(Self {
            reader,
            vertices: vertices as usize,
            triangles: triangles as usize,
        })
    }

    pub(crate) fn damaged(&self, what: &str) -> TilesError {
        TilesError::damaged(self.reader.path(), what)
    }

    fn places(&self, section: usize) -> Result<Vec<Place>, TilesError> {
        let records: Vec<[u64; 4]> = self.reader.records(section)?;
        Ok(records.into_iter().map(Place::from_record).collect())
    }

    pub(crate) fn fans(&self) -> Result<Vec<Place>, TilesError> {
        self.places(1)
    }

    pub(crate) fn repeated(&self) -> Result<Vec<(Place, [f64; 3])>, TilesError> {
        let midpoints: Vec<[f64; 3]> = self.reader.records(3)?;
        Ok(self.places(2)?.into_iter().zip(midpoints).collect())
    }

    pub(crate) fn small(&self) -> Result<Vec<(IdTriangle, u32)>, TilesError> {
        let records: Vec<[u64; 4]> = self.reader.records(4)?;
        let small = records.into_iter();
        Ok(small.map(|[a, b, c, n]| ([a, b, c], n as u32)).collect())
    }

    pub(crate) fn sides(&self) -> Result<Vec<Side>, TilesError> {
        self.reader.records(5)
    }

    pub(crate) fn vertex_blocks(&self) -> usize {
        self.vertices.div_ceil(BLOCK)
    }

    /// Local number, copy and component of the vertices of a block.
    pub(crate) fn vertex_numbers(&self, block: usize) -> Result<Vec<[u32; 3]>, TilesError> {
        self.reader.records(BLOCKS + 2 * block)
    }

    pub(crate) fn vertex_block(&self, block: usize) -> Result<Vec<SurfaceVertex>, TilesError> {
        let positions: Vec<[f64; 3]> = self.reader.records(BLOCKS + 2 * block + 1)?;
        let vertices = self.vertex_numbers(block)?.into_iter().zip(positions);
        let vertex = |([local, copy, component], position): ([u32; 3], _)| SurfaceVertex {
            local,
            copy,
            component,
            position,
        };
        Ok(vertices.map(vertex).collect())
    }

    pub(crate) fn triangle_blocks(&self) -> usize {
        self.triangles.div_ceil(BLOCK)
    }

    pub(crate) fn triangle_block(
        &self,
        block: usize,
    ) -> Result<Vec<(IdTriangle, u32)>, TilesError> {
        let section = BLOCKS + 2 * (self.vertex_blocks() + block);
        let ids: Vec<IdTriangle> = self.reader.records(section)?;
        let components: Vec<u32> = self.reader.records(section + 1)?;
        Ok(ids.into_iter().zip(components).collect())
    }
}
