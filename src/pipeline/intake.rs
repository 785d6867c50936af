//! Where the measurements of one keyframe go: to landmarks, and to the points of the carver.

use linecarve_carving::carver::{EventError, PointId, Transaction};
use linecarve_lines::triangulation::ImageVertex;
use nalgebra::Point3;

use super::front_end::Keyframe;
use super::landmarks::{Landmarks, Measurement, Observed, Settled};
use super::surface_points::{KeyframeSurface, SurfacePointOptions, Verdict};

/// Memory that is reused from one keyframe to the next.
#[derive(Debug, Default)]
pub(super) struct IntakeScratch {
    /// Landmarks that the keyframe sees, with repetitions.
    pub(super) seen: Vec<u32>,
    /// Landmarks that it looked through.
    pub(super) contradicted: Vec<u32>,
    /// Pairs of landmarks between which it sees a stretch of a segment.
    pub(super) stretches: Vec<[u32; 2]>,
    /// Pairs of landmarks joined by an edge of its triangulation that the surface follows.
    pub(super) edges: Vec<[u32; 2]>,
    verdicts: Vec<(u32, Verdict)>,
    /// Vertex of each landmark in the triangulation, `u32::MAX` without one.
    vertex_of: Vec<u32>,
    vertices: Vec<ImageVertex>,
    /// Landmark of each vertex.
    landmark_of: Vec<u32>,
}

impl IntakeScratch {
    fn clear(&mut self) {
        self.seen.clear();
        self.contradicted.clear();
        self.stretches.clear();
        self.edges.clear();
        self.verdicts.clear();
        self.vertex_of.clear();
        self.vertices.clear();
        self.landmark_of.clear();
    }
}

/// No vertex, or no landmark.
const NONE: u32 = u32::MAX;

/// Where the measurements of one keyframe go.
pub(super) struct Intake<'a, 'b> {
    pub(super) landmarks: &'a mut Landmarks,
    /// The carver's id of each landmark.
    pub(super) points: &'a mut Vec<PointId>,
    pub(super) transaction: &'a mut Transaction<'b>,
    pub(super) scratch: &'a mut IntakeScratch,
    /// What a standard deviation is multiplied by for the carver.
    pub(super) sigma_factor: f64,
    pub(super) new_points: usize,
}

impl Intake<'_, '_> {
    /// Begins a keyframe.
    pub(super) fn begin(&mut self) {
        self.scratch.clear();
    }

    /// Joins a measurement to its landmark, which is returned.
    fn take(&mut self, measurement: &Measurement) -> Result<u32, EventError> {
        let landmark = match self.landmarks.observe(measurement) {
            Observed::New(landmark) => {
                let point = self.transaction.add_point(measurement.point_in_world)?;
                let sigma = self.sigma_factor * measurement.sigma;
                self.transaction.set_sigma(point, Some(sigma))?;
                self.points.push(point);
                self.new_points += 1;
                landmark
            }
            Observed::Again(landmark) => landmark,
        };
        self.scratch.seen.push(landmark);
        Ok(landmark)
    }

    /// Takes the points along a segment, in their order.
    pub(super) fn take_segment(
        &mut self,
        measurements: impl Iterator<Item = Measurement>,
    ) -> Result<(), EventError> {
        let mut last = None;
        for measurement in measurements {
            let landmark = self.take(&measurement)?;
            if let Some(last) = last.filter(|last| *last != landmark) {
                self.scratch.stretches.push(pair(last, landmark));
            }
            last = Some(landmark);
        }
        Ok(())
    }

    /// Takes single points; of the landmarks seen then only those remain listed that are not in `before`, which is sorted.
    pub(super) fn take_points(
        &mut self,
        measurements: impl Iterator<Item = Measurement>,
        before: &[u32],
    ) -> Result<(), EventError> {
        self.scratch.seen.clear();
        for measurement in measurements {
            self.take(&measurement)?;
        }
        let landmarks = &*self.landmarks;
        self.scratch.seen.retain(|landmark| {
            before.binary_search(landmark).is_err() && landmarks.is_in_use(*landmark)
        });
        Ok(())
    }

