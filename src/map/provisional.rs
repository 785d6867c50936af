//! Keyframes whose depth will still be refined.
//!
//! What a first depth yields is in the map at once and is taken away again when the last one comes. So that nothing of it stays,
//! it changes nothing else: where it meets landmarks it sees their points, but is no measurement of them; the rest are
//! points of its own. The carver's state depends on what is there alone, so that the map ends as if there had been
//! last depths only.

use std::collections::BTreeMap;

use linecarve_carving::carver::{Carver, EventError, PointId, Transaction, ViewId};
use linecarve_carving::tetrahedralization::VertexId;
use linecarve_lines::camera::Camera;
use linecarve_lines::depth::SensorNoise;
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::landmarks::{Landmarks, Measurement};
use super::segment_points::{edge_measurements, measurements};
use crate::front_end::LineKeyframe;
use crate::options::Options;

/// The keyframes that wait for their last depth, by the position of their frame in the sequence.
#[derive(Debug, Default)]
pub(super) struct ProvisionalKeyframes {
    keyframes: BTreeMap<usize, Provisional>,
}

/// What one of them has put into the map.
#[derive(Debug)]
struct Provisional {
    view: ViewId,
    /// Its own points, and the colours under which it sees them.
    points: Vec<(PointId, Option<[u8; 3]>)>,
    /// How many segments it has.
    segments: usize,
}

/// What provisional keyframes are made with.
#[derive(Clone, Copy)]
pub(super) struct ProvisionalContext<'a> {
    pub(super) options: &'a Options,
    pub(super) camera: &'a Camera,
    pub(super) noise: &'a SensorNoise,
    pub(super) landmarks: &'a Landmarks,
    /// The carver's id of each landmark.
    pub(super) points: &'a [PointId],
}

impl Provisional {
    /// Makes points of measurements; those that are of landmarks are noted in `seen` instead.
    fn add_points(
        &mut self,
        measurements: impl Iterator<Item = Measurement>,
        keyframe: &LineKeyframe,
        context: ProvisionalContext<'_>,
        transaction: &mut Transaction<'_>,
        seen: &mut Vec<u32>,
    ) -> Result<(), EventError> {
        let camera_from_world = keyframe.world_from_camera.inverse();
        for measurement in measurements {
            if let Some(landmark) = context.landmarks.find(&measurement) {
                seen.push(landmark);
                continue;
            }
            let point = transaction.add_point(measurement.point_in_world)?;
            let sigma = context.options.carving.cut.sigma_factor * measurement.sigma;
            transaction.set_sigma(point, Some(sigma))?;
            transaction.add_observation(self.view, point, 1)?;
            let pixel = context
                .camera
                .project(&(camera_from_world * measurement.point_in_world));
            let color = pixel.and_then(|pixel| keyframe.colors.at(&pixel));
            self.points.push((point, color));
        }
        Ok(())
    }
}

impl ProvisionalKeyframes {
    /// Puts a keyframe into the map, in place of what was there of it.
    ///
    /// # Errors
    /// When the carver refuses its position or one of its points.
    pub(super) fn add(
        &mut self,
        keyframe: &LineKeyframe,
        context: ProvisionalContext<'_>,
        transaction: &mut Transaction<'_>,
    ) -> Result<(), EventError> {
        self.remove(keyframe.frame, transaction)?;
        let center = Point3::from(keyframe.world_from_camera.translation.vector);
        let mut provisional = Provisional {
            view: transaction.add_view(center)?,
            points: Vec::new(),
            segments: keyframe.segments.len(),
        };
        let mut seen: Vec<u32> = Vec::new();
        for segment in &keyframe.segments {
            let along = measurements(
                segment,
                context.camera,
                &keyframe.world_from_camera,
                context.noise,
                &context.options.segment_points,
            );
            provisional.add_points(along, keyframe, context, transaction, &mut seen)?;
        }
        let single = edge_measurements(
            &keyframe.edge_points,
            context.camera,
            &keyframe.world_from_camera,
            context.noise,
        );
        provisional.add_points(single, keyframe, context, transaction, &mut seen)?;
        seen.sort_unstable();
        seen.dedup();
        for landmark in seen {
            let point = context.points[landmark as usize];
            transaction.add_observation(provisional.view, point, 1)?;
        }
        self.keyframes.insert(keyframe.frame, provisional);
        Ok(())
    }

    /// Takes a keyframe out of the map; whether it was there.
    ///
    /// # Errors
    /// Never, as long as nobody else removes its points.
    pub(super) fn remove(
        &mut self,
        frame: usize,
        transaction: &mut Transaction<'_>,
    ) -> Result<bool, EventError> {
        let Some(provisional) = self.keyframes.remove(&frame) else {
            return Ok(false);
        };
        transaction.remove_view(provisional.view)?;
        for (point, _) in provisional.points {
            transaction.remove_point(point)?;
        }
        Ok(true)
    }

    /// The frames that wait, in their order.
    pub(super) fn frames(&self) -> Vec<usize> {
        self.keyframes.keys().copied().collect()
    }

    /// The views of those that wait.
    pub(super) fn views(&self) -> impl Iterator<Item = ViewId> + '_ {
        self.keyframes.values().map(|provisional| provisional.view)
    }

    /// Whether none waits.
    pub(super) fn is_empty(&self) -> bool {
        self.keyframes.is_empty()
    }

    /// How many segments those that wait have.
    pub(super) fn segment_count(&self) -> usize {
        let segments = |provisional: &Provisional| provisional.segments;
        self.keyframes.values().map(segments).sum()
    }

    /// The colours of their vertices.
    pub(super) fn colors(&self, carver: &Carver) -> FxHashMap<VertexId, [u8; 3]> {
        self.keyframes
            .values()
            .flat_map(|provisional| &provisional.points)
            .filter_map(|(point, color)| Some((carver.vertex_of(*point)?, (*color)?)))
            .collect()
    }
}
