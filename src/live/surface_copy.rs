//! A copy of the surface that a map follows, for clients that come late.

use linecarve_carving::{Face, MeshChange};
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use crate::report::growth_delta::NumberedSurface;
use linecarve_engine::map::SurfaceChange;

/// Position and colour of a vertex, as they are sent.
#[derive(Debug, Clone, Copy, PartialEq)]
struct CopiedVertex {
    position: [f32; 3],
    color: Option<[u8; 3]>,
}

/// A surface that follows the changes of another one. A change costs what it changes.
#[derive(Debug, Default)]
pub(super) struct SurfaceCopy {
    content: SurfaceContent,
    /// Index of each face in the content.
    index: FxHashMap<Face, u32>,
}

/// Vertices by number, and faces: what a whole state is made from.
#[derive(Debug, Clone, Default)]
pub(super) struct SurfaceContent {
    vertices: Vec<Option<CopiedVertex>>,
    vertex_count: usize,
    faces: Vec<Face>,
}

impl SurfaceCopy {
    /// Follows a change, after which the other surface is `surface`.
    pub(super) fn follow(&mut self, surface: &dyn NumberedSurface, change: &SurfaceChange) {
        if change.is_anew {
            *self = Self::default();
        }
        let mesh = &change.mesh;
        for face in &mesh.removed {
            self.remove(face);
        }
        for &number in &mesh.freed {
            self.set(number, None);
        }
        for &number in mesh.placed.iter().chain(&change.recolored) {
            let position = surface.position(number).coords.map(|value| value as f32);
            let color = surface.color(number);
            let position = position.into();
            self.set(number, Some(CopiedVertex { position, color }));
        }
        for face in &mesh.added {
            let end = self.content.faces.len() as u32;
            if self.index.insert(*face, end).is_none() {
                self.content.faces.push(*face);
            }
        }
    }

    /// What it holds.
    pub(super) fn content(&self) -> &SurfaceContent {
        &self.content
    }

    fn set(&mut self, number: u32, vertex: Option<CopiedVertex>) {
        let vertices = &mut self.content.vertices;
        if vertices.len() <= number as usize {
            vertices.resize(number as usize + 1, None);
        }
        let before = std::mem::replace(&mut vertices[number as usize], vertex);
        self.content.vertex_count += usize::from(vertex.is_some());
        self.content.vertex_count -= usize::from(before.is_some());
    }

    fn remove(&mut self, face: &Face) {
        let Some(at) = self.index.remove(face) else {
            return;
        };
        let faces = &mut self.content.faces;
        faces.swap_remove(at as usize);
        if let Some(moved) = faces.get(at as usize) {
            self.index.insert(*moved, at);
        }
    }
}

impl SurfaceContent {
    /// The change from nothing to this surface.
    pub(super) fn change_from_nothing(&self) -> SurfaceChange {
        let numbers = 0..self.vertices.len() as u32;
        let is_vertex = |number: &u32| self.vertices[*number as usize].is_some();
        let mut added = self.faces.clone();
        added.sort_unstable();
        SurfaceChange {
            mesh: MeshChange {
                placed: numbers.filter(is_vertex).collect(),
                added,
                ..MeshChange::default()
            },
            recolored: Vec::new(),
            is_anew: true,
        }
    }
}

impl NumberedSurface for SurfaceContent {
    fn vertex_count(&self) -> usize {
        self.vertex_count
    }

    fn triangle_count(&self) -> usize {
        self.faces.len()
    }

    fn position(&self, number: u32) -> Point3<f64> {
        let vertex = self.vertices[number as usize];
        vertex.map_or_else(Point3::origin, |it| {
            Point3::from(it.position.map(f64::from))
        })
    }

    fn color(&self, number: u32) -> Option<[u8; 3]> {
        self.vertices[number as usize].and_then(|it| it.color)
    }
}
