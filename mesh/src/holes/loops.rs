//! Closed loops of boundary edges.

use std::collections::BTreeMap;

use crate::edge_uses::for_each_edge;

/// An edge in the direction in which its triangle has it, and the third corner of the triangle; one of its ends where it has no triangle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct BoundaryEdge {
    pub(super) ends: [u32; 2],
    pub(super) opposite: u32,
}

/// The loops of boundary edges, each from its smallest vertex, in the order of these. A loop runs as its triangles do: the hole lies to
/// its right. Left out are loops through a vertex with several boundary edges that leave it, and through
/// an edge that several triangles have in the same direction.
pub(super) fn boundary_loops(triangles: &[[u32; 3]]) -> Vec<Vec<BoundaryEdge>> {
    // The edge that leaves each boundary vertex; `None` when there are several.
    let mut leaving: BTreeMap<u32, Option<BoundaryEdge>> = BTreeMap::new();
    let vertices = triangles.iter().flatten().max().map_or(0, |last| last + 1);
    for_each_edge(triangles, vertices as usize, |_, uses| {
        let edge = |corner: u32| {
            let triangle = triangles[corner as usize / 3];
            let [from, to, opposite] = [0, 1, 2].map(|next| triangle[(corner as usize + next) % 3]);
            BoundaryEdge {
                ends: [from, to],
                opposite,
            }
        };
        let first = edge(uses[0]);
        if uses.iter().all(|corner| edge(*corner).ends == first.ends) {
            let alone = (uses.len() == 1).then_some(first);
            let known = leaving.entry(first.ends[0]);
            known.and_modify(|edge| *edge = None).or_insert(alone);
        }
    });
    let mut loops = Vec::new();
    while let Some((start, first)) = leaving.pop_first() {
        let mut edges: Vec<BoundaryEdge> = Vec::new();
        let mut next = first;
        while let Some(edge) = next {
            edges.push(edge);
            if edge.ends[1] == start {
                break;
            }
            next = leaving.remove(&edge.ends[1]).flatten();
        }
        if edges.last().is_some_and(|last| last.ends[1] == start) {
            loops.push(edges);
        }
    }
    loops
}
