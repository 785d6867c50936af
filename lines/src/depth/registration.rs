//! Carrying a depth image into another camera.

use nalgebra::{Isometry3, Vector3};

use super::map::{InverseDepth, InverseDepthMap, UNKNOWN};
use super::sensor::SensorNoise;
use crate::camera::Camera;
use crate::image::Plane;

/// Neighbouring depth pixels whose connection is steeper than this, measured from the image plane, belong to two
/// surfaces unless noise explains the difference: tan 80 degrees.
const STEEPEST: f64 = 5.671;
/// Differences of neighbours within this many standard deviations of their difference are noise.
const NOISE_GATE: f64 = 4.0;

/// What [`register`] needs to know.
pub(super) struct Registration<'a> {
    pub(super) depth_camera: &'a Camera,
    pub(super) color_camera: &'a Camera,
    pub(super) color_from_depth: &'a Isometry3<f64>,
    pub(super) noise: &'a SensorNoise,
}

/// A depth pixel seen by the colour camera.
#[derive(Debug, Clone, Copy, Default)]
struct Projected {
    x: f32,
    y: f32,
    /// Inverse depth in the colour camera; 0 when unknown or behind it.
    rho: f32,
    /// Inverse depth in the depth camera, where continuity is judged.
    rho_in_depth: f32,
    /// By how much the inverse depth of a neighbour of the same surface may differ.
    reach: f32,
}

/// Fills `map` (all unknown, of the size of the colour image) with the nearest surface along each pixel's ray.
///
/// Inverse depth is linear across the image of a plane, so the two triangles of a cell are filled exactly for planar
/// surfaces. Cells with a jump are left open; their pixels are put at the nearest colour pixel, so that a thin object of
/// one depth pixel survives.
pub(super) fn register(
    depth: &Plane<f32>,
    registration: &Registration<'_>,
    map: &mut InverseDepthMap,
) {
    let (width, height) = (depth.width(), depth.height());
    if width == 0 || height == 0 || map.width() == 0 || map.height() == 0 {
        return;
    }
    let mut above = vec![Projected::default(); width];
    let mut below = vec![Projected::default(); width];
    for y in 0..height {
        std::mem::swap(&mut above, &mut below);
        project_row(depth.row(y), y, registration, &mut below);
        if y > 0 {
            for (above, below) in above.windows(2).zip(below.windows(2)) {
                fill_cell(&[above[0], above[1], below[0], below[1]], map);
            }
        }
    }
    // After all cells, so that a rounded position never hides an interpolated one of the same surface.
    for y in 0..height {
        project_row(depth.row(y), y, registration, &mut below);
        for pixel in &below {
            splat(pixel, map);
        }
    }
    for sample in map.raw_mut() {
        let sigma = registration.noise.sigma(f64::from(sample.rho)) as f32;
        *sample = InverseDepth::new(sample.rho, sigma).unwrap_or(UNKNOWN);
    }
}

fn project_row(row: &[f32], y: usize, registration: &Registration<'_>, out: &mut [Projected]) {
    let (depth_camera, color) = (registration.depth_camera, registration.color_camera);
    let rotation = registration.color_from_depth.rotation.to_rotation_matrix();
    let translation = registration.color_from_depth.translation.vector;
    let v = (y as f64 - depth_camera.cy()) / depth_camera.fy();
    let along = rotation * Vector3::new(1.0 / depth_camera.fx(), 0.0, 0.0);
    let slope = STEEPEST / depth_camera.mean_focal_px();
    let noise_gate = NOISE_GATE * std::f64::consts::SQRT_2;
    let start = rotation * Vector3::new(-depth_camera.cx() / depth_camera.fx(), v, 1.0);
    for (x, (&z, out)) in row.iter().zip(out).enumerate() {
        let z = f64::from(z);
        *out = Projected::default();
        if !(z > 0.0 && z.is_finite()) {
            continue;
        }
        let point = (start + along * x as f64) * z + translation;
        if point.z <= 0.0 {
            continue;
        }
        let rho = 1.0 / point.z;
        let rho_in_depth = 1.0 / z;
        let by_noise = noise_gate * registration.noise.sigma(rho_in_depth);
        *out = Projected {
            x: (color.fx() * point.x * rho + color.cx()) as f32,
            y: (color.fy() * point.y * rho + color.cy()) as f32,
            rho: rho as f32,
            rho_in_depth: rho_in_depth as f32,
            reach: by_noise.max(slope * rho_in_depth) as f32,
        };
    }
}

