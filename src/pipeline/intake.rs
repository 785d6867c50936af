//! Where the measurements of keyframes go: to landmarks, and to the points of the carver.

use linecarve_carving::carver::{EventError, PointId, Transaction, ViewId};
use linecarve_lines::triangulation::ImageVertex;
use nalgebra::Point3;

use super::front_end::Keyframe;
use super::landmarks::{LandmarkOptions, Landmarks, Measurement, Observed, Settled};
use super::surface_points::{KeyframeSurface, SurfacePointOptions, Verdict};

/// No vertex, or no landmark.
const NONE: u32 = u32::MAX;

/// The landmarks of a map with their points, and what the keyframe in hand says about them.
pub(super) struct Intake {
    landmarks: Landmarks,
    /// The carver's id of each landmark.
    points: Vec<PointId>,
    /// What a standard deviation is multiplied by for the carver.
    sigma_factor: f64,
    /// Landmarks that the keyframe sees; with repetitions until they are painted.
    seen: Vec<u32>,
    /// Landmarks that it looked through.
    contradicted: Vec<u32>,
    /// Pairs of landmarks between which it sees a stretch of a segment.
    stretches: Vec<[u32; 2]>,
    /// Pairs of landmarks joined by an edge of its triangulation that the surface follows.
    edges: Vec<[u32; 2]>,
    verdicts: Vec<(u32, Verdict)>,
    /// Vertex of each landmark in the triangulation, [`NONE`] without one.
    vertex_of: Vec<u32>,
    vertices: Vec<ImageVertex>,
    /// Landmark of each vertex.
    landmark_of: Vec<u32>,
}

impl Intake {
    /// No landmark yet. The carver is given each standard deviation times `sigma_factor`.
    pub(super) fn new(options: LandmarkOptions, sigma_factor: f64) -> Self {
        Self {
            landmarks: Landmarks::new(options),
            points: Vec::new(),
            sigma_factor,
            seen: Vec::new(),
            contradicted: Vec::new(),
            stretches: Vec::new(),
            edges: Vec::new(),
            verdicts: Vec::new(),
            vertex_of: Vec::new(),
            vertices: Vec::new(),
            landmark_of: Vec::new(),
        }
    }

    /// The landmarks of the map.
    pub(super) fn landmarks(&self) -> &Landmarks {
        &self.landmarks
    }

    /// The carver's id of each landmark; those given up keep theirs, which is no longer in use there.
    pub(super) fn points(&self) -> &[PointId] {
        &self.points
    }

    /// Landmarks that the keyframe sees, increasing once they are painted.
    pub(super) fn seen(&self) -> &[u32] {
        &self.seen
    }

    /// Landmarks that the keyframe looked through.
    pub(super) fn contradicted(&self) -> &[u32] {
        &self.contradicted
    }

    /// Begins a keyframe.
    pub(super) fn begin(&mut self) {
        self.seen.clear();
        self.contradicted.clear();
        self.stretches.clear();
        self.edges.clear();
        self.verdicts.clear();
        self.vertex_of.clear();
        self.vertices.clear();
        self.landmark_of.clear();
    }

    /// Joins a measurement to its landmark, which is returned.
    fn take(
        &mut self,
        transaction: &mut Transaction<'_>,
        measurement: &Measurement,
    ) -> Result<u32, EventError> {
        let landmark = match self.landmarks.observe(measurement) {
            Observed::New(landmark) => {
                let point = transaction.add_point(measurement.point_in_world)?;
                let sigma = self.sigma_factor * measurement.sigma;
                transaction.set_sigma(point, Some(sigma))?;
                self.points.push(point);
                landmark
            }
            Observed::Again(landmark) => landmark,
        };
        self.seen.push(landmark);
        Ok(landmark)
    }

    /// Takes the points along a segment, in their order.
    pub(super) fn take_segment(
        &mut self,
        transaction: &mut Transaction<'_>,
        measurements: impl Iterator<Item = Measurement>,
    ) -> Result<(), EventError> {
        let mut last = None;
        for measurement in measurements {
            let landmark = self.take(transaction, &measurement)?;
            if let Some(last) = last.filter(|last| *last != landmark) {
                self.stretches.push(pair(last, landmark));
            }
            last = Some(landmark);
        }
        Ok(())
    }

    /// Takes single points, after those of segments and surface are settled. As seen only those remain listed that were not
    /// before.
    pub(super) fn take_points(
        &mut self,
        transaction: &mut Transaction<'_>,
        measurements: impl Iterator<Item = Measurement>,
    ) -> Result<(), EventError> {
        let before = std::mem::take(&mut self.seen);
        for measurement in measurements {
            self.take(transaction, &measurement)?;
        }
        let landmarks = &self.landmarks;
        self.seen.retain(|landmark| {
            before.binary_search(landmark).is_err() && landmarks.is_in_use(*landmark)
        });
        Ok(())
    }

