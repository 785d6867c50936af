//! The history of a surface during a run.

use linecarve_carving::{ChangeLog, Face};
use linecarve_mesh::LineSet;
use nalgebra::Point3;

use super::element_history::{ElementHistory, MOST_STATES};
use super::triangle_history::TriangleHistory;
use linecarve_engine::map::SurfaceChange;

/// Size limits of a history.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HistoryLimits {
    /// Largest number of states. Beyond it every second state is dropped, and only every second keyframe is recorded from
    /// then on.
    pub states: u32,
    /// Most memory of what changed, in bytes, treated likewise; applies above 16 states.
    pub memory: usize,
}

impl Default for HistoryLimits {
    /// About 40 MB of page.
    fn default() -> Self {
        Self {
            states: 512,
            memory: 64_000_000,
        }
    }
}

/// The elements that a surface is made from.
#[derive(Debug, Clone, Copy, Default)]
pub struct Elements<'a> {
    /// All segments so far.
    pub segments: &'a [[Point3<f64>; 2]],
    /// Current clusters, where there are any.
    pub clusters: Option<&'a LineSet>,
    /// Current points.
    pub points: &'a [Point3<f64>],
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
    positions: Vec<Place>,
    /// The vertex of the page at each vertex of the surface, as of the last state.
    ids: Vec<u32>,
    /// Changes since the last state.
    log: ChangeLog,
    /// Whether the numbers of the surface were given out anew since the last state.
    is_anew: bool,
    pub(super) triangles: TriangleHistory,
    pub(super) clusters: ElementHistory<[Key; 2]>,
    pub(super) points: ElementHistory<Key>,
    segments: Vec<[Place; 2]>,
    /// Number of segments at each state.
    segments_until: Vec<u32>,
    /// Number of mesh vertices at each state. Manifold repair gives several vertices the same position.
    vertex_counts: Vec<u32>,
}

/// A position in single precision: coordinates are relative to the recording, and the page has 21 bits of each.
pub(super) type Place = [f32; 3];

fn place(point: &Point3<f64>) -> Place {
    point.coords.cast::<f32>().into()
}

fn point(place: &Place) -> Point3<f64> {
    Point3::from(*place).cast()
}

/// Bits of a position. Their order is arbitrary, but equal positions are equal.
pub(super) type Key = [u32; 3];

fn key(point: &Point3<f64>) -> Key {
    // 0 and -0 are equal.
    place(point).map(|coordinate| (coordinate + 0.0).to_bits())
}

