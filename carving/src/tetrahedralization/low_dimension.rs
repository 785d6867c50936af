//! Vertices that do not span space yet: no cell exists, the vertices are kept in lexicographic order.
//!
//! While all vertices coincide, are collinear or coplanar there is nothing to carve, so this state holds only
//! what the neighbouring states need: duplicates are found by position, the dimension by an affine basis. It is
//! canonical, as both depend on the positions alone.

use std::collections::BTreeMap;

use super::storage::Storage;
use crate::predicates::{are_collinear, orient3d};

/// A position as an integer triple in the same lexicographic order.
type Key = [u64; 3];

fn key(position: &[f64; 3]) -> Key {
    position.map(|coordinate| {
        let bits = coordinate.to_bits();
        // Flip all bits of negative numbers, the sign bit of others: unsigned order equals numeric order.
        bits ^ (((bits as i64 >> 63) as u64) | 1 << 63)
    })
}

/// What a further vertex does to the dimension.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Span {
    /// The vertices stay within a plane.
    Flat,
    /// The four vertices span space, in positive orientation.
    Space([u32; 4]),
}

/// The vertices of a state of dimension below three.
#[derive(Clone, Debug, Default)]
pub(super) struct LowDimension {
    in_order: BTreeMap<Key, u32>,
    /// Affinely independent vertices that span all others.
    basis: Vec<u32>,
}

impl LowDimension {
    /// −1 when empty, 0 for one point, 1 on a line, 2 in a plane.
    pub(super) fn dimension(&self) -> i8 {
        self.basis.len() as i8 - 1
    }

    /// The vertex at exactly this position.
    pub(super) fn find(&self, position: &[f64; 3]) -> Option<u32> {
        self.in_order.get(&key(position)).copied()
    }

    /// Adds a vertex whose position is not taken.
    pub(super) fn add(&mut self, storage: &Storage, vertex: u32) -> Span {
        self.in_order.insert(key(storage.position(vertex)), vertex);
        self.extend_basis(storage, vertex)
    }

    fn extend_basis(&mut self, storage: &Storage, vertex: u32) -> Span {
        let at = |i: usize| storage.position(self.basis[i]);
        let position = storage.position(vertex);
        let independent = match self.basis.len() {
            0 => true,
            1 => at(0) != position,
            2 => !are_collinear(at(0), at(1), position),
            _ => {
                let side = orient3d(at(0), at(1), at(2), position);
                if side != 0.0 {
                    let [a, b, c] = [self.basis[0], self.basis[1], self.basis[2]];
                    return Span::Space(if side > 0.0 {
                        [a, b, c, vertex]
                    } else {
                        [b, a, c, vertex]
                    });
                }
                false
            }
        };
        if independent {
            self.basis.push(vertex);
        }
        Span::Flat
    }

    /// Takes out a vertex; linear in the number of vertices if it belonged to the basis.
    pub(super) fn remove(&mut self, storage: &Storage, vertex: u32) {
        self.in_order.remove(&key(storage.position(vertex)));
        if self.basis.contains(&vertex) {
            self.basis.clear();
            for other in self.in_order.values().copied().collect::<Vec<_>>() {
                if self.basis.len() == 3 {
                    break;
                }
                self.extend_basis(storage, other);
            }
        }
    }

    /// Takes in all `vertices`, which lie in a plane; their order does not matter.
    pub(super) fn refill(&mut self, storage: &Storage, vertices: impl Iterator<Item = u32>) {
        self.clear();
        for vertex in vertices {
            let span = self.add(storage, vertex);
            debug_assert_eq!(
                span,
                Span::Flat,
                "only coplanar vertices enter the low-dimensional state"
            );
        }
    }

    /// All vertices in lexicographic order.
    pub(super) fn vertices(&self) -> impl Iterator<Item = u32> + '_ {
        self.in_order.values().copied()
    }

    pub(super) fn clear(&mut self) {
        self.in_order.clear();
        self.basis.clear();
    }

    /// The vertex nearest to `point`, ties going to the lexicographically smaller one.
    ///
    /// Sweeps from the vertices nearest in x outwards until the gap in x alone exceeds the best distance.
    pub(super) fn nearest(&self, storage: &Storage, point: &[f64; 3]) -> Option<u32> {
        let start = [key(point)[0], 0, 0];
        let mut below = self
            .in_order
            .range(..start)
            .rev()
            .map(|(_, &v)| v)
            .peekable();
        let mut above = self.in_order.range(start..).map(|(_, &v)| v).peekable();
        let gap = |v: u32| (storage.position(v)[0] - point[0]).abs();
        let mut best: Option<(f64, Key, u32)> = None;
        loop {
            let next = match (below.peek(), above.peek()) {
                (None, None) => break,
                (Some(_), None) => below.next(),
                (None, Some(_)) => above.next(),
                (Some(&b), Some(&a)) => {
                    if gap(b) < gap(a) {
                        below.next()
                    } else {
                        above.next()
                    }
                }
            };
            let Some(vertex) = next else { break };
            if best.is_some_and(|(distance, ..)| gap(vertex) * gap(vertex) > distance) {
                break;
            }
            let position = storage.position(vertex);
            let squared = |i: usize| (position[i] - point[i]) * (position[i] - point[i]);
            let distance: f64 = (0..3).map(squared).sum();
            let candidate = (distance, key(position), vertex);
            if best.is_none_or(|(d, k, _)| (distance, candidate.1) < (d, k)) {
                best = Some(candidate);
            }
        }
        best.map(|(_, _, vertex)| vertex)
    }

    /// Whether basis and vertices agree with each other; the checker's view.
    pub(super) fn is_consistent(&self, storage: &Storage) -> bool {
        let mut rebuilt = LowDimension::default();
        let vertices: Vec<u32> = self.vertices().collect();
        let flat = vertices
            .iter()
            .all(|&v| rebuilt.add(storage, v) == Span::Flat);
        flat && rebuilt.dimension() == self.dimension()
            && rebuilt.in_order == self.in_order
            && self.basis.iter().all(|v| vertices.contains(v))
    }
}
