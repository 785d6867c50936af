//! Provisional keyframes: those with a first depth estimate that is still refined.
//!
//! A provisional keyframe is in the map at once and is removed when its final depth is known. It changes no landmark: it
//! observes existing landmarks without being a measurement of them, and adds points of its own for the rest. The state of the
//! carver does not depend on its history, so the final map is that of the final depths alone.

use std::collections::BTreeMap;

use linecarve_carving::VertexId;
use linecarve_carving::{Carver, PointId, Transaction, TransactionError, ViewId};
use linecarve_lines::camera::Camera;
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::depth_noise::DepthNoise;
use super::landmarks::{Landmarks, Measurement};
use super::segment_points::{edge_measurements, measurements};
use crate::front_end::LineKeyframe;
use crate::options::Options;

/// Provisional keyframes, by the position of their frame in the sequence.
#[derive(Debug, Default)]
pub(super) struct ProvisionalKeyframes {
    keyframes: BTreeMap<usize, Provisional>,
}

/// A provisional keyframe in the map.
#[derive(Debug)]
struct Provisional {
    view: ViewId,
    /// Its own points and their colours.
    points: Vec<(PointId, Option<[u8; 3]>)>,
    /// Number of its segments.
    segments: usize,
}

/// Inputs for adding a provisional keyframe.
#[derive(Clone, Copy)]
pub(super) struct ProvisionalContext<'a> {
    pub(super) options: &'a Options,
    pub(super) camera: &'a Camera,
    pub(super) noise: &'a DepthNoise,
    pub(super) landmarks: &'a Landmarks,
    /// The carver's id of each landmark.
    pub(super) points: &'a [PointId],
}

impl Provisional {
    /// Adds points for measurements that match no landmark, and lists the matching landmarks in `seen`.
    fn add_points(
        &mut self,
        measurements: impl Iterator<Item = Measurement>,
        keyframe: &LineKeyframe,
        context: ProvisionalContext<'_>,
        transaction: &mut Transaction<'_>,
        seen: &mut Vec<u32>,
    ) -> Result<(), TransactionError> {
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
    /// Adds a keyframe and replaces an earlier one of the same frame.
    ///
    /// # Errors
    /// When the carver rejects its position or one of its points.
    pub(super) fn add(
        &mut self,
        keyframe: &LineKeyframe,
        context: ProvisionalContext<'_>,
        transaction: &mut Transaction<'_>,
    ) -> Result<(), TransactionError> {
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

    /// Removes the keyframe of a frame; returns whether there was one.
    ///
    /// # Errors
    /// When one of its points was removed elsewhere.
    pub(super) fn remove(
        &mut self,
        frame: usize,
        transaction: &mut Transaction<'_>,
    ) -> Result<bool, TransactionError> {
        let Some(provisional) = self.keyframes.remove(&frame) else {
            return Ok(false);
        };
        transaction.remove_view(provisional.view)?;
        for (point, _) in provisional.points {
            transaction.remove_point(point)?;
        }
        Ok(true)
    }

    /// Frames of the provisional keyframes, ascending.
    pub(super) fn frames(&self) -> Vec<usize> {
        self.keyframes.keys().copied().collect()
    }

    /// Number of segments of the provisional keyframes.
    pub(super) fn segment_count(&self) -> usize {
        let segments = |provisional: &Provisional| provisional.segments;
        self.keyframes.values().map(segments).sum()
    }

    /// Vertices of the points of a frame's keyframe.
    pub(super) fn vertices(&self, carver: &Carver, frame: usize) -> impl Iterator<Item = VertexId> {
        let keyframe = self.keyframes.get(&frame).into_iter();
        let points = keyframe.flat_map(|provisional| &provisional.points);
        points.filter_map(|(point, _)| carver.vertex_of(*point))
    }

    /// Colours of their vertices.
    pub(super) fn colors(&self, carver: &Carver) -> FxHashMap<VertexId, [u8; 3]> {
        self.keyframes
            .values()
            .flat_map(|provisional| &provisional.points)
            .filter_map(|(point, color)| Some((carver.vertex_of(*point)?, (*color)?)))
            .collect()
    }
}
