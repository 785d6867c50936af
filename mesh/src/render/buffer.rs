//! First hits of all samples of a picture.

use linecarve_lines::upper_median;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::options::BackFaces;
use super::raster::{Seen, first_hits};
use super::view::View;
use crate::TriangleMesh;
use crate::raycast::triangle_normal;

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
    /// Draws a mesh, in parallel over rows; `row_done` is called after each.
    pub(super) fn draw(
        mesh: &TriangleMesh,
        view: &View,
        supersampling: usize,
        back_faces: BackFaces,
        row_done: &(dyn Fn() + Sync),
    ) -> Self {
        let (width, height) = (
            view.width as usize * supersampling,
            view.height as usize * supersampling,
        );
        let normals: Vec<Vector3<f32>> = mesh
            .triangles
            .par_iter()
            .map(|corners| {
                let [Some(a), Some(b), Some(c)] =
                    corners.map(|corner| mesh.positions.get(corner as usize))
                else {
                    // No sample sees it.
                    return Vector3::zeros();
                };
                triangle_normal([a, b, c]).cast()
            })
            .collect();
        let keep = |seen: &Seen| {
            let normal = normals[seen.triangle as usize];
            let facing = if seen.is_front_face { normal } else { -normal };
            Sample {
                depth: seen.depth as f32,
                triangle: seen.triangle,
                barycentric: seen.barycentric.map(|share| share as f32),
                normal: facing.into(),
                is_front_face: seen.is_front_face,
            }
        };
        let mesh = (mesh.positions.as_slice(), mesh.triangles.as_slice());
        let samples = first_hits(mesh, (view, supersampling), back_faces, keep, row_done);
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
        upper_median(&mut depths, f32::total_cmp).map(f64::from)
    }
}
