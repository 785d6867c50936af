//! Fuses the measurements of a keyframe into landmarks and points of the carver.

mod follow;

use linecarve_carving::{PointId, Transaction, TransactionError};
use linecarve_lines::triangulation::{ImageVertex, SurfaceSample};
use nalgebra::Isometry3;

use crate::front_end::LineKeyframe;
use crate::map::keyframe_measurements::KeyframeMeasurements;
use crate::map::landmarks::{Association, Landmarks, Measurement};
use crate::map::ray_selection::RaySelection;
use crate::map::surface_points::{KeyframeSurface, SurfaceCheck};
use crate::map::view_region::ViewRegion;
use crate::options::Options;
use crate::options::SurfacePointOptions;

/// The landmarks of a map, their points in the carver, and the state of the current keyframe.
pub(super) struct LandmarkFusion {
    landmarks: Landmarks,
    /// The carver's id of each landmark.
    points: Vec<PointId>,
    /// Factor on standard deviations for the carver.
    sigma_factor: f64,
    /// The observations of each landmark, and its rays among them.
    rays: RaySelection,
    /// The measurements of each keyframe, where poses may be corrected.
    measurements: Option<KeyframeMeasurements>,
    /// Landmarks that the keyframe observes; unsorted and with repetitions until colours are added.
    seen: Vec<u32>,
    /// Landmarks among them that got a ray.
    observed: Vec<u32>,
    /// Landmarks that the keyframe moved.
    moved: Vec<u32>,
    /// Landmarks in front of a measured surface.
    contradicted: Vec<u32>,
    /// Landmarks of earlier keyframes along whose ray the keyframe measured its surface, ascending.
    looked_up: Vec<(u32, ImageVertex, SurfaceSample)>,
    /// Landmarks in the image of the keyframe.
    vertices: Vec<ImageVertex>,
}

impl LandmarkFusion {
    /// A map without landmarks.
    pub(super) fn new(options: &Options) -> Self {
        Self {
            landmarks: Landmarks::new(options.landmarks),
            points: Vec::new(),
            sigma_factor: options.carving.cut.sigma_factor,
            rays: RaySelection::new(options.carving.ray_angle_deg),
            measurements: None,
            seen: Vec::new(),
            observed: Vec::new(),
            moved: Vec::new(),
            contradicted: Vec::new(),
            looked_up: Vec::new(),
            vertices: Vec::new(),
        }
    }

    /// The landmarks of the map.
    pub(super) fn landmarks(&self) -> &Landmarks {
        &self.landmarks
    }

    /// The carver's id of each landmark. Ids of removed landmarks are stale.
    pub(super) fn points(&self) -> &[PointId] {
        &self.points
    }

    /// Landmarks that the keyframe observes; ascending after [`add_colors`](Self::add_colors).
    pub(super) fn seen(&self) -> &[u32] {
        &self.seen
    }

    /// Landmarks that got a ray in the last call of [`add_observations`](Self::add_observations), ascending.
    pub(super) fn observed(&self) -> &[u32] {
        &self.observed
    }