    /// Asks the keyframe's surface about all landmarks in its reach and takes the points that they lack.
    pub(super) fn take_surface(
        &mut self,
        transaction: &mut Transaction<'_>,
        surface: &KeyframeSurface<'_>,
        options: &SurfacePointOptions,
    ) -> Result<(), EventError> {
        self.vertex_of.resize(self.points.len(), NONE);
        for place in 0..self.seen.len() {
            let landmark = self.seen[place];
            if self.vertex_of[landmark as usize] == NONE
                && let Some(vertex) = surface.vertex(&self.landmarks.position(landmark))
            {
                self.add_vertex(landmark, vertex);
            }
        }
        let everything = [f64::NEG_INFINITY, f64::INFINITY].map(|all| Point3::new(all, all, all));
        let reach = surface.reach().unwrap_or(everything);
        for (landmark, position) in self.landmarks.within(reach) {
            if self.vertex_of[landmark as usize] == NONE {
                match surface.judge(&position) {
                    Verdict::Silent => {}
                    verdict => self.verdicts.push((landmark, verdict)),
                }
            }
        }
        // Oldest first, whatever the shape of the index.
        self.verdicts
            .sort_unstable_by_key(|(landmark, _)| *landmark);
        for place in 0..self.verdicts.len() {
            let (landmark, verdict) = self.verdicts[place];
            if let Verdict::Confirmed {
                vertex,
                measurement,
            } = verdict
            {
                self.landmarks.confirm(landmark, &measurement);
                self.seen.push(landmark);
                self.add_vertex(landmark, vertex);
            } else {
                self.landmarks.contradict(landmark);
                self.contradicted.push(landmark);
            }
        }
        let vertex_of = |landmark: u32| self.vertex_of[landmark as usize];
        let lines: Vec<[u32; 2]> = self
            .stretches
            .iter()
            .map(|stretch| stretch.map(vertex_of))
            .collect();
        let refined = surface.refine(&self.vertices, &lines, &options.refine);
        for missing in &refined.missing {
            let landmark = match missing {
                Some(measurement) => self.take(transaction, measurement)?,
                None => NONE,
            };
            self.landmark_of.push(landmark);
        }
        let landmark_of = &self.landmark_of;
        self.edges.extend(
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
        self.vertex_of[landmark as usize] = self.vertices.len() as u32;
        self.vertices.push(vertex);
        self.landmark_of.push(landmark);
    }

    /// Notes the colours of all landmarks that the keyframe sees, once each.
    pub(super) fn paint(&mut self, keyframe: &Keyframe, surface: &KeyframeSurface<'_>) {
        self.seen.sort_unstable();
        self.seen.dedup();
        for &landmark in &self.seen {
            let vertex = surface.vertex(&self.landmarks.position(landmark));
            if let Some(color) = vertex.and_then(|vertex| keyframe.colors.at(&vertex.pixel)) {
                self.landmarks.paint(landmark, color);
            }
        }
    }

    /// Settles the landmarks that the keyframe concerns; returns how many points moved and how many were removed. Those are
    /// no longer listed as seen.
    pub(super) fn settle(
        &mut self,
        transaction: &mut Transaction<'_>,
    ) -> Result<(usize, usize), EventError> {
        let (mut moved, mut removed) = (0, 0);
        for &landmark in self.contradicted.iter().chain(&self.seen) {
            let point = self.points[landmark as usize];
            match self.landmarks.settle(landmark) {
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
        let landmarks = &self.landmarks;
        self.seen.retain(|landmark| landmarks.is_in_use(*landmark));
        Ok((moved, removed))
    }

    /// Adds the observations of the landmarks seen: one ray from a camera to a point, however many segments of the keyframe
    /// meet in it.
    pub(super) fn observe(
        &self,
        transaction: &mut Transaction<'_>,
        view: ViewId,
    ) -> Result<(), EventError> {
        for landmark in &self.seen {
            transaction.add_observation(view, self.points[*landmark as usize], 1)?;
        }
        Ok(())
    }

    /// Adds the stretches of segments and the edges of the triangulation as segments that the view sees, with these
    /// weights; with 0 none.
    pub(super) fn observe_between(
        &mut self,
        transaction: &mut Transaction<'_>,
        view: ViewId,
        stretch_weight: u32,
        edge_weight: u32,
    ) -> Result<(), EventError> {
        for (pairs, weight) in [
            (&mut self.stretches, stretch_weight),
            (&mut self.edges, edge_weight),
        ] {
            if weight == 0 {
                continue;
            }
            pairs.sort_unstable();
            pairs.dedup();
            let is_in_use = |landmark: &u32| self.landmarks.is_in_use(*landmark);
            for ends in pairs.iter().filter(|ends| ends.iter().all(is_in_use)) {
                let ends = ends.map(|landmark| self.points[landmark as usize]);
                transaction.add_segment(view, ends, weight)?;
            }
        }
        Ok(())
    }
}

/// A pair in one order.
fn pair(a: u32, b: u32) -> [u32; 2] {
    [a.min(b), a.max(b)]
}
