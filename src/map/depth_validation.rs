//! Which triangles of the surface keyframes have measured.
//!
//! Carving leaves two kinds of triangles that are no surface: those that span the shadow behind an outline, where no
//! keyframe looked, and those of tetrahedra in free space that no ray to a point happens to cross. Where depth is dense
//! both can be told apart from the rest: along them no keyframe measured a surface. They are left out of what is written.
//!
//! *Differs from the paper*, which writes every facet between free and occupied.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use linecarve_carving::IncidentCells;
use linecarve_carving::{SurfaceDelta, Triangle};
use linecarve_lines::camera::Camera;
use linecarve_lines::triangulation::SurfaceSamples;
use nalgebra::{Isometry3, Point2, Point3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::surface_points::{KeyframeSurface, SurfacePointOptions};
use super::vertex_points::Observers;

/// A triangle is asked about at the centres of `PARTS` * (`PARTS` + 1) / 2 of the triangles that it is divided into.
const PARTS: u32 = 6;
/// Number of places of a triangle that are asked about; a bit each in [`Evidence::agreed`].
const PLACES: u32 = PARTS * (PARTS + 1) / 2;
const ALL_PLACES: u32 = (1 << PLACES) - 1;
/// A keyframe is a witness when its surface is known at this share of its samples at least: depth along edges alone says
/// nothing about what is between them.
const DENSE_SHARE: f64 = 0.2;

/// The dense depth of one keyframe.
#[derive(Debug, Clone)]
struct Witness {
    world_from_camera: Isometry3<f64>,
    surface: SurfaceSamples,
}

/// What keyframes say about a triangle of the surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum FacetStatus {
    /// They measured the surface along it.
    Measured,
    /// They would have measured it if it were surface.
    NotMeasured,
    /// None that sees it has dense depth.
    Unobserved,
}

/// What is known about one triangle.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
struct Evidence {
    /// The places where a witness measured the surface.
    agreed: u32,
    /// The places behind which a witness measured it.
    contradicted: u32,
    /// Whether any witness sees a corner of the triangle.
    is_witnessed: bool,
}

/// Which triangles of the surface keyframes have measured. A function of the surface, of which keyframes see which point
/// and of their depth, whatever led to it.
pub(super) struct DepthValidation {
    /// Least share of the places of a triangle where its surface has been measured.
    least_share: f64,
    camera: Camera,
    options: SurfacePointOptions,
    /// By the view's number.
    witnesses: Vec<Option<Witness>>,
    triangles: FxHashMap<Triangle, Evidence>,
}

impl Evidence {
    /// Whether so much has been measured that the triangle counts as surface.
    fn suffices(&self, least_share: f64) -> bool {
        let looked_through = self.contradicted & !self.agreed;
        let balance = self.agreed.count_ones() as i32 - looked_through.count_ones() as i32;
        f64::from(balance) >= least_share * f64::from(PLACES)
    }

    /// Whether no further witness can change anything.
    fn is_complete(&self) -> bool {
        self.agreed == ALL_PLACES
    }
}

impl DepthValidation {
    /// No keyframe yet. A triangle is surface when at least `least_share` of it has been measured; with 0 every triangle is.
    pub(super) fn new(least_share: f64, camera: &Camera, options: &SurfacePointOptions) -> Self {
        Self {
            least_share,
            camera: camera.clone(),
            options: *options,
            witnesses: Vec::new(),
            triangles: FxHashMap::default(),
        }
    }

    /// What keyframes say about a triangle of the surface.
    pub(super) fn status(&self, triangle: &Triangle) -> FacetStatus {
        match self.triangles.get(triangle) {
            Some(evidence) if evidence.is_witnessed => {
                if evidence.suffices(self.least_share) {
                    FacetStatus::Measured
                } else {
                    FacetStatus::NotMeasured
                }
            }
            _ => FacetStatus::Unobserved,
        }
    }

    /// Follows the commit that added the next view, which sees the landmarks `seen` and whose depth is `surface`. Returns
    /// the pixels of that view where it measured a surface well behind a triangle, at most one in each square of
    /// [`minimum_distance_px`](linecarve_lines::triangulation::RefineOptions::minimum_distance_px), in the order of the squares.
    ///
    /// # Complexity
    /// The new triangles, and those around what the view sees that lack evidence, times the views that see them.
    pub(super) fn push(
        &mut self,
        map: Observers<'_>,
        delta: &SurfaceDelta,
        seen: &[u32],
        world_from_camera: &Isometry3<f64>,
        surface: &SurfaceSamples,
    ) -> Vec<Point2<f64>> {
        if self.least_share <= 0.0 {
            return Vec::new();
        }
        let total = (surface.columns() * surface.rows()) as f64;
        let is_dense = total > 0.0 && surface.known_count() as f64 >= DENSE_SHARE * total;
        self.witnesses.push(is_dense.then(|| Witness {
            world_from_camera: *world_from_camera,
            surface: surface.thinned(),
        }));
        self.follow(map, delta, seen)
    }

