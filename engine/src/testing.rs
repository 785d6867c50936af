//! Surfaces whose changes are made up, for tests of what follows them. Only with the feature `testing`.

use std::collections::BTreeSet;

use linecarve_carving::{Face, MeshChange};
use nalgebra::Point3;

use crate::map::SurfaceChange;

/// A surface between numbered vertices.
#[derive(Default)]
pub struct TestSurface {
    positions: Vec<Point3<f64>>,
    vertices: BTreeSet<u32>,
    faces: BTreeSet<Face>,
    has_changed: bool,
}

fn smallest_first([a, b, c]: Face) -> Face {
    [a, b, c].min([b, c, a]).min([c, a, b])
}

impl TestSurface {
    /// Makes it the surface of these faces; returns the change.
    pub fn change_to(&mut self, faces: &[Face], positions: &[Point3<f64>]) -> SurfaceChange {
        let faces: BTreeSet<Face> = faces.iter().map(|face| smallest_first(*face)).collect();
        let vertices: BTreeSet<u32> = faces.iter().flatten().copied().collect();
        let before = std::mem::replace(&mut self.positions, positions.to_vec());
        let is_placed = |number: &u32| {
            !self.vertices.contains(number)
                || before[*number as usize] != positions[*number as usize]
        };
        let placed: Vec<u32> = vertices.iter().copied().filter(is_placed).collect();
        let is_reshaped = |face: &&Face| face.iter().any(|corner| placed.contains(corner));
        let stayed = faces.intersection(&self.faces);
        let mesh = MeshChange {
            freed: self.vertices.difference(&vertices).copied().collect(),
            added: faces.difference(&self.faces).copied().collect(),
            removed: self.faces.difference(&faces).copied().collect(),
            reshaped: stayed.filter(is_reshaped).copied().collect(),
            placed,
        };
        self.vertices = vertices;
        self.faces = faces;
        SurfaceChange {
            mesh,
            recolored: Vec::new(),
            is_anew: !std::mem::replace(&mut self.has_changed, true),
        }
    }

    /// Where a vertex is.
    pub fn position(&self, number: u32) -> Point3<f64> {
        self.positions[number as usize]
    }

    /// All triangles, each with its smallest vertex first.
    pub fn faces(&self) -> impl Iterator<Item = Face> {
        self.faces.iter().copied()
    }
}
