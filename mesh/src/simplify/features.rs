//! Feature edges, which remain edges during simplification.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::extent::Limits;
use super::live::LiveMesh;
use crate::feature_edges::{EdgeKind, FeatureEdges, squared_to_segment};

/// Feature edges, which remain edges during simplification.
///
/// Each stores the vertices that were merged into it; these stay within the tolerance of the edge.
pub(super) struct Features {
    edges: FxHashMap<(u32, u32), Edge>,
    /// For each vertex, the other ends of its feature edges.
    at: Vec<Vec<u32>>,
}

/// A feature edge.
struct Edge {
    swallowed: Vec<Point3<f64>>,
    /// Only boundary edges may move beyond the surface tolerance.
    kind: EdgeKind,
}

fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

impl Features {
    /// Feature edges of the original mesh, from those found by position.
    pub(super) fn new(mesh: &LiveMesh, found: &FeatureEdges) -> Self {
        let mut features = Self {
            edges: FxHashMap::default(),
            at: vec![Vec::new(); mesh.positions.len()],
        };
        let mut others = Vec::new();
        for vertex in 0..mesh.positions.len() as u32 {
            mesh.neighbors(vertex, &mut others);
            for &other in others.iter().filter(|other| **other > vertex) {
                let kind = match mesh.with_edge(vertex, other).count() {
                    // Copies of an edge that mesh repair has split are boundary edges by index,
                    // whatever they are by position.
                    1 => found.kind(vertex, other).or(Some(EdgeKind::Boundary)),
                    2 => found.kind(vertex, other),
                    // Non-manifold edges never change.
                    _ => Some(EdgeKind::Crease),
                };
                if let Some(kind) = kind {
                    let edge = Edge {
                        swallowed: Vec::new(),
                        kind,
                    };
                    features.insert(vertex, other, edge);
                }
            }
        }
        features
    }

    fn insert(&mut self, a: u32, b: u32, edge: Edge) {
        match self.edges.get_mut(&key(a, b)) {
            Some(known) => {
                known.swallowed.extend(edge.swallowed);
                known.kind = known.kind.min(edge.kind);
            }
            None => {
                self.edges.insert(key(a, b), edge);
                self.at[a as usize].push(b);
                self.at[b as usize].push(a);
            }
        }
    }

    fn remove(&mut self, a: u32, b: u32) -> Option<Edge> {
        self.at[a as usize].retain(|other| *other != b);
        self.at[b as usize].retain(|other| *other != a);
        self.edges.remove(&key(a, b))
    }

    /// The other ends of the edges at a vertex.
    pub(super) fn at(&self, vertex: u32) -> &[u32] {
        &self.at[vertex as usize]
    }

    pub(super) fn contains(&self, a: u32, b: u32) -> bool {
        self.edges.contains_key(&key(a, b))
    }

    /// All feature edges with their kinds.
    pub(super) fn edges(&self) -> impl Iterator<Item = (u32, u32, EdgeKind)> + '_ {
        (0..self.at.len() as u32).flat_map(move |a| {
            let ends = self.at[a as usize].iter().copied();
            ends.filter(move |b| *b > a)
                .map(move |b| (a, b, self.edges[&key(a, b)].kind))
        })
    }

    /// Whether the feature edges at `kept` and `gone` stay near the vertices merged into them when both ends move
    /// to `target`.
    pub(super) fn allow(
        &self,
        mesh: &LiveMesh,
        kept: u32,
        gone: u32,
        target: &Point3<f64>,
        limits: Limits,
    ) -> bool {
        let squared = |edge: &Edge| {
            let limit = if edge.kind == EdgeKind::Boundary {
                limits.beyond
            } else {
                limits.off
            };
            limit * limit
        };
        let position = |vertex: u32| &mesh.positions[vertex as usize];
        let is_near = |point: &Point3<f64>, end: u32, limit: f64| {
            squared_to_segment(point, target, position(end)) <= limit
        };
        let ends = |vertex: u32, other: u32| {
            let ends = self.at(vertex).iter().copied();
            ends.filter(move |end| *end != other)
        };
        // Edges at a moving vertex must stay near their merged vertices.
        let follow = |vertex: u32, other: u32| {
            position(vertex) == target
                || ends(vertex, other).all(|end| {
                    let edge = &self.edges[&key(vertex, end)];
                    let limit = squared(edge);
                    edge.swallowed
                        .iter()
                        .all(|point| is_near(point, end, limit))
                })
        };
        if !follow(kept, gone) || !follow(gone, kept) {
            return false;
        }
        let Some(edge) = self.edges.get(&key(kept, gone)) else {
            return true;
        };
        let both = [position(kept), position(gone)];
        let limit = squared(edge);
        edge.swallowed.iter().chain(both).all(|point| {
            ends(kept, gone)
                .chain(ends(gone, kept))
                .any(|end| is_near(point, end, limit))
        })
    }

    /// Records a collapse. Call it before the mesh changes.
    pub(super) fn collapse(&mut self, mesh: &LiveMesh, kept: u32, gone: u32, target: &Point3<f64>) {
        if let Some(edge) = self.remove(kept, gone) {
            let mut points = edge.swallowed;
            points.extend([kept, gone].map(|vertex| mesh.positions[vertex as usize]));
            self.take_over(kept, gone);
            for point in points {
                let distance =
                    |end: u32| squared_to_segment(&point, target, &mesh.positions[end as usize]);
                let nearest = self
                    .at(kept)
                    .iter()
                    .copied()
                    .min_by(|a, b| distance(*a).total_cmp(&distance(*b)).then(a.cmp(b)));
                if let Some(nearest) = nearest
                    && let Some(edge) = self.edges.get_mut(&key(kept, nearest))
                {
                    edge.swallowed.push(point);
                }
            }
        } else {
            self.take_over(kept, gone);
        }
    }

    /// Moves the edges of the removed vertex to the kept one.
    fn take_over(&mut self, kept: u32, gone: u32) {
        for end in self.at[gone as usize].clone() {
            if let Some(edge) = self.remove(gone, end) {
                self.insert(kept, end, edge);
            }
        }
    }
}