    /// Follows another commit, after which the last view sees the landmarks `seen` too. Returns what
    /// [`push`](Self::push) does.
    pub(super) fn follow(
        &mut self,
        map: Observers<'_>,
        delta: &SurfaceDelta,
        seen: &[u32],
    ) -> Vec<Point2<f64>> {
        let Some(last) = self.witnesses.len().checked_sub(1) else {
            return Vec::new();
        };
        for triangle in &delta.removed {
            self.triangles.remove(triangle);
        }
        let mut scratch = IncidentCells::new();
        let mut concerned: Vec<Triangle> = Vec::new();
        for &vertex in &delta.moved {
            map.carver()
                .triangles_around(vertex, &mut scratch, &mut concerned);
        }
        for triangle in &concerned {
            self.triangles.remove(triangle);
        }
        concerned.extend(&delta.added);
        for vertex in seen.iter().filter_map(|landmark| map.vertex(*landmark)) {
            map.carver()
                .triangles_around(vertex, &mut scratch, &mut concerned);
        }
        concerned.sort_unstable();
        concerned.dedup();
        let examined: Vec<(Triangle, Option<Evidence>)> = concerned
            .into_iter()
            .map(|triangle| (triangle, self.triangles.get(&triangle).copied()))
            .filter(|(_, known)| known.is_none_or(|known| !known.is_complete()))
            .collect();
        self.examine(map, examined, last as u32)
    }

    /// The dense depth of a view, if it has any.
    fn witness(&self, view: u32) -> Option<KeyframeSurface<'_>> {
        let witness = self.witnesses.get(view as usize)?.as_ref()?;
        Some(KeyframeSurface::new(
            &witness.surface,
            &self.camera,
            &witness.world_from_camera,
            &self.options,
        ))
    }

    /// Gathers the evidence for triangles, from the last view alone for those that have some; returns where the last view
    /// contradicts those without enough.
    fn examine(
        &mut self,
        map: Observers<'_>,
        triangles: Vec<(Triangle, Option<Evidence>)>,
        last: u32,
    ) -> Vec<Point2<f64>> {
        let newest = self.witness(last);
        let least_share = self.least_share;
        let bound = self.options.correction_sigmas;
        let examined: Vec<(Triangle, Evidence, Option<Contradiction>)> = triangles
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
                let places = Places::of(triangle.map(|v| map.carver().tetrahedra().position(v)));
                let mut evidence = known.unwrap_or_default();
                for witness in views.iter().filter_map(|view| self.witness(*view)) {
                    places.ask(&witness, &mut evidence);
                    if evidence.is_complete() {
                        break;
                    }
                }
                let contradiction = match &newest {
                    Some(witness) if !evidence.suffices(least_share) => {
                        places.contradiction(witness, bound)
                    }
                    _ => None,
                };
                (triangle, evidence, contradiction)
            })
            .collect();
        let mut largest: BTreeMap<[i64; 2], Contradiction> = BTreeMap::new();
        let side = self.options.refine.minimum_distance_px;
        for (triangle, evidence, contradiction) in examined {
            self.triangles.insert(triangle, evidence);
            let Some(found) = contradiction else {
                continue;
            };
            let square = [found.pixel.x, found.pixel.y].map(|along| (along / side).floor() as i64);
            let kept = largest.entry(square).or_insert(found);
            if found.is_larger_than(kept) {
                *kept = found;
            }
        }
        largest.into_values().map(|found| found.pixel).collect()
    }
}

/// Where a witness measured a surface behind a triangle.
#[derive(Debug, Clone, Copy)]
struct Contradiction {
    /// How far behind, in standard deviations.
    sigmas: f64,
    pixel: Point2<f64>,
}

impl Contradiction {
    /// A total order, so that the largest does not depend on the order of triangles.
    fn is_larger_than(&self, other: &Self) -> bool {
        self.sigmas
            .total_cmp(&other.sigmas)
            .then(other.pixel.x.total_cmp(&self.pixel.x))
            .then(other.pixel.y.total_cmp(&self.pixel.y))
            .is_gt()
    }
}

/// The places of a triangle that witnesses are asked about.
struct Places([Point3<f64>; PLACES as usize]);

impl Places {
    fn of(corners: [Point3<f64>; 3]) -> Self {
        let share = |index: u32| (f64::from(index) + 1.0 / 3.0) / f64::from(PARTS);
        let mut places = [Point3::origin(); PLACES as usize];
        let pairs = (0..PARTS).flat_map(|i| (0..PARTS - i).map(move |j| (i, j)));
        for (place, (i, j)) in places.iter_mut().zip(pairs) {
            *place = corners[2]
                + share(i) * (corners[0] - corners[2])
                + share(j) * (corners[1] - corners[2]);
        }
        Self(places)
    }

    /// Adds what a witness says.
    fn ask(&self, witness: &KeyframeSurface<'_>, evidence: &mut Evidence) {
        evidence.is_witnessed = true;
        for (place, point) in self.0.iter().enumerate() {
            let bit = 1 << place;
            if evidence.agreed & bit != 0 {
                continue;
            }
            match witness.side(point) {
                Some(Ordering::Equal) => evidence.agreed |= bit,
                Some(Ordering::Less) => evidence.contradicted |= bit,
                // Behind the surface that was measured, hidden.
                Some(Ordering::Greater) | None => {}
            }
        }
    }

    /// Where a witness measured a surface furthest behind the triangle, if by more than a bound.
    fn contradiction(&self, witness: &KeyframeSurface<'_>, bound: f64) -> Option<Contradiction> {
        self.0
            .iter()
            .filter_map(|place| {
                let (pixel, sigmas) = witness.deviation(place)?;
                (sigmas > bound).then_some(Contradiction { sigmas, pixel })
            })
            .reduce(|kept, found| {
                if found.is_larger_than(&kept) {
                    found
                } else {
                    kept
                }
            })
    }
}

#[cfg(test)]
mod tests;
