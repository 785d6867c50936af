//! The table of segments seen by views.

use rustc_hash::FxHashMap;

use super::super::{ObservationId, ObservationTable};

/// One segment seen by one view.
#[derive(Clone, Copy, Debug)]
pub(super) struct VisibilityTriangle {
    pub(super) view: u32,
    /// The points at its ends, the smaller id first.
    points: [u32; 2],
    /// Their vertices.
    pub(super) vertices: [u32; 2],
    pub(super) weight: u32,
    /// Standard deviations of the ends along the rays to them.
    pub(super) sigmas: [Option<f64>; 2],
    /// Whether it may touch a cell in a special position; then it is searched for over its full extent whenever one of
    /// the cells that list it changes.
    pub(super) is_degenerate: bool,
}

/// Visibility triangles by id, view and end.
#[derive(Clone, Debug, Default)]
pub(crate) struct VisibilityTriangles {
    records: Vec<Option<VisibilityTriangle>>,
    free: Vec<u32>,
    ids: FxHashMap<(u32, [u32; 2]), u32>,
    of_point: Vec<Vec<u32>>,
    of_view: Vec<Vec<u32>>,
}

fn entry(lists: &mut Vec<Vec<u32>>, index: u32) -> &mut Vec<u32> {
    if lists.len() <= index as usize {
        lists.resize(index as usize + 1, Vec::new());
    }
    &mut lists[index as usize]
}

fn delete(lists: &mut [Vec<u32>], index: u32, id: u32) {
    let list = &mut lists[index as usize];
    if let Some(position) = list.iter().position(|&other| other == id) {
        list.swap_remove(position);
    }
}

impl VisibilityTriangles {
    /// Length of an array indexed by id.
    pub(super) fn capacity(&self) -> usize {
        self.records.len()
    }

    pub(super) fn get(&self, id: ObservationId) -> &VisibilityTriangle {
        self.records[id.0 as usize]
            .as_ref()
            .expect("lists hold ids in use only")
    }

    fn get_mut(&mut self, id: ObservationId) -> &mut VisibilityTriangle {
        self.records[id.0 as usize]
            .as_mut()
            .expect("lists hold ids in use only")
    }

    pub(super) fn set_degenerate(&mut self, id: ObservationId, is_degenerate: bool) {
        self.get_mut(id).is_degenerate = is_degenerate;
    }

    /// Whether an id is in use.
    pub(super) fn is_in_use(&self, id: ObservationId) -> bool {
        matches!(self.records.get(id.0 as usize), Some(Some(_)))
    }
}

impl ObservationTable<2> for VisibilityTriangles {
    fn len(&self) -> usize {
        self.records.len() - self.free.len()
    }

    /// All segments, by id.
    fn all(&self) -> impl Iterator<Item = ObservationId> + '_ {
        (0..self.records.len() as u32)
            .filter(|&id| self.records[id as usize].is_some())
            .map(ObservationId)
    }

    fn of_point(&self, point: u32) -> impl Iterator<Item = ObservationId> + '_ {
        let list = self.of_point.get(point as usize);
        list.into_iter().flatten().copied().map(ObservationId)
    }

    fn of_view(&self, view: u32) -> impl Iterator<Item = ObservationId> + '_ {
        let list = self.of_view.get(view as usize);
        list.into_iter().flatten().copied().map(ObservationId)
    }

    fn find(&self, view: u32, points: [u32; 2]) -> Option<ObservationId> {
        self.ids.get(&(view, points)).copied().map(ObservationId)
    }

    fn view(&self, id: ObservationId) -> u32 {
        self.get(id).view
    }

    fn points(&self, id: ObservationId) -> [u32; 2] {
        self.get(id).points
    }

    fn vertices(&self, id: ObservationId) -> [u32; 2] {
        self.get(id).vertices
    }

    fn sigmas(&self, id: ObservationId) -> [Option<f64>; 2] {
        self.get(id).sigmas
    }

    fn weight(&self, id: ObservationId) -> u32 {
        self.get(id).weight
    }

    fn insert(&mut self, view: u32, points: [u32; 2], weight: u32) -> ObservationId {
        let record = Some(VisibilityTriangle {
            view,
            points,
            vertices: [u32::MAX; 2],
            weight,
            sigmas: [None; 2],
            is_degenerate: false,
        });
        let id = if let Some(slot) = self.free.pop() {
            self.records[slot as usize] = record;
            slot
        } else {
            self.records.push(record);
            (self.records.len() - 1) as u32
        };
        self.ids.insert((view, points), id);
        for point in points {
            entry(&mut self.of_point, point).push(id);
        }
        entry(&mut self.of_view, view).push(id);
        ObservationId(id)
    }

    fn remove(&mut self, id: ObservationId) {
        let Some(VisibilityTriangle { view, points, .. }) = self.records[id.0 as usize].take()
        else {
            return;
        };
        self.ids.remove(&(view, points));
        for point in points {
            delete(&mut self.of_point, point, id.0);
        }
        delete(&mut self.of_view, view, id.0);
        self.free.push(id.0);
    }

    fn set_ends(&mut self, id: ObservationId, vertices: [u32; 2], sigmas: [Option<f64>; 2]) {
        let record = self.get_mut(id);
        (record.vertices, record.sigmas) = (vertices, sigmas);
    }

    fn set_weight(&mut self, id: ObservationId, weight: u32) {
        self.get_mut(id).weight = weight;
    }
}
