//! First hits of all samples of a picture.

use std::num::NonZeroU32;

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
    /// In row order; empty without triangles.
    pub(super) samples: Vec<Option<Sample>>,
    /// Unit normals of the triangles in the world frame, towards the side from which their corners are counter-clockwise.
    normals: Vec<Vector3<f32>>,
}

/// The hit of a sample: eight bytes, also when there is none.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sample {
    /// Depth z in the camera frame.
    pub(super) depth: f32,
    pub(super) face: Face,
}

/// A side of a triangle: twice its number, and two for the side from which the corners are counter-clockwise or one for the other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Face(NonZeroU32);

impl Face {
    fn new(triangle: u32, is_front: bool) -> Self {
        let number = NonZeroU32::MIN.saturating_add(2 * triangle + u32::from(is_front));
        Self(number)
    }

    pub(super) fn triangle(self) -> u32 {
        (self.0.get() - 1) / 2
    }

    pub(super) fn is_front(self) -> bool {
        self.0.get().is_multiple_of(2)
    }
}

/// Rays of a view; directions have z = 1 in the camera frame.
pub(super) struct ViewRays {
    origin: Point3<f64>,
    /// Direction, in the world frame, of the ray through the first sample of the first row.
    first: Vector3<f64>,
    /// What a step to the next column, and to the next row, adds to it.
    right: Vector3<f64>,
    down: Vector3<f64>,
}

impl ViewRays {
    pub(super) fn new(view: &View, supersampling: usize) -> Self {
        let camera = &view.camera;
        let rotation = &view.world_from_camera.rotation;
        let step = 1.0 / supersampling as f64;
        let middle = 0.5 * step - 0.5;
        let (x, y) = (middle - camera.cx(), middle - camera.cy());
        Self {
            origin: Point3::from(view.world_from_camera.translation.vector),
            first: rotation * Vector3::new(x / camera.fx(), y / camera.fy(), 1.0),
            right: rotation * Vector3::new(step / camera.fx(), 0.0, 0.0),
            down: rotation * Vector3::new(0.0, step / camera.fy(), 0.0),
        }
    }

    pub(super) fn origin(&self) -> Point3<f64> {
        self.origin
    }

    /// Direction in the world frame of the ray through sample (column, row).
    pub(super) fn direction(&self, column: usize, row: usize) -> Vector3<f64> {
        self.first + self.right * column as f64 + self.down * row as f64
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
        let keep = |seen: &Seen| Sample {
            depth: seen.depth as f32,
            face: Face::new(seen.triangle, seen.is_front_face),
        };
        let mesh = (mesh.positions.as_slice(), mesh.triangles.as_slice());
        let samples = match mesh.1.is_empty() {
            true => {
                (0..height).for_each(|_| row_done());
                Vec::new()
            }
            false => first_hits(mesh, (view, supersampling), back_faces, keep, row_done),
        };
        Self {
            width,
            height,
            supersampling,
            samples,
            normals,
        }
    }

    /// Unit normal at a sample in the world frame, towards the viewer.
    pub(super) fn normal(&self, sample: &Sample) -> Vector3<f64> {
        let normal = self.normals[sample.face.triangle() as usize].cast();
        if sample.face.is_front() {
            normal
        } else {
            -normal
        }
    }

    /// The sample at a column and row.
    pub(super) fn at(&self, column: usize, row: usize) -> Option<&Sample> {
        self.samples.get(row * self.width + column)?.as_ref()
    }

    /// Median depth of all samples with a hit.
    pub(super) fn median_depth(&self) -> Option<f64> {
        let mut depths: Vec<f32> = self.samples.iter().flatten().map(|s| s.depth).collect();
        upper_median(&mut depths, f32::total_cmp).map(f64::from)
    }
}
