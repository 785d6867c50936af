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
                    let normal = buffer.normal(sample);
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
        let measured = Self {
            spacing,
            width,
            height,
            values,
        };
        let patch = spacing as f64 / view.camera.fx();
        measured.averaged(patch)
    }

    /// Each measured pixel with the mean over the block of measured pixels around it; they are `patch` apart at a depth of one.
    fn averaged(&self, patch: f64) -> Self {
        const HALF: usize = PATTERN / 2;
        let mean = |column: usize, row: usize| {
            let mut measured = self.values[row * self.width + column]?;
            let columns = column.saturating_sub(HALF)..column + HALF + 1;
            let rows = row.saturating_sub(HALF)..row + HALF + 1;
            let around = rows.flat_map(|y| columns.clone().map(move |x| ((x, y), 1.0)));
            let openness = self.mean_on(&measured.point, &measured.normal, patch, around);
            measured.openness = openness as f32;
            Some(measured)
        };
        let pixels = (0..self.values.len()).into_par_iter();
        Self {
            values: pixels
                .map(|index| mean(index % self.width, index / self.width))
                .collect(),
            ..*self
        }
    }

    /// Openness at a sample: between those of the four measured pixels around, on about the same surface.
    pub(super) fn at(
        &self,
        buffer: &SampleBuffer,
        rays: &ViewRays,
        sample: &Sample,
        (column, row): (usize, usize),
    ) -> f64 {
        let step = self.spacing * buffer.supersampling;
        let ray = rays.direction(column, row);
        let patch = (rays.direction(column + step, row) - ray).norm();
        let (left, top) = (column / step, row / step);
        let along = |at: usize| (at % step) as f64 / step as f64;
        let (x, y) = (along(column), along(row));
        let around = [
            ((left, top), (1.0 - x) * (1.0 - y)),
            ((left + 1, top), x * (1.0 - y)),
            ((left, top + 1), (1.0 - x) * y),
            ((left + 1, top + 1), x * y),
        ];
        let point = ray * f64::from(sample.depth);
        self.mean_on(&point, &buffer.normal(sample), patch, around)
    }

    /// Weighted mean of measured pixels, by their columns and rows, as far as they lie on about the surface at a point from the viewer; 1 where there
    /// are none. Measured pixels are `patch` apart at a depth of one.
    fn mean_on(
        &self,
        point: &Vector3<f64>,
        normal: &Vector3<f64>,
        patch: f64,
        weighted: impl IntoIterator<Item = ((usize, usize), f64)>,
    ) -> f64 {
        // Points farther from the plane than their distance from each other belong to another surface.
        let scale = 0.5 / (patch * point.norm());
        let (mut sum, mut weights) = (0.0, 0.0);
        for ((x, y), share) in weighted {
            if x >= self.width || y >= self.height {
                continue;
            }
            let Some(other) = &self.values[y * self.width + x] else {
                continue;
            };
            let off_plane = normal.dot(&(other.point - point)) * scale;
            let alike = normal.dot(&other.normal).max(0.0);
            let weight = share * (alike.powi(4) / (1.0 + off_plane.powi(4)) + 1e-6);
            sum += weight * f64::from(other.openness);
            weights += weight;
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