/// Puts one depth pixel at the nearest colour pixel unless a cell of the same surface, which interpolates and is better,
/// or a nearer one is there.
fn splat(pixel: &Projected, map: &mut InverseDepthMap) {
    let (x, y) = (pixel.x + 0.5, pixel.y + 0.5);
    let is_inside = x >= 0.0 && y >= 0.0 && x < map.width() as f32 && y < map.height() as f32;
    if pixel.rho > 0.0 && is_inside {
        let index = y as usize * map.width() + x as usize;
        let slot = &mut map.raw_mut()[index];
        if pixel.rho > slot.rho + pixel.reach {
            slot.rho = pixel.rho;
        }
    }
}

fn fill_cell(corners: &[Projected; 4], map: &mut InverseDepthMap) {
    // A cell with one unknown corner is still a triangle.
    //   0 - 1
    //   | / |
    //   2 - 3
    const TRIANGLES: [[usize; 3]; 2] = [[0, 1, 2], [3, 2, 1]];
    const OTHER_DIAGONAL: [[usize; 3]; 2] = [[1, 3, 0], [2, 0, 3]];
    let known = |i: usize| corners[i].rho > 0.0;
    let triangles = if known(1) && known(2) {
        TRIANGLES
    } else {
        OTHER_DIAGONAL
    };
    for triangle in triangles {
        let [a, b, c] = triangle.map(|i| corners[i]);
        if a.rho > 0.0 && b.rho > 0.0 && c.rho > 0.0 && is_continuous(&a, &b, &c) {
            fill_triangle(&a, &b, &c, map);
        }
    }
}

/// Whether three neighbouring depth pixels may belong to one surface.
fn is_continuous(a: &Projected, b: &Projected, c: &Projected) -> bool {
    let nearest = a.rho_in_depth.max(b.rho_in_depth).max(c.rho_in_depth);
    let farthest = a.rho_in_depth.min(b.rho_in_depth).min(c.rho_in_depth);
    nearest - farthest <= a.reach.max(b.reach).max(c.reach)
}

/// The whole numbers within a range, limited to `0..count`.
fn whole_numbers(from: f32, to: f32, count: usize) -> std::ops::Range<usize> {
    // Casts truncate and saturate: negative numbers become 0, which is where the range begins anyway.
    let low = from.max(0.0);
    let first = low as usize + usize::from(low > low as usize as f32);
    let end = if to < 0.0 { 0 } else { to as usize + 1 };
    first..end.min(count)
}

/// Fills the pixels whose centres lie in a triangle; the nearest surface wins.
fn fill_triangle(a: &Projected, b: &Projected, c: &Projected, map: &mut InverseDepthMap) {
    let columns = whole_numbers(a.x.min(b.x).min(c.x), a.x.max(b.x).max(c.x), map.width());
    let rows = whole_numbers(a.y.min(b.y).min(c.y), a.y.max(b.y).max(c.y), map.height());
    if columns.is_empty() || rows.is_empty() {
        return;
    }
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let inverse = 1.0 / area;
    let width = map.width();
    for y in rows {
        for x in columns.clone() {
            let (px, py) = (x as f32 - a.x, y as f32 - a.y);
            let weight_b = (px * (c.y - a.y) - (c.x - a.x) * py) * inverse;
            let weight_c = ((b.x - a.x) * py - px * (b.y - a.y)) * inverse;
            // Closed triangles: a pixel on a shared side is filled by both, which is harmless.
            if weight_b < 0.0 || weight_c < 0.0 || weight_b + weight_c > 1.0 {
                continue;
            }
            let rho = a.rho + weight_b * (b.rho - a.rho) + weight_c * (c.rho - a.rho);
            let slot = &mut map.raw_mut()[y * width + x];
            if rho > slot.rho {
                slot.rho = rho;
            }
        }
    }
}

#[cfg(test)]
mod tests;
