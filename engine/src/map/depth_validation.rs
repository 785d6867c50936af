//! Validates the triangles of the carved surface against dense depth.
//!
//! Carving leaves two kinds of spurious triangles: those across an occlusion shadow, which no keyframe saw, and those of
//! free tetrahedra that no ray crosses. Dense depth identifies both, as no keyframe measured a surface along them. The exported
//! surface omits them, or the part of them along which no surface was measured.
//!
//! *Differs from the paper*, which exports every facet between free and occupied cells.

mod parts;
mod samples;

use linecarve_carving::IncidentCells;
use linecarve_carving::{SurfaceDelta, Triangle, TrianglePart, VertexId, ViewId};
use linecarve_lines::camera::Camera;
use linecarve_lines::triangulation::SurfaceSamples;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use self::samples::Samples;
use super::surface_points::KeyframeSurface;
use super::vertex_landmarks::VertexViews;
use crate::options::SurfacePointOptions;

/// Subdivisions of each edge of a triangle; the centres of the upright sub-triangles are its samples.
const SUBDIVISIONS: u32 = 6;
/// Number of samples of a triangle; each has one bit in [`FacetEvidence`].
const SAMPLE_COUNT: u32 = SUBDIVISIONS * (SUBDIVISIONS + 1) / 2;
const ALL_SAMPLES: u32 = (1 << SAMPLE_COUNT) - 1;
/// Most earlier keyframes that a keyframe is compared with, to find what they disagree about.
const COMPARED: usize = 8;

/// The dense depth of one keyframe.
#[derive(Debug, Clone)]
struct DenseView {
    world_from_camera: Isometry3<f64>,
    surface: SurfaceSamples,
    /// Mean of the measured points, in the frame of the camera.
    middle: Point3<f64>,
}

/// Whether dense depth confirms a triangle of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FacetStatus {
    /// Keyframes measured the surface along it.
    Measured,
    /// Keyframes measured the surface along a part of it.
    PartlyMeasured(TrianglePart),
    /// Keyframes observe it and did not measure a surface along it.
    NotMeasured,
    /// No keyframe that observes it has dense depth.
    Unobserved,
}

/// Dense depth compared with the samples of one triangle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct FacetEvidence {
    /// Samples on a measured surface, as a bit set.
    agreed: u32,
    /// Samples in front of a measured surface, as a bit set.
    contradicted: u32,
    /// Whether a view with dense depth observes a corner of the triangle.
    is_observed: bool,
    /// The part that is measured, of a triangle that is not measured as a whole.
    part: Option<TrianglePart>,
}

/// Depth evidence for each triangle of the surface. It depends on the surface, the observations, the depth and what keyframes were
/// known to disagree about when it was found.
pub(super) struct DepthValidation {
    /// Least share of measured samples of a triangle that is exported as a whole.
    least_share: f64,
    /// Least area of the part of a triangle that is exported without the rest.
    least_area: f64,
    camera: Camera,
    options: SurfacePointOptions,
    /// See [`KeyframeSurface::new`].
    disagreement: f64,
    /// Indexed by view.
    dense_views: Vec<Option<DenseView>>,
    /// The view added last.
    newest: Option<ViewId>,
    triangles: FxHashMap<Triangle, FacetEvidence>,
    /// The vertices around which the evidence of every triangle is complete are not among these.
    open_vertices: VertexSet,
    /// Triangles whose status may have changed.
    changed: Vec<Triangle>,
}

impl FacetEvidence {
    /// Whether the share of measured samples, less that of contradicted ones, is large enough.
    fn is_measured(&self, least_share: f64) -> bool {
        let looked_through = self.contradicted & !self.agreed;
        let balance = self.agreed.count_ones() as i32 - looked_through.count_ones() as i32;
        f64::from(balance) >= least_share * f64::from(SAMPLE_COUNT)
    }

    fn status(&self, least_share: f64) -> FacetStatus {
        match (self.is_observed, self.is_measured(least_share), self.part) {
            (false, _, _) => FacetStatus::Unobserved,
            (true, true, _) => FacetStatus::Measured,
            (true, false, Some(part)) => FacetStatus::PartlyMeasured(part),
            (true, false, None) => FacetStatus::NotMeasured,
        }
    }

    /// Whether further views cannot change the evidence.
    fn is_complete(&self) -> bool {
        self.agreed == ALL_SAMPLES
    }
}

impl DepthValidation {
    /// No keyframe yet. A triangle is exported when at least `least_share` of it is measured; with 0 all are. Samples of keyframes are
    /// `spacing` apart: smaller parts of triangles than those between three of them are not exported.
    pub(super) fn new(
        least_share: f64,
        spacing: f64,
        camera: &Camera,
        options: &SurfacePointOptions,
    ) -> Self {
        Self {
            least_share,
            least_area: 0.5 * spacing * spacing,
            camera: camera.clone(),
            options: *options,
            disagreement: 0.0,
            dense_views: Vec::new(),
            newest: None,
            triangles: FxHashMap::default(),
            open_vertices: VertexSet::default(),
            changed: Vec::new(),
        }
    }

