//! Finds the clusters near a segment and nearly parallel to it.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashMap;

use super::cells::{Cell, cell_of, cells_along};
use super::representative::WorldSegment;
use crate::growth::push;

/// Side of a cell, in units of what a query reaches.
const SIDE: f64 = 5.0;
/// How far the ends of a cluster may move along each axis before it is entered anew, in units of what a query reaches, and how far its direction may
/// turn, in units of the angle of a query.
const LOOSENESS: f64 = 0.5;
/// Share by which the square of a distance may be off.
const ROUNDING: f64 = 1e-3;
/// Length of a rounded direction.
const STEPS: f64 = 127.0;

/// A grid of cells with the clusters near each. A cluster has entries in the cells around it as well, so that most changes of the cluster leave them as they are.
#[derive(Debug, Clone)]
pub(super) struct ClusterIndex {
    /// How far a segment may be from a cluster that it fits.
    reach: f64,
    /// Least product of the rounded direction of a query and that of an entry.
    least_product: i32,
    /// Least cosine of the direction of a cluster and that of its entries.
    least_cosine: f64,
    cells: FxHashMap<Cell, Vec<Entry>>,
    /// Clusters that are too long for the grid.
    long: Vec<Entry>,
    /// Where each cluster in use was when it was entered.
    entered: Vec<Option<WorldSegment>>,
    /// Where each is now.
    lines: Vec<Line>,
}

/// A cluster near a cell, with its direction, rounded.
#[derive(Debug, Clone, Copy)]
struct Entry {
    cluster: u32,
    direction: [i8; 3],
}

/// The middle of a segment and its direction.
#[derive(Debug, Clone, Copy)]
struct Line {
    middle: Vector3<f64>,
    direction: Vector3<f64>,
}

impl Line {
    fn of(segment: &WorldSegment) -> Self {
        let [from, to] = segment.ends.map(|end| end.coords);
        Self {
            middle: 0.5 * (from + to),
            direction: segment.direction(),
        }
    }
}

impl ClusterIndex {
    /// No clusters. A segment may be this far from a cluster that it fits, at this angle.
    pub(super) fn new(reach: f64, angle: f64) -> Self {
        let angle = angle.min(FRAC_PI_2);
        let widest = ((1.0 + LOOSENESS) * angle).min(FRAC_PI_2);
        // Rounding moves the end of a direction by at most the half diagonal of a step.
        let rounding = 3.0_f64.sqrt() * (STEPS + 1.0);
        Self {
            reach,
            least_product: (widest.cos() * STEPS * STEPS - rounding).floor() as i32,
            least_cosine: (LOOSENESS * angle).cos(),
            cells: FxHashMap::default(),
            long: Vec::new(),
            entered: Vec::new(),
            lines: Vec::new(),
        }
    }

    /// Enters a cluster that has no entries.
    pub(super) fn insert(&mut self, cluster: u32, representative: &WorldSegment) {
        while self.entered.len() <= cluster as usize {
            push(&mut self.entered, None);
            push(&mut self.lines, Line::of(representative));
        }
        self.entered[cluster as usize] = Some(*representative);
        self.lines[cluster as usize] = Line::of(representative);
        let direction = rounded(&representative.direction());
        let entry = Entry { cluster, direction };
        match self.cells_around(representative) {
            Some(cells) => {
                for cell in cells {
                    self.cells.entry(cell).or_default().push(entry);
                }
            }
            None => self.long.push(entry),
        }
    }

    /// Removes the entries of a cluster, if it has any.
    pub(super) fn remove(&mut self, cluster: u32) {
        let Some(representative) = self.entered[cluster as usize].take() else {
            return;
        };
        let Some(cells) = self.cells_around(&representative) else {
            self.long.retain(|entry| entry.cluster != cluster);
            return;
        };
        for cell in cells {
            let Some(entries) = self.cells.get_mut(&cell) else {
                continue;
            };
            let at = entries.iter().position(|entry| entry.cluster == cluster);
            if let Some(at) = at {
                entries.swap_remove(at);
            }
            if entries.is_empty() {
                self.cells.remove(&cell);
            }
        }
    }

