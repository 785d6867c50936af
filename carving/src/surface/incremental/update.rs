//! Follows the changes of the carved surface.

use nalgebra::Point3;
use rustc_hash::{FxHashMap, FxHashSet};

use super::super::delta::{SurfaceDelta, Triangle};
use super::super::part::TrianglePart;
use super::components::ComponentSearch;
use super::locate::{Carved, Located};
use super::splits::EdgeGroup;
use super::splits::{Split, first_corner};
use super::surroundings::Surroundings;
use super::{IncrementalMesh, NONE, Record, TriangleRole};
use crate::tetrahedralization::VertexId;

impl IncrementalMesh {
    /// See [`Carver::update_mesh`](crate::Carver::update_mesh).
    pub(crate) fn update(
        &mut self,
        carved: Carved<'_>,
        deltas: &[SurfaceDelta],
        touched: &[Triangle],
        role: impl Fn(&Triangle) -> TriangleRole,
    ) {
        let mut update = Update::new(self, carved);
        let mut candidates = touched.to_vec();
        update.apply(deltas, &mut candidates);
        update.visit_moved(&mut candidates);
        let mut changed = update.evaluate(candidates, role);
        update.settle_components(&mut changed);
        update.withdraw(changed);
        let dirty = update.sort_dirty();
        for &vertex in &dirty {
            update.settle_fans(vertex);
        }
        update.place_copies(&dirty);
        update.settle_edges();
        update.rebuild_faces();
        update.reshape_faces();
        update.free_vertices();
    }
}

/// An update under way.
pub(super) struct Update<'a> {
    pub(super) mesh: &'a mut IncrementalMesh,
    pub(super) carved: Carved<'a>,
    pub(super) surroundings: Surroundings,
    /// Reused memory: the triangles around a vertex, and their fans.
    pub(super) around: Vec<Located>,
    pub(super) fans: Vec<usize>,
    /// Vertices around which fans are looked at anew; sorted for [`is_dirty`](Self::is_dirty).
    dirty: Vec<VertexId>,
    moved: Vec<VertexId>,
    /// The edges at them.
    pub(super) edges: Vec<EdgeGroup>,
    /// Midpoints that have their edge.
    pub(super) taken: FxHashSet<u32>,
    /// Triangles whose faces have to be made anew.
    pub(super) stale: Vec<Triangle>,
    /// Triangles with a corner or midpoint that may be at another position.
    pub(super) reshaped: Vec<Triangle>,
    placed: FxHashSet<u32>,
    unused: Vec<u32>,
}

impl<'a> Update<'a> {
    fn new(mesh: &'a mut IncrementalMesh, carved: Carved<'a>) -> Self {
        Self {
            mesh,
            carved,
            surroundings: Surroundings::default(),
            around: Vec::new(),
            fans: Vec::new(),
            dirty: Vec::new(),
            moved: Vec::new(),
            edges: Vec::new(),
            taken: FxHashSet::default(),
            stale: Vec::new(),
            reshaped: Vec::new(),
            placed: FxHashSet::default(),
            unused: Vec::new(),
        }
    }

    /// Whether fans are looked at anew around a vertex.
    pub(super) fn is_dirty(&self, vertex: VertexId) -> bool {
        self.dirty.binary_search(&vertex).is_ok()
    }

    fn sort_dirty(&mut self) -> Vec<VertexId> {
        self.dirty.sort_unstable();
        self.dirty.dedup();
        self.dirty.clone()
    }

    /// Takes over which triangles there are. Those that went and came back keep what is known about them.
    fn apply(&mut self, deltas: &[SurfaceDelta], candidates: &mut Vec<Triangle>) {
        let records = &mut self.mesh.records;
        let mut gone: FxHashMap<Triangle, Record> = FxHashMap::default();
        for delta in deltas {
            for triangle in &delta.removed {
                if let Some(record) = records.remove(triangle) {
                    gone.insert(*triangle, record);
                }
            }
            for triangle in &delta.added {
                let record = gone.remove(triangle).unwrap_or_default();
                records.insert(*triangle, record);
            }
            let changed = delta.added.iter().chain(&delta.removed);
            self.dirty.extend(changed.flatten());
            self.dirty.extend(&delta.border);
            self.moved.extend(&delta.moved);
            candidates.extend(&delta.added);
        }
        let mut gone: Vec<(Triangle, Record)> = gone.into_iter().collect();
        gone.sort_unstable_by_key(|(triangle, _)| *triangle);
        for (triangle, record) in gone {
            self.remove_faces(&triangle, record.face);
            self.mesh.repeated.remove(&triangle);
        }
    }

