//! Passes over edges in order of cost, and rounds that repeat what earlier ones did.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use rustc_hash::FxHashMap;

use super::collapse::{Collapse, Reduction};

/// Maximum passes over all edges; they end when a pass removes less than one triangle in a hundred.
const MAX_PASSES: usize = 4;

/// What passes over the edges of a mesh know of earlier ones. Whether an edge may collapse depends on the triangles around its ends: an edge
/// that was rejected is not looked at again before they change.
#[derive(Default)]
pub(super) struct Passes {
    /// Collapses in order. Their number is the time.
    made: Vec<Collapse>,
    /// When the triangles around each vertex changed last.
    changed: Vec<u32>,
    /// When each edge was rejected last.
    rejected: FxHashMap<(u32, u32), u32>,
    /// Whether edges that were never looked at are those of an earlier round, which rejected them.
    is_repeated: bool,
}

impl Passes {
    /// Before the first pass over a mesh with `count` vertices.
    pub(super) fn new(count: usize) -> Self {
        Self {
            changed: vec![0; count],
            ..Self::default()
        }
    }

    /// Repeats the collapses of earlier passes over the same mesh, of which now more vertices are fixed. Collapses that these fixed vertices
    /// exclude are left out, and those that depend on them.
    pub(super) fn repeat(self, reduction: &mut Reduction<'_>) -> Self {
        let mut passes = Self::new(self.changed.len());
        passes.is_repeated = true;
        let mut is_open = vec![false; self.changed.len()];
        let mut around = Vec::new();
        for collapse in self.made {
            let Collapse { kept, gone, target } = collapse;
            let keeps_place = target == *reduction.position(kept);
            let is_excluded = reduction.is_fixed[gone as usize]
                || reduction.is_fixed[kept as usize] && !keeps_place;
            let mut is_same = !(is_excluded || is_open[kept as usize] || is_open[gone as usize]);
            for vertex in [kept, gone] {
                reduction.mesh.neighbors(vertex, &mut around);
                is_same &= !around.iter().any(|other| is_open[*other as usize]);
            }
            if is_same && reduction.repeat(&collapse) {
                passes.made.push(collapse);
            } else {
                is_open[kept as usize] = true;
                is_open[gone as usize] = true;
            }
        }
        let now = passes.now().max(1);
        for vertex in (0..is_open.len() as u32).filter(|vertex| is_open[*vertex as usize]) {
            passes.changed[vertex as usize] = now;
            reduction.mesh.neighbors(vertex, &mut around);
            for other in &around {
                passes.changed[*other as usize] = now;
            }
        }
        passes
    }

    /// Runs passes until they remove little.
    pub(super) fn run(&mut self, reduction: &mut Reduction<'_>) {
        let mut left = reduction.mesh.triangles().count();
        for _ in 0..MAX_PASSES {
            self.pass(reduction);
            let now = reduction.mesh.triangles().count();
            if now * 100 > left * 99 {
                break;
            }
            left = now;
        }
    }

    fn now(&self) -> u32 {
        self.made.len() as u32
    }

    /// Whether an edge may collapse, as far as is known; `a` is less than `b`.
    fn is_candidate(&self, a: u32, b: u32) -> bool {
        let changed = self.changed[a as usize].max(self.changed[b as usize]);
        match self.rejected.get(&(a, b)) {
            Some(rejected) => changed > *rejected,
            None => !self.is_repeated || changed > 0,
        }
    }

    /// Attempts every candidate in order of cost, and again those that change.
    fn pass(&mut self, reduction: &mut Reduction<'_>) {
        let count = reduction.mesh.positions.len();
        // Queue entries with an outdated stamp of either vertex are skipped.
        let mut stamps = vec![0_u32; count];
        let mut line = BinaryHeap::new();
        let mut others = Vec::new();
        // The bit patterns of non-negative floats are ordered like the numbers.
        let entry = |reduction: &Reduction<'_>, stamps: &[u32], a: u32, b: u32| {
            let (a, b) = (a.min(b), a.max(b));
            let cost = reduction.estimate(a, b).to_bits();
            Reverse((cost, a, b, stamps[a as usize], stamps[b as usize]))
        };
        for vertex in 0..count as u32 {
            reduction.mesh.neighbors(vertex, &mut others);
            for &other in others.iter().filter(|other| **other > vertex) {
                if self.is_candidate(vertex, other) {
                    line.push(entry(reduction, &stamps, vertex, other));
                }
            }
        }
        while let Some(Reverse((_, a, b, stamp_a, stamp_b))) = line.pop() {
            if stamps[a as usize] != stamp_a || stamps[b as usize] != stamp_b {
                continue;
            }
            let Some(collapse) = reduction.judge(a, b) else {
                self.rejected.insert((a, b), self.now());
                continue;
            };
            reduction.make(&collapse);
            self.made.push(collapse);
            let kept = collapse.kept;
            for vertex in [a, b] {
                stamps[vertex as usize] += 1;
            }
            self.changed[kept as usize] = self.now();
            reduction.mesh.neighbors(kept, &mut others);
            for &other in &others {
                self.changed[other as usize] = self.now();
                line.push(entry(reduction, &stamps, kept, other));
            }
        }
    }
}