    /// Landmarks of earlier keyframes along whose rays the keyframe measured its surface, ascending.
    pub(super) fn looked_up(&self) -> impl Iterator<Item = u32> + '_ {
        self.looked_up.iter().map(|(landmark, ..)| *landmark)
    }

    /// Landmarks that the keyframe contradicts.
    pub(super) fn contradicted(&self) -> &[u32] {
        &self.contradicted
    }

    /// Keeps the measurements of all keyframes from now on, for [`correct`](Self::correct).
    pub(super) fn keep_measurements(&mut self) {
        self.measurements.get_or_insert_default();
    }

    /// The pose of a keyframe in the map, where measurements are kept.
    pub(super) fn pose(&self, keyframe: usize) -> Option<&Isometry3<f64>> {
        self.measurements.as_ref()?.pose(keyframe)
    }

    /// Clears the state of the previous keyframe.
    pub(super) fn begin_keyframe(&mut self, world_from_camera: &Isometry3<f64>) {
        self.landmarks.begin_keyframe();
        if let Some(measurements) = &mut self.measurements {
            measurements.begin(world_from_camera);
        }
        self.seen.clear();
        self.contradicted.clear();
        self.looked_up.clear();
        self.vertices.clear();
    }

    /// Associates a measurement with a landmark, which is returned.
    fn add_measurement(
        &mut self,
        transaction: &mut Transaction<'_>,
        measurement: &Measurement,
    ) -> Result<u32, TransactionError> {
        let landmark = match self.landmarks.associate(measurement) {
            Association::New(landmark) => {
                let point = transaction.add_point(measurement.point_in_world)?;
                let sigma = self.sigma_factor * measurement.sigma;
                transaction.set_sigma(point, Some(sigma))?;
                self.points.push(point);
                landmark
            }
            Association::Existing(landmark) => landmark,
        };
        self.keep(landmark, measurement);
        self.seen.push(landmark);
        Ok(landmark)
    }

    fn keep(&mut self, landmark: u32, measurement: &Measurement) {
        if let Some(measurements) = &mut self.measurements {
            measurements.keep(landmark, measurement);
        }
    }

    /// Adds measured points.
    pub(super) fn add_points(
        &mut self,
        transaction: &mut Transaction<'_>,
        measurements: impl Iterator<Item = Measurement>,
    ) -> Result<(), TransactionError> {
        for measurement in measurements {
            self.add_measurement(transaction, &measurement)?;
        }
        Ok(())
    }

    /// Looks up the surface of a new keyframe along the rays of all landmarks so far.
    fn look_up(&mut self, surface: &KeyframeSurface<'_>) {
        let region = surface.region().unwrap_or_else(ViewRegion::everything);
        let within = self.landmarks.within(&region);
        let found = within.filter_map(|(landmark, position)| {
            let (vertex, sample) = surface.look_up(&position)?;
            Some((landmark, vertex, sample))
        });
        self.looked_up.extend(found);
        // Oldest first, independent of the spatial index.
        self.looked_up
            .sort_unstable_by_key(|(landmark, ..)| *landmark);
    }

    /// Compares the surface of a keyframe with all landmarks so far, and adds the points missing there.
    pub(super) fn fuse_surface(
        &mut self,
        transaction: &mut Transaction<'_>,
        surface: &KeyframeSurface<'_>,
        options: &SurfacePointOptions,
    ) -> Result<(), TransactionError> {
        self.look_up(surface);
        self.seen.sort_unstable();
        self.seen.dedup();
        let on_segments = self.seen.len();
        let positions = self.seen.iter().map(|it| self.landmarks.position(*it));
        self.vertices
            .extend(positions.filter_map(|position| surface.vertex(&position)));
        let looked_up = std::mem::take(&mut self.looked_up);
        for &(landmark, vertex, ref sample) in &looked_up {
            if self.seen[..on_segments].binary_search(&landmark).is_ok() {
                continue;
            }
            match surface.check(vertex, sample) {
                SurfaceCheck::Unknown => {}
                SurfaceCheck::Confirmed {
                    vertex,
                    measurement,
                } => {
                    self.landmarks.add_measurement(landmark, &measurement);
                    self.keep(landmark, &measurement);
                    self.seen.push(landmark);
                    self.vertices.push(vertex);
                }
                SurfaceCheck::Contradicted => {
                    self.landmarks.add_contradiction(landmark);
                    if let Some(measurements) = &mut self.measurements {
                        measurements.contradict(landmark);
                    }
                    self.contradicted.push(landmark);
                }
            }
        }
        self.looked_up = looked_up;
        for missing in surface.refine(&self.vertices, &options.refine) {
            self.add_measurement(transaction, &missing)?;
        }
        Ok(())
    }

    /// Adds a colour to each landmark that the keyframe observes.
    pub(super) fn add_colors(&mut self, keyframe: &LineKeyframe, surface: &KeyframeSurface<'_>) {
        self.seen.sort_unstable();
        self.seen.dedup();
        for &landmark in &self.seen {
            let vertex = surface.vertex(&self.landmarks.position(landmark));
            if let Some(color) = vertex.and_then(|vertex| keyframe.colors.at(&vertex.pixel)) {
                self.landmarks.add_color(landmark, color);
            }
        }
    }
}
