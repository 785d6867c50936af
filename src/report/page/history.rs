//! A surface through a run.

use nalgebra::Point3;

use super::life_spans::LifeSpans;
use linecarve_mesh::{LineSet, TriangleMesh};

/// How much a history keeps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HistoryLimits {
    /// At most this many states; beyond, every second one is forgotten and from then on every second keyframe recorded.
    pub states: u32,
    /// Likewise when this many stays of triangles are on record, as long as there are more than 16 states.
    pub triangles: usize,
}

impl Default for HistoryLimits {
    /// Some 60 MB of memory and 40 MB of page at most.
    fn default() -> Self {
        Self {
            states: 512,
            triangles: 4_000_000,
        }
    }
}

/// What a surface is made from.
#[derive(Debug, Clone, Copy)]
pub enum Elements<'a> {
    /// Lines.
    Lines {
        /// All segments of the run so far; they never change.
        segments: &'a [[Point3<f64>; 2]],
        /// The clusters as they are.
        clusters: &'a LineSet,
    },
    /// Points as they are.
    Points(&'a [Point3<f64>]),
}

/// A surface and its lines after one keyframe after another: what came and what went.
#[derive(Debug, Clone, Default)]
pub struct SurfaceHistory {
    limits: HistoryLimits,
    /// Every `stride`-th keyframe is recorded.
    stride: usize,
    keyframes_seen: usize,
    /// The keyframe of each state.
    keyframes: Vec<u32>,
    /// Vertices in the order of first use.
    positions: Vec<Point3<f64>>,
    /// Vertices of the last state, sorted by position.
    current: Vec<(Key, u32)>,
    pub(super) triangles: LifeSpans<[u32; 3]>,
    pub(super) clusters: LifeSpans<[Key; 2]>,
    pub(super) points: LifeSpans<Key>,
    segments: Vec<[Point3<f64>; 2]>,
    /// How many segments there were at each state.
    segments_until: Vec<u32>,
    /// How many vertices the mesh had at each state: more than places, where a repair has given a place several.
    vertex_counts: Vec<u32>,
}

/// A position whose order is that of its bits: any order will do as long as equal positions are equal.
pub(super) type Key = [u64; 3];

fn key(point: &Point3<f64>) -> Key {
    // Both zeros are one place.
    std::array::from_fn(|axis| (point[axis] + 0.0).to_bits())
}

fn position(key: &Key) -> Point3<f64> {
    Point3::from(key.map(f64::from_bits))
}

impl SurfaceHistory {
    /// Nothing yet.
    pub fn new(limits: HistoryLimits) -> Self {
        Self {
            limits,
            stride: 1,
            ..Self::default()
        }
    }

    /// Counts a keyframe; whether its state is to be [recorded](Self::record).
    pub fn advance(&mut self) -> bool {
        self.keyframes_seen += 1;
        self.keyframes_seen.is_multiple_of(self.stride.max(1))
    }

    /// Records the state after a keyframe: the surface and what it is made from.
    ///
    /// Of segments those beyond the ones of earlier states are taken. Triangles that name missing vertices are passed over.
    ///
    /// # Complexity
    /// O(n log n) in the size of the surface, of clusters and points; memory grows with what changed.
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

    /// Records the end of the run, unless the state of its last keyframe is there already.
    pub fn finish(&mut self, keyframe: usize, mesh: &TriangleMesh, elements: Elements<'_>) {
        for _ in 0..2 {
            // Once more when the limits have made it forget the last state: then they hold.
            if self.keyframes.last() != Some(&(keyframe as u32)) {
                self.record(keyframe, mesh, elements);
            }
        }
    }

    /// The keyframe of each state.
    pub fn keyframes(&self) -> &[u32] {
        &self.keyframes
    }

    /// Number of vertices of the mesh at each state.
    pub(super) fn vertex_counts(&self) -> &[u32] {
        &self.vertex_counts
    }

    /// Every vertex that any state has.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions
    }

    /// Every triangle that any state has, once for each of its stays.
    pub fn triangles(&self) -> impl ExactSizeIterator<Item = [u32; 3]> + '_ {
        self.triangles.records().iter().map(|(corners, _)| *corners)
    }

    /// Segments in the order of keyframes, and how many there were at each state.
    pub(super) fn segments(&self) -> (&[[Point3<f64>; 2]], &[u32]) {
        (&self.segments, &self.segments_until)
    }

    /// The ends of every cluster that any state has.
    pub(super) fn cluster_ends(&self) -> Vec<Point3<f64>> {
        let records = self.clusters.records().iter();
        records
            .flat_map(|(ends, _)| ends.iter().map(position))
            .collect()
    }

    /// Every point that any state is made from.
    pub(super) fn point_positions(&self) -> Vec<Point3<f64>> {
        let records = self.points.records().iter();
        records.map(|(place, _)| position(place)).collect()
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

    /// The number of each vertex of a mesh; vertices keep theirs as long as they stay.
    fn vertex_ids(&mut self, mesh: &TriangleMesh) -> Vec<u32> {
        let mut by_place: Vec<(Key, u32)> = (0..)
            .zip(&mesh.positions)
            .map(|(i, p)| (key(p), i))
            .collect();
        by_place.sort_unstable();
        let mut ids = vec![0; mesh.positions.len()];
        let mut now: Vec<(Key, u32)> = Vec::with_capacity(by_place.len());
        let mut before = self.current.iter().peekable();
        for (place, vertex) in by_place {
            let id = match now.last() {
                Some((last, id)) if *last == place => *id,
                _ => {
                    while before.next_if(|(old, _)| *old < place).is_some() {}
                    let id = match before.next_if(|(old, _)| *old == place) {
                        Some((_, id)) => *id,
                        None => {
                            self.positions.push(position(&place));
                            (self.positions.len() - 1) as u32
                        }
                    };
                    now.push((place, id));
                    id
                }
            };
            ids[vertex as usize] = id;
        }
        self.current = now;
        ids
    }
}

/// The same triangle, its smallest corner first.
fn smallest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    if a <= b && a <= c {
        [a, b, c]
    } else if b <= c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}
