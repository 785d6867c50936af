//! Borders of polygons: chains of mesh edges between the same neighbours, from node to node.

use linecarve_mesh::for_each_edge;
use nalgebra::Point3;

use crate::label::{Labels, REST};
use crate::plane::{Plane, meet};
use crate::surface::{Surface, unique};

/// Planes that turn by less do not determine where they meet: radians.
pub(crate) const LEAST_TURN: f64 = 10.0 * std::f64::consts::PI / 180.0;

/// Consecutive border edges with the same polygons around them.
#[derive(Debug, Clone)]
pub(crate) struct Chain {
    /// Components of the triangles around each edge, ascending; [`REST`] stands for triangles of no plane.
    pub(crate) around: Vec<u32>,
    /// Vertices in order; of a closed chain without a node the first is also the last.
    pub(crate) vertices: Vec<u32>,
}

impl Chain {
    /// Whether it ends where it begins, without a node.
    pub(crate) fn is_closed(&self) -> bool {
        self.vertices.len() > 2 && self.vertices.first() == self.vertices.last()
    }
}

/// The chains of all borders. `component` is that of each triangle, [`REST`] without a plane.
///
/// # Complexity
/// Linear, where few triangles meet at a vertex.
pub(crate) fn chains(surface: &Surface, component: &[u32]) -> Vec<Chain> {
    let mut edges: Vec<([u32; 2], Vec<u32>)> = Vec::new();
    for_each_edge(&surface.triangles, surface.positions.len(), |ends, uses| {
        let mut around: Vec<u32> = uses.iter().map(|it| component[*it as usize / 3]).collect();
        around.sort_unstable();
        let is_inside = uses.iter().all(|it| {
            let (triangle, edge) = (*it as usize / 3, *it as usize % 3);
            let across = surface.across[triangle][edge];
            across.is_some_and(|it| component[it as usize] == component[triangle])
        });
        if !is_inside && around[0] != REST {
            edges.push((ends, around));
        }
    });
    let mut at_vertex: Vec<(u32, u32)> = Vec::new();
    for (index, (ends, _)) in (0..).zip(&edges) {
        at_vertex.extend(ends.map(|end| (end, index)));
    }
    at_vertex.sort_unstable();
    let around_vertex = |vertex: u32| {
        let start = at_vertex.partition_point(|it| it.0 < vertex);
        let end = at_vertex.partition_point(|it| it.0 <= vertex);
        &at_vertex[start..end]
    };
    let is_node = |vertex: u32| match around_vertex(vertex) {
        [(_, a), (_, b)] => edges[*a as usize].1 != edges[*b as usize].1,
        _ => true,
    };
    let mut is_used = vec![false; edges.len()];
    let mut chains = Vec::new();
    let mut walk = |start: u32, first: u32, is_used: &mut Vec<bool>| {
        let mut vertices = vec![start];
        let mut edge = first;
        loop {
            is_used[edge as usize] = true;
            let [a, b] = edges[edge as usize].0;
            let at = *vertices.last().unwrap_or(&start);
            let next = if a == at { b } else { a };
            vertices.push(next);
            if next == start || is_node(next) {
                break;
            }
            let others = around_vertex(next).iter();
            match others.map(|it| it.1).find(|it| !is_used[*it as usize]) {
                Some(other) => edge = other,
                None => break,
            }
        }
        chains.push(Chain {
            around: edges[first as usize].1.clone(),
            vertices,
        });
    };
    for &(vertex, edge) in &at_vertex {
        if is_node(vertex) && !is_used[edge as usize] {
            walk(vertex, edge, &mut is_used);
        }
    }
    for &(vertex, edge) in &at_vertex {
        if !is_used[edge as usize] {
            walk(vertex, edge, &mut is_used);
        }
    }
    chains
}

/// Where the vertices of planes come to lie: on all planes around them. Where that is too far away, triangles of the plane with the smallest
/// area lose it, until every vertex has a position.
pub(crate) fn place(labels: &mut Labels<'_>) -> Vec<Point3<f64>> {
    let (surface, areas) = (labels.surface, labels.areas());
    let mut positions = surface.positions.clone();
    let mut open: Vec<u32> = (0..positions.len() as u32).collect();
    while !open.is_empty() {
        let mut released: Vec<u32> = Vec::new();
        for &vertex in &open {
            let start = surface.positions[vertex as usize];
            let around = labels.planes_at(vertex);
            let own: Vec<&Plane> = around
                .iter()
                .map(|it| &labels.planes[*it as usize])
                .collect();
            let target = match own.as_slice() {
                [] => start,
                [plane] => plane.project(&start),
                _ => meet(&own, &start, LEAST_TURN),
            };
            let off = own
                .iter()
                .map(|it| it.distance(&target).abs())
                .fold(0.0, f64::max);
            // A vertex of the mesh stands for the surface around it, up to its neighbours.
            let is_far = (target - start).norm() > 2.0 * labels.tolerances.corner();
            if own.len() > 1 && (off > 1e-3 * labels.tolerances.sigma || is_far) {
                let area = |it: &u32| areas[*it as usize];
                let least = around
                    .iter()
                    .rev()
                    .min_by(|a, b| area(a).total_cmp(&area(b)));
                let at = surface.triangles_at(vertex).iter();
                released.extend(at.filter(|it| Some(&labels.of[**it as usize]) == least));
            } else {
                positions[vertex as usize] = target;
            }
        }
        released
            .iter()
            .for_each(|it| labels.of[*it as usize] = REST);
        open = unique(
            released
                .iter()
                .flat_map(|it| surface.triangles[*it as usize]),
        );
    }
    positions
}
