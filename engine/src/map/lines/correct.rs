//! Keyframes that move or leave the map, with what they measured.

use std::time::Instant;

use linecarve_carving::{Carver, TransactionError};
use nalgebra::{Isometry3, Point3};

use super::LineMap;
use crate::map::depth_evidence::Change;
use crate::map::update::MapUpdate;
use crate::map::vertex_landmarks::VertexViews;
use crate::options::Options;

impl LineMap {
    /// Keeps what [`correct`](Self::correct) needs, from now on.
    pub(in crate::map) fn keep_measurements(&mut self) {
        self.landmarks.keep_measurements();
    }

    /// Whether a keyframe that moves to this pose moves what it measured at this depth by more than a share of its deviation.
    pub(in crate::map) fn is_moved(
        &self,
        options: &Options,
        depth: f64,
        keyframe: usize,
        world_from_camera: &Isometry3<f64>,
    ) -> bool {
        let Some(before) = self.landmarks.pose(keyframe) else {
            return true;
        };
        let sigma = self.noise.sigma(1.0 / depth) * depth * depth;
        let ahead = Point3::new(0.0, 0.0, depth);
        let turn = before.rotation.angle_to(&world_from_camera.rotation);
        let moved = (world_from_camera * ahead - before * ahead).norm() + turn * depth;
        moved.is_nan() || moved > options.landmarks.settling_share * sigma
    }

    /// Moves keyframes, in ascending order, to these poses, or removes them, with their segments, measurements and rays.
    ///
    /// # Errors
    /// When the carver rejects a position. The map must not be used afterwards.
    ///
    /// # Complexity
    /// What these keyframes brought.
    pub(in crate::map) fn correct(
        &mut self,
        carver: &mut Carver,
        keyframes: &[(usize, Option<Isometry3<f64>>)],
    ) -> Result<MapUpdate, TransactionError> {
        let start = Instant::now();
        let mut update = MapUpdate::default();
        let transforms: Vec<_> = keyframes
            .iter()
            .map(|(keyframe, pose)| {
                let before = self.landmarks.pose(*keyframe);
                let transform = pose
                    .zip(before)
                    .map(|(pose, before)| pose * before.inverse());
                (*keyframe, transform)
            })
            .collect();
        self.segments.change(&transforms);
        update.times.clustering = start.elapsed();
        let viewed = keyframes
            .iter()
            .map(|(keyframe, pose)| (*keyframe, self.views[*keyframe], *pose));
        let viewed: Vec<_> = viewed.collect();
        let mut transaction = carver.transaction();
        for (_, view, pose) in &viewed {
            match pose {
                Some(pose) => transaction.move_view(*view, pose.translation.vector.into())?,
                None => transaction.remove_view(*view)?,
            }
            if let (Some(evidence), Some(surface)) =
                (&mut self.evidence, self.validation.surface_of(*view))
            {
                evidence.change(&mut transaction, &surface, Change::Remove)?;
            }
            self.validation.correct(*view, pose.as_ref());
            if let (Some(evidence), Some(surface)) =
                (&mut self.evidence, self.validation.surface_of(*view))
            {
                evidence.change(&mut transaction, &surface, Change::Add)?;
            }
        }
        self.landmarks.correct(&mut transaction, &viewed)?;
        let matched = start.elapsed();
        update.times.matching = matched - update.times.clustering;
        let report = transaction.commit()?;
        let carved = start.elapsed();
        update.times.carving = carved - matched;
        let (points, seen) = (self.landmarks.points(), self.landmarks.seen());
        let recolored = &mut update.recolored;
        self.vertices
            .update(carver, points, seen.iter().copied(), recolored);
        let views = VertexViews::new(carver, points, &self.vertices);
        self.validation.look_again(views, &report.surface, seen);
        update.is_all_refitted = true;
        update.revalidated.extend(self.validation.take_changed());
        update.deltas.push(report.surface);
        update.times.validation = start.elapsed() - carved;
        Ok(update)
    }
}