    /// Follows a cluster that changed, and returns whether it has left its entries and has new ones.
    pub(super) fn follow(&mut self, cluster: u32, representative: &WorldSegment) -> bool {
        self.lines[cluster as usize] = Line::of(representative);
        let looseness = LOOSENESS * self.reach;
        let is_within = |entered: WorldSegment| {
            let mut ends = entered.ends.iter().zip(&representative.ends);
            ends.all(|(before, now)| (now - before).amax() <= looseness)
                && entered.direction().dot(&representative.direction()) >= self.least_cosine
        };
        let has_left = !self.entered[cluster as usize].is_some_and(is_within);
        if has_left {
            self.remove(cluster);
            self.insert(cluster, representative);
        }
        has_left
    }

    /// Number of clusters.
    #[cfg(test)]
    pub(super) fn len(&self) -> usize {
        self.entered.iter().flatten().count()
    }

    /// Lists all clusters that a segment may fit, and others, some of them again. The ends of the shorter of the two are at most `offset`
    /// from the line of the longer one.
    ///
    /// Both passes are without branches, which would often be mispredicted: each candidate is written, and overwritten by the next one
    /// unless it is kept.
    pub(super) fn near(&self, segment: &WorldSegment, offset: f64, found: &mut Vec<u32>) {
        found.clear();
        let towards = rounded(&segment.direction()).map(i32::from);
        let mut add_parallel = |entries: &[Entry]| {
            let mut kept = found.len();
            found.resize(kept + entries.len(), 0);
            for entry in entries {
                let [x, y, z] = entry.direction.map(i32::from);
                let product = x * towards[0] + y * towards[1] + z * towards[2];
                found[kept] = entry.cluster;
                kept += usize::from(product.abs() >= self.least_product);
            }
            found.truncate(kept);
        };
        match cells_along(segment, SIDE * self.reach, 0.0) {
            Some(cells) => cells
                .filter_map(|cell| self.cells.get(&cell))
                .for_each(|entries| add_parallel(entries)),
            None => self
                .cells
                .values()
                .for_each(|entries| add_parallel(entries)),
        }
        add_parallel(&self.long);
        self.keep_close(&Line::of(segment), offset, found);
    }

    /// All clusters within `reach` of a position, and others near it, each once, in no particular order. A reach above that of queries may miss some.
    pub(super) fn around(&self, position: &Point3<f64>, reach: f64) -> impl Iterator<Item = u32> {
        let most = (1.0 + ROUNDING) * reach * reach;
        let cell = cell_of(position, SIDE * self.reach);
        let entries = self.cells.get(&cell).into_iter().flatten();
        let position = position.coords;
        let is_near = move |cluster: &u32| {
            let line = &self.lines[*cluster as usize];
            let between = position - line.middle;
            let along = between.dot(&line.direction);
            between.norm_squared() - along * along <= most
        };
        let clusters = entries.chain(&self.long).map(|entry| entry.cluster);
        clusters.filter(is_near)
    }

    /// Keeps the clusters whose middle is near this line, or which pass its middle closely: that of the shorter segment is as near to the
    /// longer one as its ends.
    fn keep_close(&self, line: &Line, offset: f64, found: &mut Vec<u32>) {
        let most = (1.0 + ROUNDING) * offset * offset;
        let mut kept = 0;
        for at in 0..found.len() {
            let cluster = found[at];
            let other = &self.lines[cluster as usize];
            let between = other.middle - line.middle;
            let along = between.dot(&line.direction).abs();
            let along = along.max(between.dot(&other.direction).abs());
            found[kept] = cluster;
            kept += usize::from(between.norm_squared() - along * along <= most);
        }
        found.truncate(kept);
    }

    fn cells_around(
        &self,
        representative: &WorldSegment,
    ) -> Option<impl Iterator<Item = Cell> + use<>> {
        let margin = (1.0 + LOOSENESS) * self.reach;
        cells_along(representative, SIDE * self.reach, margin)
    }
}

fn rounded(direction: &Vector3<f64>) -> [i8; 3] {
    [direction.x, direction.y, direction.z].map(|along| (along * STEPS).round() as i8)
}
