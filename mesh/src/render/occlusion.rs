//! Ambient occlusion.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::buffer::{Sample, SampleBuffer, ViewRays};
use super::options::BackFaces;
use super::view::View;
use crate::raycast::RayScene;

/// Openness varies over a share of the visible width, [`REACH`]: large pictures are measured at every second or third pixel.
const MEASURED_PIXELS_PER_SIDE: u32 = 160;
const LARGEST_SPACING: u32 = 3;
/// Side of the block of measured pixels that shares one set of directions; averages over such a block have no noise on
/// planes.
const PATTERN: usize = 5;
/// Length of occlusion rays relative to the visible width at the median depth of the picture.
const REACH: f64 = 0.14;

/// Openness, 0 (closed) to 1, at the pixels of a grid.
pub(super) struct Openness {
    /// Spacing of the grid in pixels.
    spacing: usize,
    /// Number of measured columns and rows.
    width: usize,
    height: usize,
    /// Row by row; `None` without a surface.
    values: Vec<Option<Measured>>,
}

/// Openness of a measured pixel.
#[derive(Clone, Copy)]
struct Measured {
    /// Its surface, from the viewer.
    point: Vector3<f64>,
    normal: Vector3<f64>,
    openness: f32,
}

impl Openness {
    /// Casts `rays_per_pixel` short rays from the first sample of each measured pixel, cosine-weighted around its normal.
    /// `row_done` is called after each row of the picture.
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
        let spacing = view.width.min(view.height) / MEASURED_PIXELS_PER_SIDE;
        let spacing = spacing.clamp(1, LARGEST_SPACING) as usize;
        let width = (view.width as usize).div_ceil(spacing);
        let height = (view.height as usize).div_ceil(spacing);
        let mut values = vec![None; width * height];
        let Some(median_depth) = buffer.median_depth() else {
            return Self {
                spacing,
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
                    let step = spacing * buffer.supersampling;
                    let (x, y) = (column * step, row * step);
                    let Some(sample) = buffer.at(x, y) else {
                        continue;
                    };
                    let depth = f64::from(sample.depth);
                    let normal = sample.normal();
                    let lift = normal * (depth * 1e-5);
                    let from_viewer = rays.direction(x, y) * depth;
                    let point = rays.origin() + from_viewer + lift;
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
                    *value = Some(Measured {
                        point: from_viewer,
                        normal,
                        openness: open as f32 / count.max(1) as f32,
                    });
                }
                for _ in row * spacing..((row + 1) * spacing).min(view.height as usize) {
                    row_done();
                }
            });
        Self {
            spacing,
            width,
            height,
            values,
        }
    }

    /// Openness at a sample: the mean over the surrounding block of measured pixels on about the same surface.
    pub(super) fn at(
        &self,
        buffer: &SampleBuffer,
        rays: &ViewRays<'_>,
        sample: &Sample,
        (column, row): (usize, usize),
    ) -> f64 {
        let step = self.spacing * buffer.supersampling;
        let normal = sample.normal();
        let depth = f64::from(sample.depth);
        let point: Vector3<f64> = rays.direction(column, row) * depth;
        // Approximate distance of measured pixels; points farther from the plane belong to another surface.
        let patch =
            (rays.direction(column + step, row) - rays.direction(column, row)).norm() * depth;
        let half = PATTERN / 2;
        let (centre_x, centre_y) = (column / step, row / step);
        let (mut sum, mut weights) = (0.0, 0.0);
        for y in centre_y.saturating_sub(half)..(centre_y + half + 1).min(self.height) {
            for x in centre_x.saturating_sub(half)..(centre_x + half + 1).min(self.width) {
                let Some(other) = &self.values[y * self.width + x] else {
                    continue;
                };
                let off_plane = normal.dot(&(other.point - point)) / (2.0 * patch);
                let alike = normal.dot(&other.normal).max(0.0);
                let weight = alike.powi(4) / (1.0 + off_plane.powi(4)) + 1e-6;
                sum += weight * f64::from(other.openness);
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
