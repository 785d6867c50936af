//! The history of a surface during a run.

use nalgebra::Point3;

use super::element_history::ElementHistory;
use linecarve_mesh::{LineSet, TriangleMesh};

/// Size limits of a history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HistoryLimits {
    /// Largest number of states. Beyond it every second state is dropped, and only every second keyframe is recorded from
    /// then on.
    pub states: u32,
    /// Largest number of triangle lifetimes, treated likewise; applies above 16 states.
    pub triangles: usize,
}

impl Default for HistoryLimits {
    /// About 60 MB of memory and 40 MB of page.
    fn default() -> Self {
        Self {
            states: 512,
            triangles: 4_000_000,
        }
    }
}

/// The elements that a surface is made from.
#[derive(Debug, Clone, Copy)]
pub enum Elements<'a> {
    /// Segments and clusters.
    Lines {
        /// All segments so far; they never change.
        segments: &'a [[Point3<f64>; 2]],
        /// Current clusters.
        clusters: &'a LineSet,
    },
    /// Current points.
    Points(&'a [Point3<f64>]),
}

/// A surface and its elements over keyframes, stored as changes.
#[derive(Debug, Clone, Default)]
pub struct SurfaceHistory {
    limits: HistoryLimits,
    /// Every `stride`-th keyframe is recorded.
    stride: usize,
    keyframes_seen: usize,
    /// Keyframe of each state.
    keyframes: Vec<u32>,
    /// Vertices in the order of first use.
    positions: Vec<Point3<f64>>,
    /// Vertices of the last state, sorted by key.
    current: Vec<(Key, u32)>,
    pub(super) triangles: ElementHistory<[u32; 3]>,
    pub(super) clusters: ElementHistory<[Key; 2]>,
    pub(super) points: ElementHistory<Key>,
    segments: Vec<[Point3<f64>; 2]>,
    /// Number of segments at each state.
    segments_until: Vec<u32>,
    /// Number of mesh vertices at each state. Manifold repair gives several vertices the same position.
    vertex_counts: Vec<u32>,
}

/// Bits of a position. Their order is arbitrary, but equal positions are equal.
pub(super) type Key = [u64; 3];

fn key(point: &Point3<f64>) -> Key {
    // 0 and -0 are equal.
    std::array::from_fn(|axis| (point[axis] + 0.0).to_bits())
}

fn position(key: &Key) -> Point3<f64> {
    Point3::from(key.map(f64::from_bits))
}

impl SurfaceHistory {
    /// An empty history.
    pub fn new(limits: HistoryLimits) -> Self {
        Self {
            limits,
            stride: 1,
            ..Self::default()
        }
    }

    /// Counts a keyframe. Returns whether its state has to be [recorded](Self::record).
    pub fn advance(&mut self) -> bool {
        self.keyframes_seen += 1;
        self.keyframes_seen.is_multiple_of(self.stride.max(1))
    }

    /// Records the surface and its elements after a keyframe.
    ///
    /// Appends the segments that are new since the last state. Triangles with missing vertices are skipped.
    ///
    /// # Complexity
    /// O(n log n) in the size of the surface and its elements. Memory grows with the changes.
    pub fn record(&mut self, keyframe: usize, mesh: &TriangleMesh, elements: Elements<'_>) {
        let ids = self.vertex_ids(mesh);
        let triangles = mesh
            .triangles
            .iter()
            .filter_map(|corners| {
                let [Some(a), Some(b), Some(c)] = corners.map(|c| ids.get(c as usize).copied())
                else {
                    return None;
                };
                Some(smallest_first([a, b, c]))
            })
            .collect();
        self.triangles.push(triangles);
        match elements {
            Elements::Lines { segments, clusters } => {
                let ends = |line: &[u32; 2]| -> Option<[Key; 2]> {
                    let [from, to] = line.map(|end| clusters.points.get(end as usize).map(key));
                    Some([from?, to?])
                };
                let clusters = clusters.lines.iter().filter_map(ends);
                self.clusters.push(clusters.collect());
                self.points.push(Vec::new());
                let known = self.segments.len().min(segments.len());
                self.segments.extend_from_slice(&segments[known..]);
            }
            Elements::Points(points) => {
                self.clusters.push(Vec::new());
                self.points.push(points.iter().map(key).collect());
            }
        }
        self.segments_until.push(self.segments.len() as u32);
        self.vertex_counts.push(mesh.positions.len() as u32);
        self.keyframes.push(keyframe as u32);
        let crowded = self.keyframes.len() > self.limits.states.max(2) as usize
            || (self.keyframes.len() > 16
                && self.triangles.records().len() > self.limits.triangles);
        if crowded {
            self.thin();
        }
    }

