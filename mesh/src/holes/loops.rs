//! Closed loops of boundary edges.

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

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
    // `None` for an edge that several triangles have in the same direction.
    let mut opposites: FxHashMap<[u32; 2], Option<u32>> = FxHashMap::default();
    for &[a, b, c] in triangles {
        for (ends, opposite) in [([a, b], c), ([b, c], a), ([c, a], b)] {
            let known = opposites.entry(ends);
            known
                .and_modify(|opposite| *opposite = None)
                .or_insert(Some(opposite));
        }
    }
    // The edge that leaves each boundary vertex; `None` when there are several.
    let mut leaving: BTreeMap<u32, Option<BoundaryEdge>> = BTreeMap::new();
    for (&[a, b], &opposite) in &opposites {
        if !opposites.contains_key(&[b, a]) {
            let edge = opposite.map(|opposite| BoundaryEdge {
                ends: [a, b],
                opposite,
            });
            let known = leaving.entry(a);
            known.and_modify(|edge| *edge = None).or_insert(edge);
        }
    }
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
