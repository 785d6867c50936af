//! Points, views and observations in; free space and its surface out.
//!
//! [`Carver`] holds points with positions, views with centres, and observations, each of a point by a view with a weight.
//! All of them may be added, moved and removed at any time. After any sequence of changes the tetrahedra, labels and
//! surface are identical to those built from scratch from the final state in any order; nothing is forgotten and nothing
//! depends on history.
//!
//! # Example
//!
//! A view in the middle of a cube of eight points sees the corners one by one and carves the cube free.
//!
//! ```
//! use linecarve_carving::{Carver, CarverOptions};
//! use linecarve_carving::{ExportOptions, Hull};
//! use nalgebra::Point3;
//!
//! let mut carver = Carver::new(CarverOptions { hull: Hull::Keep, ..Default::default() });
//! let mut keyframe = carver.transaction();
//! let view = keyframe.add_view(Point3::new(0.5, 0.4, 0.45))?;
//! for corner in 0..8 {
//!     let corner = Point3::new((corner & 1) as f64, (corner >> 1 & 1) as f64, (corner >> 2) as f64);
//!     let point = keyframe.add_point(corner)?;
//!     keyframe.add_observation(view, point, 1)?;
//! }
//! let report = keyframe.commit()?;
//! assert_eq!(report.surface.added.len(), 12);
//!
//! let mesh = carver.mesh(&ExportOptions::default());
//! assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (8, 12));
//! # Ok::<(), linecarve_carving::TransactionError>(())
//! ```

mod affected;
mod check;
mod commit;
mod error;
mod ids;
mod points;
#[cfg(any(test, feature = "internals"))]
mod snapshot;
mod transaction;

pub use check::CarverViolation;
pub use commit::{CommitReport, CommitTimes};
pub use error::TransactionError;
pub use ids::{PointId, ViewId};
#[cfg(any(test, feature = "internals"))]
pub use snapshot::{CarvedCell, Snapshot};
pub use transaction::Transaction;

use nalgebra::Point3;

use crate::labels::{Cut, Labels, Votes};
use crate::surface::{ExportOptions, Facets, Hull, IndexedMesh, Triangle};
use crate::tetrahedralization::{CellId, Changes, IncidentCells, Tetrahedralization, VertexId};
use crate::visibility::{
    Cells, ObservationTable, RayVisibility, SegmentVisibility, Views, Visibility,
};

use points::Points;

/// Settings of a [`Carver`], fixed for its life.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct CarverOptions {
    /// Which cells are free; by default those that a ray crosses.
    pub labels: Labels,
    /// Whether facets between free cells and the outside of the hull are part of the surface.
    pub hull: Hull,
}

/// Labels with what they remember.
#[derive(Clone, Debug)]
enum Labeling {
    Votes(Votes),
    Cut(Box<Cut>),
}

/// A tetrahedralisation carved by rays; see the [module](self).
///
/// Ids of points and views are given once and never again. Points at equal positions share a vertex and keep rays of
/// their own.
///
/// *What it does not do:* with [`Labels::Votes`] it does not judge points (a wrong point carves what is in front of it); and
/// it knows free and occupied only: what no ray crosses is occupied, seen or not.
#[derive(Clone, Debug)]
pub struct Carver {
    labels: Labeling,
    tetrahedra: Tetrahedralization,
    points: Points,
    views: Views,
    rays: RayVisibility,
    segments: SegmentVisibility,
    cells: Cells,
    facets: Facets,
    changes: Changes,
}

impl Default for Carver {
    fn default() -> Self {
        Self::new(CarverOptions::default())
    }
}

impl Carver {
    /// Nothing seen yet.
    pub fn new(options: CarverOptions) -> Self {
        let (labels, threshold, softness) = match options.labels {
            Labels::Votes(votes) => (Labeling::Votes(votes), votes.threshold.get(), None),
            Labels::Cut(cut) => {
                let labels = Labeling::Cut(Box::new(Cut::new(cut)));
                (labels, u64::MAX, Some(cut.softness()))
            }
        };
        Self {
            labels,
            tetrahedra: Tetrahedralization::new(),
            points: Points::default(),
            views: Views::default(),
            rays: RayVisibility::new(softness),
            segments: SegmentVisibility::new(softness),
            cells: Cells::new(threshold, softness.is_some()),
            facets: Facets::new(options.hull),
            changes: Changes::new(),
        }
    }