    /// From now on the depth of a keyframe is off by this standard deviation, as a share of the depth, seen from another one.
    pub(super) fn set_disagreement(&mut self, disagreement: f64) {
        self.disagreement = disagreement;
    }

    /// Whether dense depth confirms a triangle of the surface.
    pub(super) fn status(&self, triangle: &Triangle) -> FacetStatus {
        let evidence = self.triangles.get(triangle);
        evidence.map_or(FacetStatus::Unobserved, |evidence| {
            evidence.status(self.least_share)
        })
    }

    /// Triangles whose status may have changed since the last call, in no particular order.
    pub(super) fn take_changed(&mut self) -> Vec<Triangle> {
        std::mem::take(&mut self.changed)
    }

    /// Adds a view with depth `surface`; its landmarks follow with [`update`](Self::update), or all with
    /// [`validate_anew`](Self::validate_anew).
    pub(super) fn add_view(
        &mut self,
        view: ViewId,
        world_from_camera: &Isometry3<f64>,
        surface: &SurfaceSamples,
    ) {
        if self.least_share <= 0.0 {
            return;
        }
        let index = view.0 as usize;
        if index >= self.dense_views.len() {
            self.dense_views.resize(index + 1, None);
        }
        let identity = Isometry3::identity();
        let in_camera = KeyframeSurface::new(surface, &self.camera, &identity, &self.options, 0.0);
        self.dense_views[index] = in_camera.middle().map(|middle| DenseView {
            world_from_camera: *world_from_camera,
            surface: surface.thinned(),
            middle,
        });
        self.newest = Some(view);
    }

    /// Updates the evidence after a commit in which the last view gained the landmarks `seen`.
    ///
    /// # Complexity
    /// The new triangles, and those around observed landmarks with an incomplete one, times the views that observe them.
    pub(super) fn update(&mut self, map: VertexViews<'_>, delta: &SurfaceDelta, seen: &[u32]) {
        let Some(newest) = self.newest else {
            for triangle in &delta.added {
                self.open_vertices.insert_corners(triangle);
            }
            return;
        };
        for triangle in &delta.removed {
            self.triangles.remove(triangle);
        }
        let mut scratch = IncidentCells::new();
        let mut affected: Vec<Triangle> = Vec::new();
        for &vertex in &delta.moved {
            map.carver()
                .triangles_around(vertex, &mut scratch, &mut affected);
        }
        for triangle in &affected {
            self.triangles.remove(triangle);
        }
        affected.extend(&delta.added);
        for vertex in seen.iter().filter_map(|landmark| map.vertex(*landmark)) {
            // Opened again by the triangles that stay incomplete.
            if !self.open_vertices.remove(vertex) {
                continue;
            }
            map.carver()
                .triangles_around(vertex, &mut scratch, &mut affected);
        }
        affected.sort_unstable();
        affected.dedup();
        let incomplete: Vec<(Triangle, Option<FacetEvidence>)> = affected
            .into_iter()
            .map(|triangle| (triangle, self.triangles.get(&triangle).copied()))
            .filter(|(_, known)| known.is_none_or(|known| !known.is_complete()))
            .collect();
        self.update_evidence(map, incomplete, newest.0);
    }

    /// Makes the evidence of all triangles anew, so that it does not depend on what was known when each of them came.
    ///
    /// # Complexity
    /// All triangles times the views that observe them.
    pub(super) fn validate_anew(&mut self, map: VertexViews<'_>) {
        let Some(newest) = self.newest else {
            return;
        };
        self.triangles.clear();
        let mut triangles = map.surface().triangles();
        triangles.sort_unstable();
        let without_evidence = triangles.into_iter().map(|triangle| (triangle, None));
        self.update_evidence(map, without_evidence.collect(), newest.0);
    }

    /// Gives a view another pose, or removes its depth. Follow with [`look_again`](Self::look_again).
    pub(super) fn correct(&mut self, view: ViewId, world_from_camera: Option<&Isometry3<f64>>) {
        let Some(dense_view) = self.dense_views.get_mut(view.0 as usize) else {
            return;
        };
        match (world_from_camera, dense_view) {
            (Some(pose), Some(dense_view)) => dense_view.world_from_camera = *pose,
            (None, dense_view) => *dense_view = None,
            (Some(_), None) => {}
        }
    }

    /// Makes the evidence of all triangles around these landmarks anew, after the views that observe them were
    /// [corrected](Self::correct) and the surface changed by `delta`.
    ///
    /// # Complexity
    /// The triangles around the landmarks times the views that observe them.
    pub(super) fn look_again(
        &mut self,
        map: VertexViews<'_>,
        delta: &SurfaceDelta,
        landmarks: &[u32],
    ) {
        let mut scratch = IncidentCells::new();
        let mut around: Vec<Triangle> = Vec::new();
        for vertex in landmarks
            .iter()
            .filter_map(|landmark| map.vertex(*landmark))
        {
            map.carver()
                .triangles_around(vertex, &mut scratch, &mut around);
        }
        for triangle in &around {
            self.triangles.remove(triangle);
            self.open_vertices.insert_corners(triangle);
        }
        self.update(map, delta, landmarks);
    }

