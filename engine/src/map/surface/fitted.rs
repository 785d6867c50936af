//! Positions of the exported vertices: where depth measured them, then flattened within what the measurements allow, then on the segments along
//! edges and boundaries.
//!
//! All steps are local. A vertex is fitted when it comes, moves, or is observed again; positions are smoothed again within
//! [`SmoothOptions::reach`] of what changed, and move onto segments again within [`SNAP_REACH`] of that.

use linecarve_carving::{Face, IncrementalMesh, MeshChange, VertexId, VertexOrigin};
use linecarve_mesh::{SNAP_REACH, SmoothOptions, smooth_piecewise_flat, snap_to_segments};
use nalgebra::Point3;
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::VertexSource;

/// Where depth measured a vertex.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::map) struct FittedVertex {
    pub(in crate::map) position: Point3<f64>,
    /// How far it may move where the surface is smoothed.
    pub(in crate::map) bound: f64,
    /// Number of views that measured a surface there.
    pub(in crate::map) views: usize,
}

/// The vertices that views may have measured since the last change.
pub(super) enum Seen<'a> {
    /// These, by the newest view.
    InView(&'a [VertexId]),
    /// All, by any view.
    All,
}

/// Most views whose planes a vertex is fitted to. The mean of more changes little.
const MOST_VIEWS: usize = 48;

/// To how many of the views that measured it a vertex is fitted: the largest of 1, 2, 3, 4, 6, 8, 12 ... that is not above their number. A vertex
/// that is measured again and again is fitted seldom.
pub(in crate::map) fn used_views(measured: usize) -> usize {
    let measured = measured.min(MOST_VIEWS);
    let power = measured.checked_ilog2().map_or(0, |log| 1 << log);
    match power + power / 2 {
        between if between <= measured => between,
        _ => power,
    }
}

/// The positions of the vertices of an [`IncrementalMesh`], by their numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct FittedPositions {
    fitted: Vec<FittedVertex>,
    smooth: Vec<Point3<f64>>,
    /// Where they lie after moving onto segments.
    positions: Vec<Point3<f64>>,
    /// The faces at each vertex.
    faces: Vec<Vec<Face>>,
    options: SmoothOptions,
    /// Reused memory: marks of vertices, [`NONE`] without one.
    marks: Vec<u32>,
}

/// A vertex without a mark.
const NONE: u32 = u32::MAX;

/// A vertex that is measured again moves by at least this share of its bound, or not before the surface is finished: smaller moves are not worth
/// the smoothing around them.
const SETTLING_SHARE: f64 = 0.2;

impl FittedPositions {
    /// The position of a vertex.
    ///
    /// # Panics
    /// For numbers that were never given out.
    pub(super) fn position(&self, number: u32) -> Point3<f64> {
        self.positions[number as usize]
    }

    /// Follows a change of `mesh`, and adds to it the vertices and faces that move.
    ///
    /// # Complexity
    /// The changed vertices, and the faces within the reach of the smoothing around them.
    pub(super) fn follow(
        &mut self,
        mesh: &IncrementalMesh,
        change: &mut MeshChange,
        seen: Seen<'_>,
        source: &impl VertexSource,
    ) {
        self.follow_faces(mesh.vertex_capacity(), change);
        let mut stale = change.placed.clone();
        match seen {
            Seen::All => {
                let numbers = 0..mesh.vertex_capacity() as u32;
                stale.extend(numbers.filter(|number| mesh.is_vertex(*number)));
            }
            Seen::InView(vertices) => {
                let numbers = vertices.iter().flat_map(|vertex| mesh.copies(*vertex));
                let numbers: Vec<u32> = numbers
                    .filter(|it| change.placed.binary_search(it).is_err())
                    .collect();
                let measured = numbers.into_par_iter().filter(|number| {
                    let origin = mesh.origin(*number);
                    origin.is_some_and(|origin| source.is_measured_by_newest(origin))
                });
                for number in measured.collect::<Vec<u32>>() {
                    let views = &mut self.fitted[number as usize].views;
                    *views += 1;
                    if used_views(*views) == *views {
                        stale.push(number);
                    }
                }
            }
        }
        stale.sort_unstable();
        stale.dedup();
        let fit_number = |number: &u32| self.fit(mesh, *number, source);
        let fitted: Vec<FittedVertex> = stale.par_iter().map(fit_number).collect();
        // Segments near vertices that are measured again may be others as well.
        let mut near_segments: Vec<u32> = stale.clone();
        let mut seeds: Vec<u32> = change.placed.clone();
        for (number, fitted) in stale.into_iter().zip(fitted) {
            let before = &mut self.fitted[number as usize];
            let is_settled = matches!(seen, Seen::InView(_))
                && change.placed.binary_search(&number).is_err()
                && (fitted.position - before.position).norm() <= SETTLING_SHARE * before.bound;
            if is_settled {
                before.views = fitted.views;
                continue;
            }
            if (before.position, before.bound) != (fitted.position, fitted.bound) {
                seeds.push(number);
            }
            *before = fitted;
        }
        let faces = change.added.iter().chain(&change.removed);
        seeds.extend(faces.flatten());
        seeds.retain(|number| mesh.is_vertex(*number));
        near_segments.extend(&seeds);
        near_segments.extend(self.smooth_around(mesh, seeds));
        let moved = self.snap_around(mesh, near_segments, source);
        self.add_moved(change, &moved);
    }