fn position(key: &Key) -> Point3<f64> {
    point(&key.map(f32::from_bits))
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
        self.thin_when_crowded();
        self.keyframes_seen += 1;
        self.keyframes_seen.is_multiple_of(self.stride.max(1))
    }

    /// Notes a change of the surface, for the next state.
    pub fn note(&mut self, change: &SurfaceChange) {
        if change.is_anew {
            self.log = ChangeLog::default();
            self.is_anew = true;
        }
        self.log.append(&change.mesh);
    }

    /// Records the surface as of the last change noted, and its elements, after a keyframe. `position` gives the positions of
    /// the surface's vertices, `vertices` is their number.
    ///
    /// Appends the segments that are new since the last state.
    ///
    /// # Complexity
    /// O(n log n) in the change of the surface and the size of its elements. Memory grows with the changes.
    pub fn record(
        &mut self,
        keyframe: usize,
        position: impl Fn(u32) -> Point3<f64>,
        vertices: usize,
        elements: Elements<'_>,
    ) {
        self.record_triangles(position);
        self.record_elements(elements);
        self.vertex_counts.push(vertices as u32);
        self.keyframes.push(keyframe as u32);
    }

    fn record_triangles(&mut self, position: impl Fn(u32) -> Point3<f64>) {
        let change = self.log.take();
        let mut gone = [&change.removed[..], &change.reshaped].concat();
        if std::mem::take(&mut self.is_anew) {
            gone = self.triangles.faces();
            self.ids.clear();
        }
        let capacity = change.placed.last().map_or(0, |last| *last as usize + 1);
        if capacity > self.ids.len() {
            self.ids.resize(capacity, 0);
        }
        for &number in &change.placed {
            self.ids[number as usize] = self.positions.len() as u32;
            self.positions.push(place(&position(number)));
        }
        let ids = &self.ids;
        let came = change.added.iter().chain(&change.reshaped);
        let came = came.map(|face: &Face| (*face, smallest_first(face.map(|v| ids[v as usize]))));
        self.triangles.push(gone, came);
    }

    fn record_elements(&mut self, elements: Elements<'_>) {
        let clusters = elements.clusters.map(|clusters| {
            let ends = |line: &[u32; 2]| -> Option<[Key; 2]> {
                let [from, to] = line.map(|end| clusters.points.get(end as usize).map(key));
                Some([from?, to?])
            };
            clusters.lines.iter().filter_map(ends).collect()
        });
        self.clusters.push(clusters.unwrap_or_default());
        self.points.push(elements.points.iter().map(key).collect());
        let new = elements.segments.iter().skip(self.segments.len());
        self.segments
            .extend(new.map(|ends| ends.each_ref().map(place)));
        self.segments_until.push(self.segments.len() as u32);
    }

    /// Records the final state, unless its keyframe is already recorded; arguments as in [`record`](Self::record).
    pub fn finish(
        &mut self,
        keyframe: usize,
        position: impl Fn(u32) -> Point3<f64>,
        vertices: usize,
        elements: Elements<'_>,
    ) {
        if self.keyframes.last() != Some(&(keyframe as u32)) {
            self.thin_when_crowded();
            self.record(keyframe, position, vertices, elements);
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

    /// Number of segments.
    pub(super) fn segment_count(&self) -> usize {
        self.segments.len()
    }

    /// All vertices of all states.
    pub(super) fn positions(&self) -> impl ExactSizeIterator<Item = Point3<f64>> + Clone + '_ {
        self.positions.iter().map(point)
    }

    /// A vertex.
    pub(super) fn position(&self, vertex: u32) -> Point3<f64> {
        point(&self.positions[vertex as usize])
    }

    /// All triangles of all states, once per lifetime.
    pub fn triangles(&self) -> impl ExactSizeIterator<Item = [u32; 3]> + '_ {
        self.triangles.records().iter().map(|(corners, _)| *corners)
    }

    /// Ends of the segments in the order of keyframes.
    pub(super) fn segment_ends(&self) -> impl Iterator<Item = Point3<f64>> + Clone + '_ {
        self.segments.iter().flatten().map(point)
    }

    /// Number of segments at each state.
    pub(super) fn segments_until(&self) -> &[u32] {
        &self.segments_until
    }

    /// End points of all clusters of all states.
    pub(super) fn cluster_ends(&self) -> impl Iterator<Item = Point3<f64>> + Clone + '_ {
        let records = self.clusters.records().iter();
        records.flat_map(|(ends, _)| ends.iter().map(position))
    }

    /// All points of all states.
    pub(super) fn point_positions(&self) -> impl Iterator<Item = Point3<f64>> + Clone + '_ {
        let records = self.points.records().iter();
        records.map(|(key, _)| position(key))
    }

    /// Makes room for another state. Only an even number of states is thinned, so that the last one stays.
    fn thin_when_crowded(&mut self) {
        let states = self.keyframes.len();
        let most = self.limits.states.clamp(2, MOST_STATES) as usize & !1;
        let is_large = states > 16 && self.memory() > self.limits.memory;
        if states >= most || (is_large && states.is_multiple_of(2)) {
            self.thin();
        }
    }

    /// Drops the vertices of no triangle of any state. Those of the surface stay: further triangles may have them.
    fn drop_unused_vertices(&mut self) {
        let mut used = self.used_vertices();
        for id in &self.ids {
            if let Some(used) = used.get_mut(*id as usize) {
                *used = true;
            }
        }
        let ranks = ranks(&used);
        let mut is_used = used.iter();
        self.positions
            .retain(|_| is_used.next().copied().unwrap_or(true));
        self.positions.shrink_to_fit();
        self.triangles.renumber(&ranks);
        for id in &mut self.ids {
            *id = ranks.get(*id as usize).copied().unwrap_or(0);
        }
    }

    /// Whether a triangle of any state has each vertex.
    pub(super) fn used_vertices(&self) -> Vec<bool> {
        let mut used = vec![false; self.positions.len()];
        for corner in self.triangles().flatten() {
            used[corner as usize] = true;
        }
        used
    }

    /// Memory of what changed, in bytes.
    fn memory(&self) -> usize {
        self.triangles.memory()
            + self.clusters.memory()
            + self.points.memory()
            + size_of_val(&self.positions[..])
    }

    fn thin(&mut self) {
        self.triangles.thin();
        self.drop_unused_vertices();
        self.clusters.thin();
        self.points.thin();
        let every_second = |list: &[u32]| list.chunks_exact(2).map(|pair| pair[1]).collect();
        self.keyframes = every_second(&self.keyframes);
        self.segments_until = every_second(&self.segments_until);
        self.vertex_counts = every_second(&self.vertex_counts);
        self.stride = 2 * self.stride.max(1);
    }
}

/// The numbers of elements when those that are not used are dropped.
pub(super) fn ranks(used: &[bool]) -> Vec<u32> {
    let mut count = 0;
    let rank = |used: &bool| {
        let rank = count;
        count += u32::from(*used);
        rank
    };
    used.iter().map(rank).collect()
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