    /// The surfaces of all keyframes that have one, in their order.
    pub(super) fn surfaces(&self) -> impl Iterator<Item = KeyframeSurface<'_>> {
        let views = 0..self.dense_views.len() as u32;
        views.filter_map(|view| self.dense_view(view))
    }

    /// The surface of the view added last.
    pub(super) fn newest(&self) -> Option<KeyframeSurface<'_>> {
        self.surface_of(self.newest?)
    }

    /// Dense surfaces with their middle in the view of another: at most [`COMPARED`], evenly from the first to the last.
    ///
    /// # Complexity
    /// One projection for each view.
    pub(super) fn in_view_of(
        &self,
        surface: &KeyframeSurface<'_>,
    ) -> impl Iterator<Item = KeyframeSurface<'_>> {
        let views = self.dense_views.iter().zip(0..);
        let in_view = views.filter_map(|(view, number)| {
            let view = view.as_ref()?;
            let middle = view.world_from_camera * view.middle;
            surface.is_in_view(&middle).then_some(number)
        });
        let in_view: Vec<u32> = in_view.collect();
        let compared = in_view.len().min(COMPARED);
        let chosen = (0..compared).map(move |index| in_view[index * in_view.len() / compared]);
        chosen.filter_map(|view| self.dense_view(view))
    }

    /// The depth of a view; `None` when it has none between edges.
    pub(super) fn surface_of(&self, view: ViewId) -> Option<KeyframeSurface<'_>> {
        self.dense_view(view.0)
    }

    /// The depth of the view with this number.
    fn dense_view(&self, view: u32) -> Option<KeyframeSurface<'_>> {
        let dense_view = self.dense_views.get(view as usize)?.as_ref()?;
        Some(KeyframeSurface::new(
            &dense_view.surface,
            &self.camera,
            &dense_view.world_from_camera,
            &self.options,
            self.disagreement,
        ))
    }

    /// Updates the evidence of triangles: from all views where there is none yet, else from the last view alone.
    fn update_evidence(
        &mut self,
        map: VertexViews<'_>,
        triangles: Vec<(Triangle, Option<FacetEvidence>)>,
        last: u32,
    ) {
        let (least_share, least_area) = (self.least_share, self.least_area);
        let updated: Vec<(Triangle, UpdatedEvidence)> = triangles
            .into_par_iter()
            .map_init(Vec::new, |views, (triangle, known)| {
                views.clear();
                match known {
                    Some(_) => views.push(last),
                    None => {
                        let seeing = triangle.iter().flat_map(|v| map.views(*v));
                        views.extend(seeing.map(|view| view.0));
                        views.sort_unstable();
                        views.dedup();
                    }
                }
                let samples = Samples::of(triangle.map(|v| map.surface().position(v)));
                let mut evidence = known.unwrap_or_default();
                for dense_view in views.iter().filter_map(|view| self.dense_view(*view)) {
                    samples.compare(&dense_view, &mut evidence);
                    if evidence.is_complete() {
                        break;
                    }
                }
                let is_whole = evidence.is_measured(least_share);
                evidence.part = (!is_whole)
                    .then(|| samples.measured_part(&evidence, least_area))
                    .flatten();
                let status = evidence.status(least_share);
                let is_changed = known.is_none_or(|known| known.status(least_share) != status);
                let updated = UpdatedEvidence {
                    evidence,
                    is_changed,
                };
                (triangle, updated)
            })
            .collect();
        for (triangle, updated) in updated {
            self.triangles.insert(triangle, updated.evidence);
            if !updated.evidence.is_complete() {
                self.open_vertices.insert_corners(&triangle);
            }
            if updated.is_changed {
                self.changed.push(triangle);
            }
        }
    }
}

/// A set of vertices, one byte each.
#[derive(Debug, Default)]
struct VertexSet(Vec<bool>);

impl VertexSet {
    /// Inserts the corners of a triangle.
    fn insert_corners(&mut self, triangle: &Triangle) {
        for vertex in triangle {
            let needed = vertex.index() + 1;
            self.0.resize(needed.max(self.0.len()), false);
            self.0[vertex.index()] = true;
        }
    }

    /// Removes a vertex; returns whether it was there.
    fn remove(&mut self, vertex: VertexId) -> bool {
        let entry = self.0.get_mut(vertex.index());
        entry.is_some_and(std::mem::take)
    }
}

/// The evidence for a triangle after an update.
struct UpdatedEvidence {
    evidence: FacetEvidence,
    /// Whether its status may be another one than before.
    is_changed: bool,
}

#[cfg(test)]
mod tests;