    /// Triangles at vertices that moved may be exported differently, and edges there be split differently.
    fn visit_moved(&mut self, candidates: &mut Vec<Triangle>) {
        self.moved.sort_unstable();
        self.moved.dedup();
        let mut around = std::mem::take(&mut self.around);
        for &vertex in &self.moved {
            self.surroundings.list(self.carved, vertex, &mut around);
            for located in &around {
                candidates.push(located.corners);
                if self.mesh.repeated.contains(&located.corners) {
                    self.dirty.extend(&located.corners);
                }
            }
        }
        self.around = around;
    }

    /// Asks for the roles of triangles; returns those with another one than before.
    fn evaluate(
        &mut self,
        mut candidates: Vec<Triangle>,
        role: impl Fn(&Triangle) -> TriangleRole,
    ) -> Vec<Triangle> {
        candidates.sort_unstable();
        candidates.dedup();
        let joins = self.mesh.joins;
        let dirty = &mut self.dirty;
        let records = &mut self.mesh.records;
        candidates.retain(|triangle| {
            let Some(record) = records.get_mut(triangle) else {
                return false;
            };
            let now = role(triangle);
            let before = std::mem::replace(&mut record.role, now);
            let is_counted = |role| role != TriangleRole::Ignored;
            if is_counted(before) != is_counted(now) || (joins && before != now) {
                dirty.extend(triangle);
            }
            before != now
        });
        candidates
    }

    /// Decides the components and the gaps of triangles that may have other neighbours than before.
    fn settle_components(&mut self, changed: &mut Vec<Triangle>) {
        let dirty = self.sort_dirty();
        let (minimum, fills_gaps) = (self.mesh.minimum_component, self.mesh.fills_gaps);
        let joins = self.mesh.joins;
        let mut search = ComponentSearch::new(self.carved, minimum, &mut self.mesh.records);
        for vertex in dirty {
            let around = &mut self.around;
            self.surroundings.list(self.carved, vertex, around);
            for located in around {
                search.settle(*located, changed);
                if joins {
                    search.settle_joints(located, fills_gaps, changed);
                }
            }
        }
    }

    /// Withdraws the changed triangles that are not exported any more.
    fn withdraw(&mut self, mut changed: Vec<Triangle>) {
        changed.sort_unstable();
        changed.dedup();
        for triangle in changed {
            self.dirty.extend(&triangle);
            let Some(record) = self.mesh.records.get_mut(&triangle) else {
                continue;
            };
            if record.exported().is_exported() {
                self.stale.push(triangle);
            } else {
                record.corners = [NONE; 3];
                let face = std::mem::replace(&mut record.face, NONE);
                self.remove_faces(&triangle, face);
            }
        }
    }

    /// Removes the faces of a triangle, `face` or those of a split one.
    fn remove_faces(&mut self, triangle: &Triangle, face: u32) {
        let split = self.mesh.splits.remove(triangle);
        let mesh = &mut *self.mesh;
        let split = split.map_or_else(Vec::new, |split| split.faces);
        for face in split.into_iter().chain((face != NONE).then_some(face)) {
            let unused = &mut self.unused;
            (mesh.faces).remove(face, &mut mesh.vertices, unused, &mut mesh.log);
        }
    }

    /// Adds a copy of a vertex.
    pub(super) fn add_vertex(&mut self, origin: Option<VertexId>) -> u32 {
        let position = origin.map_or_else(Point3::origin, |v| self.carved.tetrahedra.position(v));
        let number = self.mesh.vertices.add(position, origin);
        self.mesh.log.place(number);
        number
    }

    /// Moves a vertex of the mesh.
    pub(super) fn place(&mut self, number: u32, position: Point3<f64>) {
        if self.mesh.vertices.place(number, position) {
            self.mesh.log.place(number);
            self.placed.insert(number);
        }
    }