    /// The settings.
    pub fn options(&self) -> CarverOptions {
        CarverOptions {
            labels: match &self.labels {
                Labeling::Votes(votes) => Labels::Votes(*votes),
                Labeling::Cut(cut) => Labels::Cut(cut.options()),
            },
            hull: self.facets.hull(),
        }
    }

    /// The tetrahedra of all points.
    pub fn tetrahedra(&self) -> &Tetrahedralization {
        &self.tetrahedra
    }

    /// Number of points, those that share a vertex counted each.
    pub fn point_count(&self) -> usize {
        self.points.len()
    }

    /// Number of views.
    pub fn view_count(&self) -> usize {
        self.views.ids().count()
    }

    /// Number of observations.
    pub fn ray_count(&self) -> usize {
        self.rays.table().len()
    }

    /// Number of segments seen by views, each view counted.
    pub fn segment_count(&self) -> usize {
        self.segments.table().len()
    }

    /// Weight with which a view sees the segment between two points; `None` if it does not.
    pub fn segment(&self, view: ViewId, ends: [PointId; 2]) -> Option<u32> {
        let segments = self.segments.table();
        segments
            .find(view.0, ordered(ends))
            .map(|segment| segments.weight(segment))
    }

    /// All segments seen by views with their weights, in no particular order; of the two points the older first.
    pub fn segments(&self) -> impl Iterator<Item = (ViewId, [PointId; 2], u32)> + '_ {
        let segments = self.segments.table();
        segments.all().map(|segment| {
            (
                ViewId(segments.view(segment)),
                segments.points(segment).map(PointId),
                segments.weight(segment),
            )
        })
    }

    /// Number of entries in the crossing lists: pairs of a ray and a cell that it crosses, ghost cells included, or runs
    /// in the boundary of.
    pub fn crossing_count(&self) -> u64 {
        self.rays.crossings().total()
    }

    /// Bytes of the crossing lists, the largest part of the memory.
    pub fn crossing_bytes(&self) -> usize {
        self.rays.crossings().bytes() + self.cells.weight_bytes()
    }

    /// Position of a point; `None` if it was removed or never added.
    pub fn point(&self, point: PointId) -> Option<Point3<f64>> {
        self.points
            .get(point.0)
            .map(|record| Point3::from(record.position))
    }

    /// Vertex of a point; shared by all points at the same position. `None` if it was removed or never added.
    pub fn vertex_of(&self, point: PointId) -> Option<VertexId> {
        self.points
            .get(point.0)
            .map(|record| VertexId::from_index(record.vertex as usize))
    }

    /// Standard deviation of a point along its rays, where it was given one.
    pub fn sigma(&self, point: PointId) -> Option<f64> {
        self.points.sigma(point.0)
    }

    /// Centre of a view; `None` if it was removed or never added.
    pub fn view(&self, view: ViewId) -> Option<Point3<f64>> {
        self.views
            .is_alive(view.0)
            .then(|| Point3::from(*self.views.center(view.0)))
    }

    /// Weight of an observation; `None` if there is none.
    pub fn observation(&self, view: ViewId, point: PointId) -> Option<u32> {
        let rays = self.rays.table();
        rays.find(view.0, [point.0]).map(|ray| rays.weight(ray))
    }

    /// The views that see a point, in no particular order; none if it was removed or never added.
    pub fn views_of(&self, point: PointId) -> impl Iterator<Item = ViewId> + '_ {
        let rays = self.rays.table();
        rays.of_point(point.0).map(|ray| ViewId(rays.view(ray)))
    }

    /// All observations with their weights, by view; within a view in no particular order.
    pub fn observations(&self) -> impl Iterator<Item = (ViewId, PointId, u32)> + '_ {
        let rays = self.rays.table();
        rays.all().map(|ray| {
            let [point] = rays.points(ray);
            (ViewId(rays.view(ray)), PointId(point), rays.weight(ray))
        })
    }

    /// Ids of all points, increasing.
    pub fn points(&self) -> impl Iterator<Item = PointId> + '_ {
        self.points.ids().map(PointId)
    }

    /// Ids of all views, increasing.
    pub fn views(&self) -> impl Iterator<Item = ViewId> + '_ {
        self.views.ids().map(ViewId)
    }

    /// Whether a cell is free. Ghost cells, the space outside the hull, never are.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    pub fn is_free(&self, cell: CellId) -> bool {
        self.facets.is_free(cell)
    }

    /// Total weight of the rays across a cell and of the segments whose triangles meet it. For a ghost cell: of those that enter the hull through its facet.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    pub fn weight(&self, cell: CellId) -> u64 {
        self.cells.weight(cell)
    }

    /// The observations whose rays cross a cell, in no particular order.
    ///
    /// # Panics
    ///
    /// For ids that were never given out.
    pub fn rays_across(&self, cell: CellId) -> impl Iterator<Item = (ViewId, PointId)> + '_ {
        let rays = self.rays.table();
        let listed = self.rays.crossings().of(cell);
        listed
            .filter(move |&ray| {
                !rays.is_degenerate(ray)
                    || self.rays.crosses(&self.tetrahedra, &self.views, ray, cell)
            })
            .map(|ray| {
                let [point] = rays.points(ray);
                (ViewId(rays.view(ray)), PointId(point))
            })
    }

    /// Number of surface triangles.
    pub fn triangle_count(&self) -> usize {
        self.facets.len()
    }

    /// All surface triangles, in no particular order; positions are those of
    /// [`tetrahedra`](Self::tetrahedra)`().position(vertex)`.
    pub fn triangles(&self) -> impl Iterator<Item = Triangle> + '_ {
        self.facets
            .iter()
            .map(|(cell, facet)| crate::surface::triangle(&self.tetrahedra, cell, facet))
    }

    /// Appends the surface triangles with a corner at `vertex`, as [`triangles`](Self::triangles) gives them, each once and
    /// in no particular order.
    ///
    /// # Complexity
    ///
    /// Linear in the number of cells around the vertex; `scratch` is reused memory.
    pub fn triangles_around(
        &self,
        vertex: VertexId,
        scratch: &mut IncidentCells,
        found: &mut Vec<Triangle>,
    ) {
        self.facets.around(&self.tetrahedra, vertex, scratch, found);
    }

    /// Whether no edge of a triangle is longer than `longest`.
    pub fn has_edges_within(&self, triangle: &Triangle, longest: f64) -> bool {
        crate::surface::has_edges_within(&self.tetrahedra, triangle, longest)
    }

    /// A copy of the surface, in an order that depends on the surface alone.
    ///
    /// # Complexity
    ///
    /// `n log n` in the number of triangles, and a scan of one byte a cell.
    pub fn mesh(&self, options: &ExportOptions) -> IndexedMesh {
        self.mesh_where(options, |_| true).0
    }

    /// The same of those triangles alone that `is_wanted`, which is given them as [`triangles`](Self::triangles) gives them,
    /// says to keep. The others count as part of their component, and are left out before anything is repaired. Beside the mesh the vertex of
    /// [`tetrahedra`](Self::tetrahedra) that each of its vertices is a copy of, `None` for midpoints of split edges.
    ///
    /// # Complexity
    ///
    /// As [`mesh`](Self::mesh); asks once a triangle.
    pub fn mesh_where(
        &self,
        options: &ExportOptions,
        is_wanted: impl Fn(Triangle) -> bool,
    ) -> (IndexedMesh, Vec<Option<VertexId>>) {
        crate::surface::extract(&self.tetrahedra, &self.facets, options, is_wanted)
    }

    /// Begins a set of changes that take effect together.
    pub fn transaction(&mut self) -> Transaction<'_> {
        Transaction::new(self)
    }

    /// The id of the next point to be added.
    pub fn next_point(&self) -> PointId {
        PointId(self.points.capacity() as u32)
    }

    /// The id of the next view to be added.
    pub fn next_view(&self) -> ViewId {
        ViewId(self.views.capacity() as u32)
    }
}

/// The points of a segment as keys hold them.
fn ordered(ends: [PointId; 2]) -> [u32; 2] {
    let [a, b] = ends.map(|end| end.0);
    [a.min(b), a.max(b)]
}

#[cfg(test)]
mod tests;
