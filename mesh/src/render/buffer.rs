//! First hits of all samples of a picture.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::options::BackFaces;
use super::view::View;
use crate::raycast::RayScene;

/// First hits on a grid of samples, `supersampling` times as fine as the pixels along each side.
pub(super) struct SampleBuffer {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) supersampling: usize,
    /// In row order.
    pub(super) samples: Vec<Option<Sample>>,
}

/// The hit of a sample.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Depth z in the camera frame.
    pub(super) depth: f32,
    pub(super) triangle: u32,
    /// Barycentric coordinates of the second and third corner.
    pub(super) barycentric: [f32; 2],
    /// Normal of the triangle in the world frame, oriented towards the viewer.
    pub(super) normal: [f32; 3],
    pub(super) is_front_face: bool,
}

impl Sample {
    pub(super) fn normal(&self) -> Vector3<f64> {
        Vector3::from(self.normal.map(f64::from))
    }
}

/// Rays of a view; directions have z = 1 in the camera frame.
pub(super) struct ViewRays<'a> {
    view: &'a View,
    supersampling: usize,
}

impl<'a> ViewRays<'a> {
    pub(super) fn new(view: &'a View, supersampling: usize) -> Self {
        Self {
            view,
            supersampling,
        }
    }

    pub(super) fn origin(&self) -> Point3<f64> {
        Point3::from(self.view.world_from_camera.translation.vector)
    }

    /// Direction in the world frame of the ray through sample (column, row).
    pub(super) fn direction(&self, column: usize, row: usize) -> Vector3<f64> {
        let camera = &self.view.camera;
        let step = self.supersampling as f64;
        let x = (column as f64 + 0.5) / step - 0.5;
        let y = (row as f64 + 0.5) / step - 0.5;
        self.view.world_from_camera.rotation
            * Vector3::new(
                (x - camera.cx()) / camera.fx(),
                (y - camera.cy()) / camera.fy(),
                1.0,
            )
    }
}

impl SampleBuffer {
    /// Casts all rays, in parallel over rows; `row_done` is called after each.
    pub(super) fn cast(
        scene: &RayScene,
        view: &View,
        supersampling: usize,
        back_faces: BackFaces,
        row_done: &(dyn Fn() + Sync),
    ) -> Self {
        let (width, height) = (
            view.width as usize * supersampling,
            view.height as usize * supersampling,
        );
        let rays = ViewRays::new(view, supersampling);
        let origin = rays.origin();
        let mut samples = vec![None; width * height];
        samples
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(row, line)| {
                let mut last = None;
                for (column, sample) in line.iter_mut().enumerate() {
                    let direction = rays.direction(column, row);
                    let is_drawn = |_, front| front || back_faces != BackFaces::Hidden;
                    let hit = scene.cast_guessing(&origin, &direction, f64::MAX, last, is_drawn);
                    last = hit.map(|hit| hit.triangle).or(last);
                    *sample = hit.map(|hit| {
                        let normal = scene.normal(hit.triangle);
                        let facing = if hit.is_front_face { normal } else { -normal };
                        Sample {
                            depth: hit.distance as f32,
                            triangle: hit.triangle,
                            barycentric: [hit.barycentric[1] as f32, hit.barycentric[2] as f32],
                            normal: facing.map(|v| v as f32).into(),
                            is_front_face: hit.is_front_face,
                        }
                    });
                }
                row_done();
            });
        Self {
            width,
            height,
            supersampling,
            samples,
        }
    }

    /// The sample at a column and row.
    pub(super) fn at(&self, column: usize, row: usize) -> Option<&Sample> {
        self.samples[row * self.width + column].as_ref()
    }

    /// Median depth of all samples with a hit.
    pub(super) fn median_depth(&self) -> Option<f64> {
        let mut depths: Vec<f32> = self.samples.iter().flatten().map(|s| s.depth).collect();
        let middle = depths.len() / 2;
        if depths.is_empty() {
            return None;
        }
        let (_, median, _) = depths.select_nth_unstable_by(middle, f32::total_cmp);
        Some(f64::from(*median))
    }
}