    /// Moves the copies of vertices to where these are.
    fn place_copies(&mut self, dirty: &[VertexId]) {
        let moved = std::mem::take(&mut self.moved);
        let mut around = std::mem::take(&mut self.around);
        let mut copies = Vec::new();
        for &vertex in moved.iter().chain(dirty) {
            if !self.carved.tetrahedra.is_vertex(vertex) {
                continue;
            }
            let position = self.carved.tetrahedra.position(vertex);
            let before = self.placed.len();
            copies.clear();
            copies.extend(self.mesh.vertices.copies(vertex));
            for &copy in &copies {
                self.place(copy, position);
            }
            let is_placed = self.placed.len() > before;
            if is_placed || !self.mesh.inside.is_empty() {
                self.surroundings.list(self.carved, vertex, &mut around);
                let corners = || around.iter().map(|it| it.corners);
                self.reshaped.extend(corners().filter(|_| is_placed));
                // The points inside triangles move with all their corners.
                let splits = &self.mesh.splits;
                let has_point = |it: &Triangle| splits.get(it).is_some_and(Split::has_point);
                self.stale.extend(corners().filter(has_point));
            }
        }
        self.around = around;
    }

    /// Moves the vertex inside a triangle of which a part is exported, or makes it if there is none yet; returns its number.
    fn place_inside(&mut self, triangle: &Triangle, part: &TrianglePart, known: u32) -> u32 {
        let position = part.point(&triangle.map(|v| self.carved.tetrahedra.position(v)));
        if known == NONE {
            let number = self.add_midpoint(position);
            self.mesh.inside.insert(number, *triangle);
            return number;
        }
        self.place(known, position);
        // What it is made of may have changed where it did not move.
        self.mesh.log.place(known);
        known
    }

    /// Makes the faces of stale triangles anew.
    fn rebuild_faces(&mut self) {
        let mut stale = std::mem::take(&mut self.stale);
        stale.sort_unstable();
        stale.dedup();
        // Old faces go before new ones come, so that their numbers are used again. For each triangle the end of its pieces.
        let mut pieces: Vec<[u32; 3]> = Vec::new();
        let mut fresh: Vec<(Triangle, usize)> = Vec::with_capacity(stale.len());
        for triangle in stale {
            let Some(record) = self.mesh.records.get_mut(&triangle) else {
                continue;
            };
            let exported = record.exported();
            if !exported.is_exported() {
                continue;
            }
            let (corners, part) = (record.corners, exported.part());
            let old = std::mem::replace(&mut record.face, NONE);
            let split = self.mesh.splits.get(&triangle);
            let mut split = split.map_or_else(Split::default, Split::without_faces);
            self.remove_faces(&triangle, old);
            split.first = first_corner(self.carved.tetrahedra, &triangle);
            split.inside = match part {
                Some(part) => self.place_inside(&triangle, &part, split.inside),
                None => NONE,
            };
            split.append_pieces(
                self.carved.tetrahedra,
                &triangle,
                corners,
                part,
                &mut pieces,
            );
            if split.midpoints != [NONE; 3] || split.inside != NONE {
                self.mesh.splits.insert(triangle, split);
            }
            fresh.push((triangle, pieces.len()));
        }
        let mut begin = 0;
        for (triangle, end) in fresh {
            let mesh = &mut *self.mesh;
            let mut add =
                |piece: &[u32; 3]| mesh.faces.add(*piece, &mut mesh.vertices, &mut mesh.log);
            let pieces = &pieces[std::mem::replace(&mut begin, end)..end];
            if let Some(split) = mesh.splits.get_mut(&triangle) {
                split.faces.extend(pieces.iter().map(add));
            } else if let Some(record) = mesh.records.get_mut(&triangle) {
                record.face = pieces.first().map_or(NONE, &mut add);
            }
        }
    }

    /// Lists the faces that stayed while a corner moved.
    fn reshape_faces(&mut self) {
        let mesh = &mut *self.mesh;
        for triangle in &self.reshaped {
            let record = mesh.records.get(triangle);
            let face = record
                .map(|record| record.face)
                .filter(|face| *face != NONE);
            let split = mesh.splits.get(triangle).map(|split| &split.faces);
            for face in split.into_iter().flatten().copied().chain(face) {
                let corners = mesh.faces.corners(face);
                if corners.iter().any(|corner| self.placed.contains(corner)) {
                    mesh.log.reshape(corners);
                }
            }
        }
    }

    /// Frees the vertices that no face uses any more.
    fn free_vertices(&mut self) {
        let mut unused = std::mem::take(&mut self.unused);
        unused.sort_unstable();
        unused.dedup();
        for number in unused {
            if !self.mesh.vertices.is_vertex(number) {
                self.mesh.inside.remove(&number);
                self.mesh.vertices.free(number);
                self.mesh.log.free(number);
            }
        }
    }
}
