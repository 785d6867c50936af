//! Edges with the same ends: all but one of them are split at their midpoints.

use std::cmp::Ordering;

use nalgebra::{Point3, center};

use super::super::assemble::cut_at_midpoints;
use super::super::delta::{Triangle, rotate_smallest_first};
use super::super::part::TrianglePart;
use super::update::Update;
use super::{NONE, TriangleRole};
use crate::tetrahedralization::{Tetrahedralization, VertexId};

/// A triangle that is exported as several faces: one with a split edge, or of which a part is exported.
#[derive(Clone, Debug)]
pub(super) struct Split {
    /// The vertex at the middle of each edge, [`NONE`] for those that are whole.
    pub(super) midpoints: [u32; 3],
    /// The vertex inside it, [`NONE`] where all of it is exported.
    pub(super) inside: u32,
    /// The corner that was at the smallest position when the faces were made.
    pub(super) first: usize,
    pub(super) faces: Vec<u32>,
}

impl Default for Split {
    fn default() -> Self {
        Self {
            midpoints: [NONE; 3],
            inside: NONE,
            first: 0,
            faces: Vec::new(),
        }
    }
}

impl Split {
    /// Whether there is a vertex inside the triangle.
    pub(super) fn has_point(&self) -> bool {
        self.inside != NONE
    }

    pub(super) fn without_faces(&self) -> Self {
        Self {
            faces: Vec::new(),
            ..*self
        }
    }

    /// Appends the faces of a triangle with these mesh vertices at its corners.
    pub(super) fn append_pieces(
        &mut self,
        tetrahedra: &Tetrahedralization,
        triangle: &Triangle,
        corners: [u32; 3],
        part: Option<TrianglePart>,
        pieces: &mut Vec<[u32; 3]>,
    ) {
        let middle = |number: u32| (number != NONE).then_some(number);
        let Some(part) = part else {
            cut_at_midpoints(corners, self.midpoints.map(middle), self.first, pieces);
            return;
        };
        let position = |k: usize| tetrahedra.coordinates(triangle[k]).map(Ordered);
        for k in 0..3 {
            if !part.edges[k] {
                self.midpoints[k] = NONE;
                continue;
            }
            let to = (k + 1) % 3;
            let first = usize::from(position(to) < position(k));
            let piece = [corners[k], corners[to], self.inside];
            cut_at_midpoints(
                piece,
                [middle(self.midpoints[k]), None, None],
                first,
                pieces,
            );
        }
    }
}

/// An edge of the surface at a vertex: the triangle on one side, and that on the other side.
#[derive(Clone, Copy, Debug)]
pub(super) struct EdgeGroup {
    pub(super) at: VertexId,
    /// A triangle and which of its edges it is.
    pub(super) one: (Triangle, usize),
    pub(super) other: Option<(Triangle, usize)>,
}

impl EdgeGroup {
    fn sides(&self) -> impl Iterator<Item = (Triangle, usize)> {
        [Some(self.one), self.other].into_iter().flatten()
    }

    /// The end that is not `at`.
    fn end(&self) -> VertexId {
        let (triangle, k) = self.one;
        let [a, b] = [triangle[k], triangle[(k + 1) % 3]];
        if a == self.at { b } else { a }
    }
}