    /// Follows which faces there are.
    fn follow_faces(&mut self, capacity: usize, change: &MeshChange) {
        let none = FittedVertex {
            position: Point3::origin(),
            bound: 0.0,
            views: 0,
        };
        self.fitted.resize(capacity, none);
        self.smooth.resize(capacity, Point3::origin());
        self.positions.resize(capacity, Point3::origin());
        self.faces.resize(capacity, Vec::new());
        self.marks.resize(capacity, NONE);
        for face in &change.removed {
            for corner in face {
                self.faces[*corner as usize].retain(|other| other != face);
            }
        }
        for face in &change.added {
            for corner in face {
                self.faces[*corner as usize].push(*face);
            }
        }
    }

    /// Copies of one vertex, at which sheets of the surface touch, stay together: they are not smoothed.
    fn fit(&self, mesh: &IncrementalMesh, number: u32, source: &impl VertexSource) -> FittedVertex {
        let VertexOrigin::Vertex(origin) = mesh.vertex_origin(number) else {
            return fit_between(mesh.vertex_origin(number), &mesh.position(number), source);
        };
        let fitted = source.fit(origin);
        match mesh.copies(origin).nth(1) {
            Some(_) => FittedVertex {
                bound: 0.0,
                ..fitted
            },
            None => fitted,
        }
    }

    /// Smooths the surface around vertices; returns the vertices that moved.
    fn smooth_around(&mut self, mesh: &IncrementalMesh, seeds: Vec<u32>) -> Vec<u32> {
        let (part, affected) = self.grown(seeds, self.options.reach());
        let part = self.in_order(mesh, part);
        let triangles = self.mark(&part);
        let fitted = |number: &u32| self.fitted[*number as usize];
        let positions: Vec<Point3<f64>> = part.iter().map(|it| fitted(it).position).collect();
        let bounds: Vec<f64> = part.iter().map(|it| fitted(it).bound).collect();
        let smooth = smooth_piecewise_flat(&positions, &triangles, &bounds, &self.options);
        let moved = replaced(&mut self.smooth, affected, &smooth, &self.marks);
        self.unmark(part);
        moved
    }

    /// Moves the vertices around others onto segments; returns the vertices that moved.
    fn snap_around(
        &mut self,
        mesh: &IncrementalMesh,
        seeds: Vec<u32>,
        source: &impl VertexSource,
    ) -> Vec<u32> {
        let (part, affected) = self.grown(seeds, SNAP_REACH);
        let part = self.in_order(mesh, part);
        let triangles = self.mark(&part);
        let smooth: Vec<Point3<f64>> = part.iter().map(|it| self.smooth[*it as usize]).collect();
        // Copies of one vertex stay together.
        let is_free = |place: usize| match mesh.vertex_origin(part[place]) {
            VertexOrigin::Vertex(origin) => mesh.copies(origin).nth(1).is_none(),
            VertexOrigin::Inside { .. } => true,
            VertexOrigin::Middle => false,
        };
        let positions = snap(&smooth, &triangles, is_free, source);
        let moved = replaced(&mut self.positions, affected, &positions, &self.marks);
        self.unmark(part);
        moved
    }