    /// Asks the keyframe's surface about all landmarks in its reach and takes the points that they lack.
    pub(super) fn take_surface(
        &mut self,
        surface: &KeyframeSurface<'_>,
        options: &SurfacePointOptions,
    ) -> Result<(), EventError> {
        self.scratch.vertex_of.resize(self.points.len(), NONE);
        for place in 0..self.scratch.seen.len() {
            let landmark = self.scratch.seen[place];
            if self.scratch.vertex_of[landmark as usize] == NONE
                && let Some(vertex) = surface.vertex(&self.landmarks.position(landmark))
            {
                self.add_vertex(landmark, vertex);
            }
        }
        let IntakeScratch {
            verdicts,
            vertex_of,
            ..
        } = &mut *self.scratch;
        let everything = [f64::NEG_INFINITY, f64::INFINITY].map(|all| Point3::new(all, all, all));
        let reach = surface.reach().unwrap_or(everything);
        for (landmark, position) in self.landmarks.within(reach) {
            if vertex_of[landmark as usize] == NONE {
                match surface.judge(&position) {
                    Verdict::Silent => {}
                    verdict => verdicts.push((landmark, verdict)),
                }
            }
        }
        // Oldest first, whatever the shape of the index.
        verdicts.sort_unstable_by_key(|(landmark, _)| *landmark);
        for place in 0..self.scratch.verdicts.len() {
            let (landmark, verdict) = self.scratch.verdicts[place];
            if let Verdict::Confirmed {
                vertex,
                measurement,
            } = verdict
            {
                self.landmarks.confirm(landmark, &measurement);
                self.scratch.seen.push(landmark);
                self.add_vertex(landmark, vertex);
            } else {
                self.landmarks.contradict(landmark);
                self.scratch.contradicted.push(landmark);
            }
        }
        let vertex_of = |landmark: u32| self.scratch.vertex_of[landmark as usize];
        let lines: Vec<[u32; 2]> = self
            .scratch
            .stretches
            .iter()
            .map(|stretch| stretch.map(vertex_of))
            .collect();
        let refined = surface.refine(&self.scratch.vertices, &lines, &options.refine);
        for missing in &refined.missing {
            let landmark = match missing {
                Some(measurement) => self.take(measurement)?,
                None => NONE,
            };
            self.scratch.landmark_of.push(landmark);
        }
        let landmark_of = &self.scratch.landmark_of;
        self.scratch.edges.extend(
            refined
                .edges
                .iter()
                .map(|edge| edge.map(|vertex| landmark_of[vertex as usize]))
                .filter(|[a, b]| a != b && *a != NONE && *b != NONE)
                .map(|[a, b]| pair(a, b)),
        );
        Ok(())
    }

    fn add_vertex(&mut self, landmark: u32, vertex: ImageVertex) {
        self.scratch.vertex_of[landmark as usize] = self.scratch.vertices.len() as u32;
        self.scratch.vertices.push(vertex);
        self.scratch.landmark_of.push(landmark);
    }

    /// Notes the colours of all landmarks that the keyframe sees, once each.
    pub(super) fn paint(&mut self, keyframe: &Keyframe, surface: &KeyframeSurface<'_>) {
        self.scratch.seen.sort_unstable();
        self.scratch.seen.dedup();
        for &landmark in &self.scratch.seen {
            let vertex = surface.vertex(&self.landmarks.position(landmark));
            if let Some(color) = vertex.and_then(|vertex| keyframe.colors.at(&vertex.pixel)) {
                self.landmarks.paint(landmark, color);
            }
        }
    }
}

/// A pair in one order.
fn pair(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}

/// Settles landmarks; returns how many points moved and how many were removed.
pub(super) fn settle(
    landmarks: &mut Landmarks,
    points: &[PointId],
    transaction: &mut Transaction<'_>,
    concerned: impl Iterator<Item = u32>,
) -> Result<(usize, usize), EventError> {
    let (mut moved, mut removed) = (0, 0);
    for landmark in concerned {
        let point = points[landmark as usize];
        match landmarks.settle(landmark) {
            Settled::Stays => {}
            Settled::Moved(position) => {
                transaction.move_point(point, position)?;
                moved += 1;
            }
            Settled::GivenUp => {
                transaction.remove_point(point)?;
                removed += 1;
            }
        }
    }
    Ok((moved, removed))
}
