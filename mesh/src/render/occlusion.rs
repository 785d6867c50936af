//! Ambient occlusion.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::buffer::{Sample, SampleBuffer, ViewRays};
use super::options::BackFaces;
use super::view::View;
use crate::raycast::RayScene;

/// Side of the pixel block that shares one set of directions; averages over such a block have no noise on planes.
const PATTERN: usize = 5;
/// Length of occlusion rays relative to the visible width at the median depth of the picture.
const REACH: f64 = 0.14;

/// Openness, 0 (closed) to 1, of one sample per pixel.
pub(super) struct Openness {
    width: usize,
    height: usize,
    values: Vec<f32>,
}

impl Openness {
    /// Casts `rays_per_pixel` short rays from the first sample of each pixel, cosine-weighted around its normal.
    ///
    /// Directions are stratified over blocks of pixels and the same in every block, so that the result depends on nothing
    /// but the view.
    pub(super) fn measure(
        scene: &RayScene,
        view: &View,
        buffer: &SampleBuffer,
        (rays_per_pixel, back_faces): (u32, BackFaces),
        row_done: &(dyn Fn() + Sync),
    ) -> Self {
        let (width, height) = (view.width as usize, view.height as usize);
        let mut values = vec![1.0_f32; width * height];
        let Some(median_depth) = buffer.median_depth() else {
            return Self {
                width,
                height,
                values,
            };
        };
        let reach = REACH * median_depth * f64::from(view.width) / view.camera.fx();
        let eye = Point3::from(view.world_from_camera.translation.vector);
        // Hidden back faces do not occlude either.
        let is_drawn = |triangle: u32| {
            let toward_eye = eye - scene.corners(triangle)[0];
            back_faces != BackFaces::Hidden || scene.normal(triangle).dot(&toward_eye) > 0.0
        };
        let count = rays_per_pixel as usize;
        let directions = directions(count * PATTERN * PATTERN);
        let rays = ViewRays::new(view, buffer.supersampling);
        values
            .par_chunks_mut(width.max(1))
            .enumerate()
            .for_each(|(row, line)| {
                for (column, value) in line.iter_mut().enumerate() {
                    let (x, y) = (column * buffer.supersampling, row * buffer.supersampling);
                    let Some(sample) = buffer.at(x, y) else {
                        continue;
                    };
                    let depth = f64::from(sample.depth);
                    let normal = sample.normal();
                    let lift = normal * (depth * 1e-5);
                    let point = rays.origin() + rays.direction(x, y) * depth + lift;
                    let (tangent, bitangent) = tangents(&normal);
                    // Neighbouring pixels use directions far apart in the sequence.
                    let index = column % PATTERN + row % PATTERN * PATTERN;
                    let start = index * 7 % (PATTERN * PATTERN);
                    let mut open = 0;
                    for ray in 0..count {
                        let [a, b, c, length] =
                            directions[(ray * PATTERN * PATTERN + start) % directions.len()];
                        let direction = tangent * a + bitangent * b + normal * c;
                        let closed =
                            scene.is_occluded_where(&point, &direction, reach * length, is_drawn);
                        if !closed {
                            open += 1;
                        }
                    }
                    *value = open as f32 / count.max(1) as f32;
                }
                row_done();
            });
        Self {
            width,
            height,
            values,
        }
    }

    /// Openness at a sample: the mean over the surrounding pixel block on about the same surface.
    pub(super) fn at(
        &self,
        buffer: &SampleBuffer,
        rays: &ViewRays<'_>,
        sample: &Sample,
        (column, row): (usize, usize),
    ) -> f64 {
        let step = buffer.supersampling;
        let normal = sample.normal();
        let depth = f64::from(sample.depth);
        let point: Vector3<f64> = rays.direction(column, row) * depth;
        // Approximate size of the patch of a pixel; points farther from the plane belong to another surface.
        let patch =
            (rays.direction(column + step, row) - rays.direction(column, row)).norm() * depth;
        let half = PATTERN / 2;
        let (centre_x, centre_y) = (column / step, row / step);
        let (mut sum, mut weights) = (0.0, 0.0);
        for y in centre_y.saturating_sub(half)..(centre_y + half + 1).min(self.height) {
            for x in centre_x.saturating_sub(half)..(centre_x + half + 1).min(self.width) {
                let Some(other) = buffer.at(x * step, y * step) else {
                    continue;
                };
                let other_point = rays.direction(x * step, y * step) * f64::from(other.depth);
                let off_plane = normal.dot(&(other_point - point)) / (2.0 * patch);
                let alike = normal.dot(&other.normal()).max(0.0);
                let weight = alike.powi(4) / (1.0 + off_plane.powi(4)) + 1e-6;
                sum += weight * f64::from(self.values[y * self.width + x]);
                weights += weight;
            }
        }
        if weights > 0.0 { sum / weights } else { 1.0 }
    }
}

/// `count` cosine-weighted directions above the plane z = 0 and a length of 0.25 to 1 each, evenly spread.
///
/// # Reference
/// M. Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018: the additive recurrence in three
/// dimensions.
fn directions(count: usize) -> Vec<[f64; 4]> {
    const PLASTIC: f64 = 1.220_744_084_605_759_5;
    (0..count)
        .map(|index| {
            let along = |power: i32| (0.5 + (index as f64 + 1.0) / PLASTIC.powi(power)).fract();
            let (radius, angle) = (along(1).sqrt(), std::f64::consts::TAU * along(2));
            [
                radius * angle.cos(),
                radius * angle.sin(),
                (1.0 - radius * radius).max(0.0).sqrt(),
                0.25 + 0.75 * along(3),
            ]
        })
        .collect()
}

fn tangents(normal: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let helper = Vector3::ith(normal.iamin(), 1.0);
    let tangent = helper.cross(normal).normalize();
    (tangent, normal.cross(&tangent))
}