    /// Records the final state, unless its keyframe is already recorded.
    pub fn finish(&mut self, keyframe: usize, mesh: &TriangleMesh, elements: Elements<'_>) {
        for _ in 0..2 {
            // Recording may drop the state again to keep the limits; the second attempt then succeeds.
            if self.keyframes.last() != Some(&(keyframe as u32)) {
                self.record(keyframe, mesh, elements);
            }
        }
    }

    /// Keyframe of each state.
    pub fn keyframes(&self) -> &[u32] {
        &self.keyframes
    }

    /// Number of mesh vertices at each state.
    pub(super) fn vertex_counts(&self) -> &[u32] {
        &self.vertex_counts
    }

    /// All vertices of all states.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions
    }

    /// All triangles of all states, once per lifetime.
    pub fn triangles(&self) -> impl ExactSizeIterator<Item = [u32; 3]> + '_ {
        self.triangles.records().iter().map(|(corners, _)| *corners)
    }

    /// Segments in the order of keyframes, and their number at each state.
    pub(super) fn segments(&self) -> (&[[Point3<f64>; 2]], &[u32]) {
        (&self.segments, &self.segments_until)
    }

    /// End points of all clusters of all states.
    pub(super) fn cluster_ends(&self) -> Vec<Point3<f64>> {
        let records = self.clusters.records().iter();
        records
            .flat_map(|(ends, _)| ends.iter().map(position))
            .collect()
    }

    /// All points of all states.
    pub(super) fn point_positions(&self) -> Vec<Point3<f64>> {
        let records = self.points.records().iter();
        records.map(|(key, _)| position(key)).collect()
    }

    fn thin(&mut self) {
        self.triangles.thin();
        self.clusters.thin();
        self.points.thin();
        let every_second = |list: &[u32]| list.chunks_exact(2).map(|pair| pair[1]).collect();
        self.keyframes = every_second(&self.keyframes);
        self.segments_until = every_second(&self.segments_until);
        self.vertex_counts = every_second(&self.vertex_counts);
        self.stride = 2 * self.stride.max(1);
    }

    /// Id of each mesh vertex. A vertex keeps its id while it stays.
    fn vertex_ids(&mut self, mesh: &TriangleMesh) -> Vec<u32> {
        let mut by_position: Vec<(Key, u32)> = (0..)
            .zip(&mesh.positions)
            .map(|(i, p)| (key(p), i))
            .collect();
        by_position.sort_unstable();
        let mut ids = vec![0; mesh.positions.len()];
        let mut now: Vec<(Key, u32)> = Vec::with_capacity(by_position.len());
        let mut before = self.current.iter().peekable();
        for (key, vertex) in by_position {
            let id = match now.last() {
                Some((last, id)) if *last == key => *id,
                _ => {
                    while before.next_if(|(old, _)| *old < key).is_some() {}
                    let id = match before.next_if(|(old, _)| *old == key) {
                        Some((_, id)) => *id,
                        None => {
                            self.positions.push(position(&key));
                            (self.positions.len() - 1) as u32
                        }
                    };
                    now.push((key, id));
                    id
                }
            };
            ids[vertex as usize] = id;
        }
        self.current = now;
        ids
    }
}

/// The rotation of a triangle with its smallest corner first.
fn smallest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a <= b && a <= c {
        [a, b, c]
    } else if b <= c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
