//! The table of sheets: segments seen by a view, as the triangles between its centre and their ends.

use rustc_hash::FxHashMap;

use super::rays::RayId;

/// One segment seen by one view.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sheet {
    pub(crate) view: u32,
    /// The points at its ends, the smaller id first.
    pub(crate) points: [u32; 2],
    /// Their vertices.
    pub(crate) vertices: [u32; 2],
    pub(crate) weight: u32,
    /// Standard deviations of the ends along the rays to them.
    pub(crate) sigmas: [Option<f64>; 2],
    /// Whether it may touch a cell at a special position; then it is walked over its full extent whenever one of the
    /// cells that list it changes.
    pub(crate) is_degenerate: bool,
}

/// Sheets by id, view and end. Ids of removed sheets are given out again; lists of cells hold them as [`RayId`]s of their
/// own numbering.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sheets {
    records: Vec<Option<Sheet>>,
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

fn forget(lists: &mut [Vec<u32>], index: u32, sheet: u32) {
    let list = &mut lists[index as usize];
    if let Some(place) = list.iter().position(|&other| other == sheet) {
        list.swap_remove(place);
    }
}

impl Sheets {
    /// Number of sheets.
    pub(crate) fn len(&self) -> usize {
        self.records.len() - self.free.len()
    }

    /// Length of an array indexed by sheet.
    pub(crate) fn capacity(&self) -> usize {
        self.records.len()
    }

    /// A sheet in use.
    pub(crate) fn get(&self, sheet: RayId) -> &Sheet {
        self.records[sheet.0 as usize]
            .as_ref()
            .expect("lists hold sheets in use only")
    }

    pub(crate) fn get_mut(&mut self, sheet: RayId) -> &mut Sheet {
        self.records[sheet.0 as usize]
            .as_mut()
            .expect("lists hold sheets in use only")
    }

    pub(crate) fn add(
        &mut self,
        view: u32,
        points: [u32; 2],
        vertices: [u32; 2],
        weight: u32,
    ) -> RayId {
        let record = Some(Sheet {
            view,
            points,
            vertices,
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
        RayId(id)
    }

    pub(crate) fn remove(&mut self, sheet: RayId) {
        let Some(Sheet { view, points, .. }) = self.records[sheet.0 as usize].take() else {
            return;
        };
        self.ids.remove(&(view, points));
        for point in points {
            forget(&mut self.of_point, point, sheet.0);
        }
        forget(&mut self.of_view, view, sheet.0);
        self.free.push(sheet.0);
    }

    /// Sheets with an end at a point.
    pub(crate) fn of_point(&self, point: u32) -> impl Iterator<Item = RayId> + '_ {
        let list = self.of_point.get(point as usize);
        list.into_iter().flatten().copied().map(RayId)
    }

    /// Sheets of a view.
    pub(crate) fn of_view(&self, view: u32) -> impl Iterator<Item = RayId> + '_ {
        let list = self.of_view.get(view as usize);
        list.into_iter().flatten().copied().map(RayId)
    }

    pub(crate) fn find(&self, view: u32, points: [u32; 2]) -> Option<RayId> {
        self.ids.get(&(view, points)).copied().map(RayId)
    }

    /// Whether an id is in use.
    pub(crate) fn is_in_use(&self, sheet: RayId) -> bool {
        matches!(self.records.get(sheet.0 as usize), Some(Some(_)))
    }

    /// All sheets in use, by id.
    pub(crate) fn all(&self) -> impl Iterator<Item = RayId> + '_ {
        (0..self.records.len() as u32)
            .filter(|&id| self.records[id as usize].is_some())
            .map(RayId)
    }
}
