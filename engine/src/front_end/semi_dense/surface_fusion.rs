//! Final keyframes on their way to the map: each waits for the surfaces of the next ones, with which its own is fused.

use std::collections::VecDeque;
use std::time::Instant;

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::semi_dense::{DenseSurface, SurfaceView, fuse_surfaces};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

use crate::front_end::keyframe::LineKeyframe;
use crate::options::SemiDenseStage;
use crate::run::milliseconds;

/// A final keyframe with the surface from its own images.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct MeasuredKeyframe {
    /// The keyframe; its surface is empty.
    pub(super) keyframe: LineKeyframe,
    /// Its surface, empty where none is asked for.
    pub(super) surface: DenseSurface,
}

/// The keyframes whose surfaces are still needed.
#[derive(Debug)]
pub(super) struct SurfaceFusion {
    past: usize,
    future: usize,
    /// By ascending number.
    entries: VecDeque<Entry>,
}

#[derive(Debug)]
struct Entry {
    number: usize,
    frame: usize,
    surface: DenseSurface,
    camera: Camera,
    /// Pose that fits the images.
    fitted_pose: Isometry3<f64>,
    /// `None` after it was released.
    keyframe: Option<LineKeyframe>,
}

impl SurfaceFusion {
    pub(super) fn new(options: &SemiDenseStage) -> Self {
        let reach = |count: usize| if options.is_dense { count } else { 0 };
        Self {
            past: reach(options.fused_past),
            future: reach(options.fused_future),
            entries: VecDeque::new(),
        }
    }

    /// Adds the next final keyframe; numbers ascend.
    pub(super) fn push(
        &mut self,
        number: usize,
        measured: MeasuredKeyframe,
        camera: &Camera,
        fitted_pose: &Isometry3<f64>,
    ) {
        self.entries.push_back(Entry {
            number,
            frame: measured.keyframe.frame,
            surface: measured.surface,
            camera: camera.clone(),
            fitted_pose: *fitted_pose,
            keyframe: Some(measured.keyframe),
        });
    }

    /// The keyframes with fused surfaces that wait for no more of the next ones, after the final estimate of keyframe `newest`; all
    /// after the last one, with `None`.
    pub(super) fn release(&mut self, newest: Option<usize>) -> Vec<(usize, LineKeyframe)> {
        let mut released = Vec::new();
        for index in 0..self.entries.len() {
            let entry = &self.entries[index];
            if newest.is_some_and(|newest| entry.number + self.future > newest) {
                break;
            }
            if entry.keyframe.is_some() {
                let start = Instant::now();
                let surface = self.fused(index);
                let entry = &mut self.entries[index];
                if let Some(mut keyframe) = entry.keyframe.take() {
                    keyframe.surface = surface;
                    keyframe.times.depth += milliseconds(start.elapsed());
                    released.push((entry.number, keyframe));
                }
            }
        }
        // The keyframe that is released next needs `past` of those before it.
        while let Some(first) = self.entries.front()
            && first.keyframe.is_none()
            && newest.is_none_or(|newest| first.number + self.past + self.future < newest + 1)
        {
            self.entries.pop_front();
        }
        released
    }

    /// Gives the keyframes other poses, by frame; removes those without one.
    pub(super) fn set_poses(&mut self, mut pose_of: impl FnMut(usize) -> Option<Isometry3<f64>>) {
        self.entries.retain_mut(|entry| {
            let pose = pose_of(entry.frame);
            if let Some(pose) = pose {
                entry.fitted_pose = pose;
                if let Some(keyframe) = &mut entry.keyframe {
                    keyframe.world_from_camera = pose;
                }
            }
            pose.is_some()
        });
    }

    fn fused(&self, index: usize) -> linecarve_lines::triangulation::SurfaceSamples {
        fn view(entry: &Entry) -> SurfaceView<'_> {
            SurfaceView {
                samples: &entry.surface.samples,
                camera: &entry.camera,
                world_from_camera: &entry.fitted_pose,
            }
        }
        let own = &self.entries[index];
        let near = own.number.saturating_sub(self.past)..=own.number + self.future;
        let others: Vec<SurfaceView<'_>> = self
            .entries
            .iter()
            .filter(|other| other.number != own.number && near.contains(&other.number))
            .map(view)
            .collect();
        fuse_surfaces(&view(own), &others, &own.surface.is_open)
    }
}