    /// The vertices with which a vertex has faces.
    pub(super) fn neighbors(&self, number: u32) -> impl Iterator<Item = u32> + '_ {
        self.faces[number as usize].iter().flatten().copied()
    }

    /// Marks the vertices of a part with their places in it; returns its triangles by those places, in order.
    fn mark(&mut self, part: &[u32]) -> Vec<[u32; 3]> {
        for (place, number) in (0..).zip(part) {
            self.marks[*number as usize] = place;
        }
        let place = |corner: u32| self.marks[corner as usize];
        let mut triangles: Vec<[u32; 3]> = Vec::new();
        for number in part {
            for face in &self.faces[*number as usize] {
                let places = face.map(place);
                // Each face of which all corners are in the part, once.
                if !places.contains(&NONE) && places.iter().min() == Some(&place(*number)) {
                    triangles.push(first_corner_first(places));
                }
            }
        }
        triangles.sort_unstable();
        triangles
    }

    fn unmark(&mut self, part: Vec<u32>) {
        for number in part {
            self.marks[number as usize] = NONE;
        }
    }

    /// Vertices in an order that does not depend on the history of their numbers: that of carved positions, those inside triangles after others,
    /// midpoints last. Copies of a vertex differ in their faces.
    fn in_order(&self, mesh: &IncrementalMesh, vertices: Vec<u32>) -> Vec<u32> {
        let key = |number: &u32| {
            let position = ordered(&mesh.position(*number));
            let class = match mesh.vertex_origin(*number) {
                VertexOrigin::Vertex(_) => 0,
                VertexOrigin::Inside { .. } => 1,
                VertexOrigin::Middle => 2,
            };
            (class, position)
        };
        let first_face = |number: &u32| {
            let faces = self.faces[*number as usize].iter();
            let keys = faces.map(|face| first_corner_first(face.map(|corner| key(&corner))));
            keys.min()
        };
        let mut keyed: Vec<_> = vertices.into_iter().map(|it| (key(&it), it)).collect();
        keyed.sort_unstable_by_key(|(key, _)| *key);
        for copies in keyed.chunk_by_mut(|a, b| a.0 == b.0) {
            if copies.len() > 1 {
                copies.sort_by_cached_key(|(_, number)| first_face(number));
            }
        }
        keyed.into_iter().map(|(_, number)| number).collect()
    }

    /// Vertices with all that are at most twice as many `rings` faces away, and those of them that are at most `rings` faces away; in no particular
    /// order.
    fn grown(&mut self, vertices: Vec<u32>, rings: usize) -> (Vec<u32>, Vec<u32>) {
        let mut grown: Vec<u32> = Vec::with_capacity(vertices.len());
        let insert = |marks: &mut [u32], grown: &mut Vec<u32>, number: u32| {
            if marks[number as usize] == NONE {
                marks[number as usize] = 0;
                grown.push(number);
            }
        };
        for number in vertices {
            insert(&mut self.marks, &mut grown, number);
        }
        let (mut first, mut near) = (0, grown.len());
        for ring in 0..2 * rings {
            let end = grown.len();
            for at in first..end {
                for corner in self.faces[grown[at] as usize].iter().flatten() {
                    insert(&mut self.marks, &mut grown, *corner);
                }
            }
            first = end;
            if ring + 1 == rings {
                near = grown.len();
            }
        }
        for number in &grown {
            self.marks[*number as usize] = NONE;
        }
        let affected = grown[..near].to_vec();
        (grown, affected)
    }

    /// Adds vertices that moved to a change, with their faces.
    fn add_moved(&self, change: &mut MeshChange, moved: &[u32]) {
        change.placed.extend(moved);
        change.placed.sort_unstable();
        change.placed.dedup();
        let faces = moved
            .iter()
            .flat_map(|number| &self.faces[*number as usize]);
        let stayed = faces.filter(|face| change.added.binary_search(face).is_err());
        change.reshaped.extend(stayed);
        change.reshaped.sort_unstable();
        change.reshaped.dedup();
    }
}

