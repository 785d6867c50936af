//! The edges that remain edges: rims, creases, and edges along lines that are known.

use nalgebra::Point3;
use rstar::{AABB, RTree, RTreeObject};
use rustc_hash::FxHashMap;

use super::extent::Limits;
use super::live::{LiveMesh, doubled_area};
use super::options::SimplifyOptions;

/// The edges that remain edges while others collapse.
///
/// Each knows the vertices that it has swallowed, which stay within its tolerance of it.
pub(super) struct Features {
    edges: FxHashMap<(u32, u32), Edge>,
    /// The other ends of such edges at each vertex.
    at: Vec<Vec<u32>>,
}

/// What is known of one.
struct Edge {
    swallowed: Vec<Point3<f64>>,
    /// Whether it is a rim and nothing else, which may move farther.
    is_loose: bool,
}

/// A known line in the tree that finds those near a point.
struct Line([Point3<f64>; 2]);

impl RTreeObject for Line {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        let [a, b] = self.0;
        AABB::from_corners(a.coords.into(), b.coords.into())
    }
}

/// An edge runs along a line when it turns away from it by less than this (15 degrees).
const ALONG_COSINE: f64 = 0.966;

fn key(a: u32, b: u32) -> (u32, u32) {
    (a.min(b), a.max(b))
}

impl Features {
    /// Of a mesh whose edges have been found regular or not.
    pub(super) fn new(
        mesh: &LiveMesh,
        lines: &[[Point3<f64>; 2]],
        options: &SimplifyOptions,
    ) -> Self {
        let finite = lines
            .iter()
            .filter(|line| line.iter().all(|p| p.coords.iter().all(|v| v.is_finite())));
        let tree = RTree::bulk_load(finite.map(|line| Line(*line)).collect());
        let mut features = Self {
            edges: FxHashMap::default(),
            at: vec![Vec::new(); mesh.positions.len()],
        };
        let mut others = Vec::new();
        for vertex in 0..mesh.positions.len() as u32 {
            mesh.neighbors(vertex, &mut others);
            for &other in others.iter().filter(|other| **other > vertex) {
                let kind = kind(mesh, vertex, other, &tree, options);
                if kind != Kind::None {
                    let edge = Edge {
                        swallowed: Vec::new(),
                        is_loose: kind == Kind::Rim,
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
                known.is_loose &= edge.is_loose;
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

    /// Whether an edge is a rim and nothing else.
    pub(super) fn is_loose(&self, a: u32, b: u32) -> bool {
        self.edges.get(&key(a, b)).is_some_and(|edge| edge.is_loose)
    }

    pub(super) fn contains(&self, a: u32, b: u32) -> bool {
        self.edges.contains_key(&key(a, b))
    }

    /// All of them.
    pub(super) fn edges(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        (0..self.at.len() as u32).flat_map(move |a| {
            let ends = self.at[a as usize].iter().copied();
            ends.filter(move |b| *b > a).map(move |b| (a, b))
        })
    }

    /// Whether the edges at `kept` and `gone` stay near what they stand for when both move to a place.
    pub(super) fn allow(
        &self,
        mesh: &LiveMesh,
        kept: u32,
        gone: u32,
        place: &Point3<f64>,
        limits: Limits,
    ) -> bool {
        let squared = |edge: &Edge| {
            let limit = if edge.is_loose {
                limits.beyond
            } else {
                limits.off
            };
            limit * limit
        };
        let position = |vertex: u32| &mesh.positions[vertex as usize];
        let is_near = |point: &Point3<f64>, end: u32, limit: f64| {
            squared_to_segment(point, place, position(end)) <= limit
        };
        let ends = |vertex: u32, other: u32| {
            let ends = self.at(vertex).iter().copied();
            ends.filter(move |end| *end != other)
        };
        // Edges at a vertex that moves must stay near what they have swallowed.
        let follow = |vertex: u32, other: u32| {
            position(vertex) == place
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

    /// Follows a collapse, before the mesh does.
    pub(super) fn collapse(&mut self, mesh: &LiveMesh, kept: u32, gone: u32, place: &Point3<f64>) {
        if let Some(edge) = self.remove(kept, gone) {
            let mut points = edge.swallowed;
            points.extend([kept, gone].map(|vertex| mesh.positions[vertex as usize]));
            self.take_over(kept, gone);
            for point in points {
                let distance =
                    |end: u32| squared_to_segment(&point, place, &mesh.positions[end as usize]);
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

    /// Gives the edges of a vertex that goes to the one that is kept.
    fn take_over(&mut self, kept: u32, gone: u32) {
        for end in self.at[gone as usize].clone() {
            if let Some(edge) = self.remove(gone, end) {
                self.insert(kept, end, edge);
            }
        }
    }
}

/// What an edge is to remain.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    None,
    /// A rim along no known line.
    Rim,
    Fixed,
}

fn kind(mesh: &LiveMesh, a: u32, b: u32, lines: &RTree<Line>, options: &SimplifyOptions) -> Kind {
    let mut sides = mesh.with_edge(a, b);
    let (Some(first), second, None) = (sides.next(), sides.next(), sides.next()) else {
        // Where more than two triangles meet nothing may change.
        return Kind::Fixed;
    };
    let [p, q] = [a, b].map(|vertex| mesh.positions[vertex as usize]);
    let Some(second) = second else {
        return if runs_along(&p, &q, lines, options.line_reach) {
            Kind::Fixed
        } else {
            Kind::Rim
        };
    };
    let [first, second] = [first, second].map(|t| mesh.points(t));
    let along = q - p;
    let areas = [&first, &second].map(doubled_area);
    let least = areas[0].norm().min(areas[1].norm());
    // Triangles thinner than the tolerance turn for no reason.
    if least.is_nan() || least <= options.tolerance * along.norm() {
        return Kind::None;
    }
    let sine = areas[0].cross(&areas[1]).norm();
    let turn = sine.atan2(areas[0].dot(&areas[1]));
    if turn < options.crease_rad.min(options.line_crease_rad) {
        return Kind::None;
    }
    // How far either side stands out of the plane of the other.
    if least / along.norm() * turn.min(std::f64::consts::FRAC_PI_2).sin() < options.tolerance {
        return Kind::None;
    }
    if turn >= options.crease_rad
        || turn >= options.line_crease_rad && runs_along(&p, &q, lines, options.line_reach)
    {
        Kind::Fixed
    } else {
        Kind::None
    }
}

fn runs_along(p: &Point3<f64>, q: &Point3<f64>, lines: &RTree<Line>, reach: f64) -> bool {
    let around = |p: &Point3<f64>, by: f64| -> [f64; 3] { p.coords.map(|v| v + by).into() };
    let near = AABB::from_corners(around(&p.inf(q), -reach), around(&p.sup(q), reach));
    let mut candidates = lines.locate_in_envelope_intersecting(near);
    candidates.any(|Line([a, b])| {
        let (edge, line) = (q - p, b - a);
        edge.dot(&line).abs() >= ALONG_COSINE * edge.norm() * line.norm()
            && [p, q]
                .iter()
                .all(|end| squared_to_segment(end, a, b) <= reach * reach)
    })
}

/// Squared distance of a point from a segment.
fn squared_to_segment(point: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let along = b - a;
    let length = along.norm_squared();
    let t = if length > 0.0 {
        ((point - a).dot(&along) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (point - (a + along * t)).norm_squared()
}