impl Update<'_> {
    /// Splits the listed edges that have the ends of another one, and makes the others whole.
    pub(super) fn settle_edges(&mut self) {
        let edges = std::mem::take(&mut self.edges);
        let mut keyed: Vec<([u32; 2], EdgeGroup)> = Vec::with_capacity(edges.len());
        for edge in edges {
            // An edge between two vertices of the update is listed at both.
            let end = edge.end();
            if end < edge.at && self.is_dirty(end) {
                continue;
            }
            let (triangle, k) = edge.one;
            if let Some(record) = self.mesh.records.get(&triangle) {
                let [a, b] = [record.corners[k], record.corners[(k + 1) % 3]];
                keyed.push(([a.min(b), a.max(b)], edge));
            }
        }
        keyed.sort_unstable_by_key(|(ends, edge)| (*ends, edge.one));
        let tetrahedra = self.carved.tetrahedra;
        for same in keyed.chunk_by_mut(|(a, _), (b, _)| a == b) {
            if same.len() > 1 {
                let is_whole = |triangle: &Triangle| {
                    let record = self.mesh.records.get(triangle);
                    record.is_some_and(|record| record.exported() == TriangleRole::Exported)
                };
                same.sort_by(|(_, a), (_, b)| {
                    first_of(tetrahedra, a, is_whole)
                        .partial_cmp(&first_of(tetrahedra, b, is_whole))
                        .unwrap_or(Ordering::Equal)
                });
            }
            for (index, (ends, edge)) in same.iter().enumerate() {
                if same.len() > 1 {
                    let sides = edge.sides().map(|(triangle, _)| triangle);
                    self.mesh.repeated.extend(sides);
                }
                match index {
                    0 => self.make_whole(edge),
                    _ => self.split(edge, *ends),
                }
            }
        }
    }

    fn make_whole(&mut self, edge: &EdgeGroup) {
        for (triangle, k) in edge.sides() {
            if let Some(split) = self.mesh.splits.get_mut(&triangle)
                && std::mem::replace(&mut split.midpoints[k], NONE) != NONE
            {
                self.stale.push(triangle);
            }
        }
    }

    fn split(&mut self, edge: &EdgeGroup, ends: [u32; 2]) {
        let tetrahedra = self.carved.tetrahedra;
        let [a, b] = ends.map(|end| *self.mesh.vertices.position(end));
        let middle = center(&a, &b);
        let known = edge.sides().find_map(|(triangle, k)| {
            let split = self.mesh.splits.get(&triangle)?;
            let known = split.midpoints[k];
            (known != NONE && !self.taken.contains(&known)).then_some(known)
        });
        let number = match known {
            Some(known) => {
                self.place(known, middle);
                known
            }
            None => self.add_midpoint(middle),
        };
        self.taken.insert(number);
        for (triangle, k) in edge.sides() {
            let split = self.mesh.splits.entry(triangle).or_default();
            let is_new = std::mem::replace(&mut split.midpoints[k], number) != number;
            if is_new || split.first != first_corner(tetrahedra, &triangle) {
                self.stale.push(triangle);
            } else {
                self.reshaped.push(triangle);
            }
        }
    }

    /// Adds a vertex that copies none.
    pub(super) fn add_midpoint(&mut self, middle: Point3<f64>) -> u32 {
        let number = self.mesh.vertices.add(middle, None);
        self.mesh.log.place(number);
        number
    }
}

/// The corner of a triangle at the lexicographically smallest position.
pub(super) fn first_corner(tetrahedra: &Tetrahedralization, triangle: &Triangle) -> usize {
    let position = |k: &usize| tetrahedra.coordinates(triangle[*k]).map(Ordered);
    (0..3).min_by_key(position).unwrap_or(0)
}

/// The positions of the first whole triangle at an edge in the order of extraction.
fn first_of(
    tetrahedra: &Tetrahedralization,
    edge: &EdgeGroup,
    is_whole: impl Fn(&Triangle) -> bool,
) -> [[Ordered; 3]; 3] {
    let whole = edge.sides().filter(|(triangle, _)| is_whole(triangle));
    let positions = whole.map(|(triangle, _)| {
        rotate_smallest_first(triangle.map(|v| tetrahedra.coordinates(v).map(Ordered)))
    });
    let first = positions.min();
    first.expect("an edge has a whole triangle on one side at least")
}

/// A coordinate, totally ordered.
#[derive(Clone, Copy, Debug)]
struct Ordered(f64);

impl PartialEq for Ordered {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Ordered {}

impl PartialOrd for Ordered {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Ordered {
    fn cmp(&self, other: &Self) -> Ordering {
        self.0.total_cmp(&other.0)
    }
}