/// The positions of a whole mesh, in the order of [`MapSurface::to_mesh`](super::MapSurface::to_mesh): `origins` are the vertices of the
/// tetrahedralisation that its vertices copy.
pub(in crate::map) fn fitted_positions(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    origins: &[VertexOrigin<VertexId>],
    source: &impl VertexSource,
) -> Vec<Point3<f64>> {
    let mut copies: FxHashMap<VertexId, u32> = FxHashMap::default();
    for origin in origins.iter().filter_map(|origin| origin.vertex()) {
        *copies.entry(origin).or_default() += 1;
    }
    let fitted = positions.iter().zip(origins).map(|(position, origin)| {
        let VertexOrigin::Vertex(origin) = origin else {
            let fitted = fit_between(*origin, position, source);
            return (fitted.position, fitted.bound);
        };
        let fitted = source.fit(*origin);
        let bound = if copies[origin] == 1 {
            fitted.bound
        } else {
            0.0
        };
        (fitted.position, bound)
    });
    let (fitted, bounds): (Vec<_>, Vec<_>) = fitted.unzip();
    let smooth = smooth_piecewise_flat(&fitted, triangles, &bounds, &SmoothOptions::default());
    let is_free = |vertex: usize| match origins[vertex] {
        VertexOrigin::Vertex(origin) => copies[&origin] == 1,
        VertexOrigin::Inside { .. } => true,
        VertexOrigin::Middle => false,
    };
    snap(&smooth, triangles, is_free, source)
}

/// A vertex that copies none: inside a triangle it lies between the corners where depth measured these, and moves no further than they do.
fn fit_between(
    origin: VertexOrigin<VertexId>,
    carved: &Point3<f64>,
    source: &impl VertexSource,
) -> FittedVertex {
    let VertexOrigin::Inside { corners, part } = origin else {
        return FittedVertex {
            position: *carved,
            bound: 0.0,
            views: 0,
        };
    };
    let corners = corners.map(|corner| source.fit(corner));
    let bounds = corners.iter().map(|corner| corner.bound);
    FittedVertex {
        position: part.point(&corners.map(|corner| corner.position)),
        bound: bounds.fold(f64::INFINITY, f64::min),
        views: 0,
    }
}

/// Moves vertices on edges and boundaries onto the segments of a source.
fn snap(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    is_free: impl Fn(usize) -> bool + Sync,
    source: &impl VertexSource,
) -> Vec<Point3<f64>> {
    let reach = source.segment_reach();
    snap_to_segments(positions, triangles, reach, is_free, |position, visit| {
        source.visit_segments(position, visit);
    })
}

/// Gives these vertices the positions of a part of the surface, in which they have the places of `marks`; returns those that had other ones.
fn replaced(
    positions: &mut [Point3<f64>],
    vertices: Vec<u32>,
    part: &[Point3<f64>],
    marks: &[u32],
) -> Vec<u32> {
    let is_replaced = |number: &u32| {
        let position = part[marks[*number as usize] as usize];
        std::mem::replace(&mut positions[*number as usize], position) != position
    };
    let mut replaced = vertices;
    replaced.retain(is_replaced);
    replaced
}

/// A total order of positions.
fn ordered(position: &Point3<f64>) -> [i64; 3] {
    <[f64; 3]>::from(position.coords).map(|it| {
        let bits = it.to_bits() as i64;
        bits ^ (((bits >> 63) as u64) >> 1) as i64
    })
}

/// The corners of a triangle from the smallest on, in their order.
fn first_corner_first<T: Ord + Copy>([a, b, c]: [T; 3]) -> [T; 3] {
    match a.min(b).min(c) {
        least if least == a => [a, b, c],
        least if least == b => [b, c, a],
        _ => [c, a, b],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fewer_views_are_used_than_measured() {
        let expected = [
            (0, 0),
            (1, 1),
            (2, 2),
            (3, 3),
            (4, 4),
            (5, 4),
            (6, 6),
            (7, 6),
            (8, 8),
            (11, 8),
            (12, 12),
            (47, 32),
            (48, 48),
            (500, 48),
        ];
        for (measured, used) in expected {
            assert_eq!(used_views(measured), used, "{measured}");
        }
    }

    #[test]
    fn positions_have_a_total_order() {
        let at = |x: f64| ordered(&Point3::new(x, 0.0, 0.0));
        let ascending = [f64::NEG_INFINITY, -2.0, -1e-9, -0.0, 0.0, 1e-9, 2.0].map(at);
        assert!(ascending.is_sorted() && ascending[1] < ascending[2]);
    }
}
