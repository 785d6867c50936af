//! An incremental mesh in the order of extraction.

use std::cmp::Ordering;

use rustc_hash::FxHashMap;

use super::super::delta::{Triangle, rotate_smallest_first};
use super::super::extract::IndexedMesh;
use super::{IncrementalMesh, NONE, Record, TriangleRole};
use crate::tetrahedralization::VertexId;

impl IncrementalMesh {
    /// A copy of the mesh in an order that depends on the surface alone: that of
    /// [`Carver::mesh_where`](crate::Carver::mesh_where). Also returns the number of each vertex.
    ///
    /// # Complexity
    ///
    /// `n log n` in the number of faces.
    pub fn to_mesh(&self) -> (IndexedMesh, Vec<u32>) {
        let mut order = self.copies_in_order();
        let mut index = vec![NONE; self.vertex_capacity()];
        for (at, &number) in (0..).zip(&order) {
            index[number as usize] = at;
        }
        for number in self.points_in_order() {
            index[number as usize] = order.len() as u32;
            order.push(number);
        }
        for number in self.midpoints_in_order(&index) {
            index[number as usize] = order.len() as u32;
            order.push(number);
        }
        let corners = |face: [u32; 3]| face.map(|number| index[number as usize]);
        let mut triangles: Vec<[u32; 3]> = self
            .faces()
            .map(|face| rotate_smallest_first(corners(face)))
            .collect();
        triangles.sort_unstable();
        let mesh = IndexedMesh {
            vertices: order.iter().map(|&number| self.position(number)).collect(),
            triangles,
        };
        (mesh, order)
    }

    /// The numbers of vertices that copy one, by position; copies of one vertex in the order of their first triangles.
    fn copies_in_order(&self) -> Vec<u32> {
        let numbers = 0..self.vertex_capacity() as u32;
        let mut order: Vec<u32> = numbers
            .filter(|&number| self.is_vertex(number) && self.origin(number).is_some())
            .collect();
        order.sort_unstable_by(|a, b| self.by_position(*a, *b));
        let copied = |a: &u32, b: &u32| self.origin(*a) == self.origin(*b);
        if order.chunk_by(copied).all(|copies| copies.len() == 1) {
            return order;
        }
        let rank = self.ranks(&order);
        let mut first: FxHashMap<u32, [u32; 3]> = FxHashMap::default();
        for (triangle, record) in self.whole_triangles() {
            let key =
                rotate_smallest_first(triangle.map(|v| rank.get(&v).copied().unwrap_or(NONE)));
            for corner in record.corners.into_iter().filter(|corner| *corner != NONE) {
                let first = first.entry(corner).or_insert(key);
                *first = key.min(*first);
            }
        }
        for copies in order.chunk_by_mut(copied) {
            copies.sort_unstable_by_key(|copy| first.get(copy));
        }
        order
    }

    /// The triangles that are exported as a whole: all their corners have vertices.
    fn whole_triangles(&self) -> impl Iterator<Item = (&Triangle, &Record)> {
        let records = self.records.iter();
        records.filter(|(_, record)| record.exported() == TriangleRole::Exported)
    }

    /// The place of each vertex of the tetrahedralisation in the order of positions.
    fn ranks(&self, order: &[u32]) -> FxHashMap<VertexId, u32> {
        let origins = (0..).zip(order);
        origins
            .filter_map(|(rank, number)| Some((self.origin(*number)?, rank)))
            .collect()
    }

    /// The numbers of vertices inside triangles, by position.
    fn points_in_order(&self) -> Vec<u32> {
        let mut order: Vec<u32> = self.inside.keys().copied().collect();
        order.sort_unstable_by(|a, b| self.by_position(*a, *b));
        order
    }

    /// The lexicographic order of two positions.
    fn by_position(&self, a: u32, b: u32) -> Ordering {
        let (a, b) = (self.position(a), self.position(b));
        let orders = a.iter().zip(b.iter()).map(|(a, b)| a.total_cmp(b));
        orders.fold(Ordering::Equal, Ordering::then)
    }

    /// The numbers of midpoints, by the ends of their edges, then by the first triangles at them.
    fn midpoints_in_order(&self, index: &[u32]) -> Vec<u32> {
        let mut found: FxHashMap<u32, ([u32; 2], [u32; 3])> = FxHashMap::default();
        for (triangle, split) in &self.splits {
            // An edge has a whole triangle on one side at least.
            let record = self.records.get(triangle);
            let Some(record) = record.filter(|it| it.exported() == TriangleRole::Exported) else {
                continue;
            };
            let corners = record.corners.map(|number| index[number as usize]);
            for k in (0..3).filter(|&k| split.midpoints[k] != NONE) {
                let [a, b] = [corners[k], corners[(k + 1) % 3]];
                let key = ([a.min(b), a.max(b)], self.position_key(triangle, index));
                let known = found.entry(split.midpoints[k]).or_insert(key);
                *known = key.min(*known);
            }
        }
        let mut order: Vec<_> = found
            .into_iter()
            .map(|(number, key)| (key, number))
            .collect();
        order.sort_unstable();
        order.into_iter().map(|(_, number)| number).collect()
    }

    /// A triangle by the places of its vertices in the order of positions, the smallest first.
    fn position_key(&self, triangle: &Triangle, index: &[u32]) -> [u32; 3] {
        rotate_smallest_first(triangle.map(|vertex| {
            let copies = self.copies(vertex).map(|copy| index[copy as usize]);
            copies.min().unwrap_or(NONE)
        }))
    }
}
