//! Which components of the surface are large enough, and which triangles are gaps between others.

use rustc_hash::FxHashMap;

use super::super::delta::Triangle;
use super::locate::{Carved, Located};
use super::{Record, TriangleRole};

/// A search over the triangles of components, bounded by the smallest size that is exported.
pub(super) struct ComponentSearch<'a> {
    pub(super) carved: Carved<'a>,
    pub(super) minimum: usize,
    pub(super) records: &'a mut FxHashMap<Triangle, Record>,
    /// Triangles whose component was looked at, and whether it is large.
    decided: FxHashMap<Triangle, bool>,
    queue: Vec<Located>,
}

impl<'a> ComponentSearch<'a> {
    pub(super) fn new(
        carved: Carved<'a>,
        minimum: usize,
        records: &'a mut FxHashMap<Triangle, Record>,
    ) -> Self {
        Self {
            carved,
            minimum,
            records,
            decided: FxHashMap::default(),
            queue: Vec::new(),
        }
    }

    /// Decides the component of a triangle that is new or has other neighbours than before. Appends the triangles that are in
    /// a large component and were not, or the reverse.
    ///
    /// # Complexity
    /// The smallest size that is exported, and the triangles of small components that became part of a larger one.
    pub(super) fn settle(&mut self, seed: Located, changed: &mut Vec<Triangle>) {
        if !self.is_counted(&seed.corners) || self.decided.contains_key(&seed.corners) {
            return;
        }
        let is_large = self.is_large(seed);
        for located in &self.queue {
            self.decided.insert(located.corners, is_large);
        }
        let mut next = 0;
        while let Some(&located) = self.queue.get(next) {
            next += 1;
            let Some(record) = self.records.get_mut(&located.corners) else {
                continue;
            };
            if std::mem::replace(&mut record.is_large, is_large) != is_large {
                changed.push(located.corners);
            }
            if !is_large {
                continue;
            }
            // What was small and now belongs to this component.
            for k in 0..3 {
                if let Some(other) = self.carved.across(&located, k)
                    && self.records.get(&other.corners).is_some_and(|record| {
                        record.role != TriangleRole::Ignored && !record.is_large
                    })
                    && self.decided.insert(other.corners, true).is_none()
                {
                    self.queue.push(other);
                }
            }
        }
    }

    /// Decides what the neighbours of a triangle make of it: whether it is a gap between whole ones, and which edges its part has. Appends
    /// it if that was otherwise before.
    pub(super) fn settle_joints(
        &mut self,
        located: &Located,
        fills_gaps: bool,
        changed: &mut Vec<Triangle>,
    ) {
        let role = |triangle: &Triangle| self.records.get(triangle).map(|record| record.role);
        let is_left_out = matches!(
            role(&located.corners),
            Some(TriangleRole::Counted | TriangleRole::Part(_))
        );
        let is_beside_whole = [0, 1, 2].map(|k| {
            let other = is_left_out
                .then(|| self.carved.across(located, k))
                .flatten();
            other.is_some_and(|it| role(&it.corners) == Some(TriangleRole::Exported))
        });
        let is_gap = fills_gaps && is_beside_whole == [true; 3];
        if let Some(record) = self.records.get_mut(&located.corners) {
            let before = std::mem::replace(&mut record.is_gap, is_gap);
            let edges = std::mem::replace(&mut record.is_beside_whole, is_beside_whole);
            let is_part = record.role.part().is_some();
            if before != is_gap || (is_part && edges != is_beside_whole) {
                changed.push(located.corners);
            }
        }
    }

    /// Whether the component of a triangle is large; the triangles searched are in the queue.
    fn is_large(&mut self, seed: Located) -> bool {
        self.queue.clear();
        self.queue.push(seed);
        let mut next = 0;
        while let Some(&located) = self.queue.get(next) {
            next += 1;
            if self.queue.len() >= self.minimum {
                return true;
            }
            for k in 0..3 {
                let Some(other) = self.carved.across(&located, k) else {
                    continue;
                };
                if !self.is_counted(&other.corners) {
                    continue;
                }
                match self.decided.get(&other.corners) {
                    Some(true) => return true,
                    _ if self.queue.contains(&other) => {}
                    _ => self.queue.push(other),
                }
            }
        }
        self.queue.len() >= self.minimum
    }

    /// Whether a triangle counts for the size of its component.
    fn is_counted(&self, corners: &Triangle) -> bool {
        (self.records.get(corners)).is_some_and(|record| record.role != TriangleRole::Ignored)
    }
}
