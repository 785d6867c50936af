//! The merged mesh, read in blocks.

use linecarve_carving::IndexedMesh;
use nalgebra::Point3;

use crate::error::TilesError;
use crate::file::Reader;
use crate::record::Record;
use crate::stage::{Item, Stage};
use crate::work::Work;

/// The mesh of a plan whose stages are all done, in its file. Vertices and triangles are in the order of
/// [`IndexedMesh`].
#[derive(Debug)]
pub struct MergedMesh {
    reader: Reader,
    /// Number of vertices and of their blocks.
    vertices: [usize; 2],
    triangles: [usize; 2],
    bounds: [[f64; 3]; 2],
}

impl MergedMesh {
    /// The task that writes it.
    pub(super) const ITEM: Item = Item {
        stage: Stage::Merge,
        number: 0,
    };

    /// Opens the mesh.
    ///
    /// # Errors
    /// When it is not there, or damaged.
    pub fn open(work: &Work) -> Result<Self, TilesError> {
        let reader = work.open_result(Self::ITEM, Self::ITEM)?;
        let sections = reader.section_count();
        let damaged = |what: &str| TilesError::damaged(reader.path(), what);
        let numbers = |section: Option<usize>| section.ok_or_else(|| damaged("no numbers"));
        let counts: Vec<[u64; 2]> = reader.records(numbers(sections.checked_sub(2))?)?;
        let bounds: Vec<[f64; 3]> = reader.records(numbers(sections.checked_sub(1))?)?;
        match (&counts[..], &bounds[..]) {
            (&[vertices, triangles], &[low, high]) => Ok(Self {
                vertices: vertices.map(|count| count as usize),
                triangles: triangles.map(|count| count as usize),
                bounds: [low, high],
                reader,
            }),
            _ => Err(damaged("no numbers")),
        }
    }

    /// Number of vertices.
    pub fn vertex_count(&self) -> usize {
        self.vertices[0]
    }

    /// Number of triangles.
    pub fn triangle_count(&self) -> usize {
        self.triangles[0]
    }

    /// The smallest and the largest coordinates; `None` without vertices.
    pub fn bounds(&self) -> Option<[Point3<f64>; 2]> {
        (self.vertex_count() > 0).then(|| self.bounds.map(Point3::from))
    }

    /// All positions; a block of the file is in memory at a time.
    pub fn vertices(&self) -> impl Iterator<Item = Result<Point3<f64>, TilesError>> {
        let all = self.records::<[f64; 3]>(0..self.vertices[1]);
        all.map(|position| position.map(Point3::from))
    }

    /// All triangles; a block of the file is in memory at a time.
    pub fn triangles(&self) -> impl Iterator<Item = Result<[u32; 3], TilesError>> {
        let first = self.vertices[1];
        self.records(first..first + self.triangles[1])
    }

    fn records<T: Record>(
        &self,
        sections: std::ops::Range<usize>,
    ) -> impl Iterator<Item = Result<T, TilesError>> {
        sections.flat_map(|section| {
            let (records, error) = match self.reader.records(section) {
                Ok(records) => (records, None),
                Err(error) => (Vec::new(), Some(Err(error))),
            };
            records.into_iter().map(Ok).chain(error)
        })
    }
}

/// The mesh of a plan whose stages are all done, in memory.
///
/// # Errors
/// When it is not there, or damaged.
pub fn merged_mesh(work: &Work) -> Result<IndexedMesh, TilesError> {
    let mesh = MergedMesh::open(work)?;
    Ok(IndexedMesh {
        vertices: mesh.vertices().collect::<Result<_, _>>()?,
        triangles: mesh.triangles().collect::<Result<_, _>>()?,
    })
}
