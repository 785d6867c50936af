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
        if y == 0 {
            continue;
        }
        for x in 1..width {
            let corners = [above[x - 1], above[x], below[x - 1], below[x]];
            fill_cell(&corners, registration, map);
        }
    }
    // After all cells, so that a rounded position never hides an interpolated one of the same surface.
    for y in 0..height {
        project_row(depth.row(y), y, registration, &mut below);
        for pixel in &below {
            splat(pixel, registration, map);
        }
    }
}

fn project_row(row: &[f32], y: usize, registration: &Registration<'_>, out: &mut [Projected]) {
    let (depth_camera, color) = (registration.depth_camera, registration.color_camera);
    let rotation = registration.color_from_depth.rotation.to_rotation_matrix();
    let translation = registration.color_from_depth.translation.vector;
    let v = (y as f64 - depth_camera.cy()) / depth_camera.fy();
    let along = rotation * Vector3::new(1.0 / depth_camera.fx(), 0.0, 0.0);
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
        *out = Projected {
            x: (color.fx() * point.x * rho + color.cx()) as f32,
            y: (color.fy() * point.y * rho + color.cy()) as f32,
            rho: rho as f32,
            rho_in_depth: (1.0 / z) as f32,
        };
    }
}

/// Puts one depth pixel at the nearest colour pixel.
fn splat(pixel: &Projected, registration: &Registration<'_>, map: &mut InverseDepthMap) {
    let (x, y) = (pixel.x.round(), pixel.y.round());
    let is_inside = x >= 0.0 && y >= 0.0 && x < map.width() as f32 && y < map.height() as f32;
    if pixel.rho > 0.0 && is_inside {
        let index = y as usize * map.width() + x as usize;
        let slot = &mut map.raw_mut()[index];
        let focal = registration.color_camera.mean_focal_px();
        let same = same_surface(f64::from(pixel.rho), focal, registration.noise);
        // A cell of the same surface interpolates and is better: only a clearly nearer pixel replaces what is there.
        if pixel.rho > slot.rho + same as f32 {
            let sigma = registration.noise.sigma(f64::from(pixel.rho));
            *slot = InverseDepth::new(pixel.rho, sigma as f32).unwrap_or(UNKNOWN);
        }
    }
}

/// The largest difference of inverse depth between neighbouring pixels of one surface.
fn same_surface(rho: f64, focal_px: f64, noise: &SensorNoise) -> f64 {
    let by_slope = STEEPEST / focal_px * rho;
    let by_noise = NOISE_GATE * std::f64::consts::SQRT_2 * noise.sigma(rho);
    by_slope.max(by_noise)
}

fn fill_cell(corners: &[Projected; 4], registration: &Registration<'_>, map: &mut InverseDepthMap) {
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
        if a.rho > 0.0 && b.rho > 0.0 && c.rho > 0.0 && is_continuous([a, b, c], registration) {
            fill_triangle([a, b, c], registration.noise, map);
        }
    }
}

/// Whether three neighbouring depth pixels may belong to one surface.
fn is_continuous(corners: [Projected; 3], registration: &Registration<'_>) -> bool {
    let rhos = corners.map(|corner| f64::from(corner.rho_in_depth));
    let nearest = rhos[0].max(rhos[1]).max(rhos[2]);
    let farthest = rhos[0].min(rhos[1]).min(rhos[2]);
    let focal = registration.depth_camera.mean_focal_px();
    nearest - farthest <= same_surface(nearest, focal, registration.noise)
}

/// Fills the pixels whose centres lie in a triangle; the nearest surface wins.
fn fill_triangle([a, b, c]: [Projected; 3], noise: &SensorNoise, map: &mut InverseDepthMap) {
    let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    if area == 0.0 || !area.is_finite() {
        return;
    }
    let last_x = (map.width() - 1) as f32;
    let last_y = (map.height() - 1) as f32;
    let from_x = a.x.min(b.x).min(c.x).ceil().max(0.0);
    let to_x = a.x.max(b.x).max(c.x).floor().min(last_x);
    let from_y = a.y.min(b.y).min(c.y).ceil().max(0.0);
    let to_y = a.y.max(b.y).max(c.y).floor().min(last_y);
    if from_x > to_x || from_y > to_y {
        return;
    }
    let width = map.width();
    let sigma = noise.sigma(f64::from(a.rho.max(b.rho).max(c.rho))) as f32;
    for y in from_y as usize..=to_y as usize {
        for x in from_x as usize..=to_x as usize {
            let (px, py) = (x as f32, y as f32);
            let weight_b = ((px - a.x) * (c.y - a.y) - (c.x - a.x) * (py - a.y)) / area;
            let weight_c = ((b.x - a.x) * (py - a.y) - (px - a.x) * (b.y - a.y)) / area;
            // Closed triangles: a pixel on a shared side is filled by both, which is harmless.
            if weight_b < 0.0 || weight_c < 0.0 || weight_b + weight_c > 1.0 {
                continue;
            }
            let rho = a.rho + weight_b * (b.rho - a.rho) + weight_c * (c.rho - a.rho);
            let slot = &mut map.raw_mut()[y * width + x];
            if rho > slot.rho {
                *slot = InverseDepth::new(rho, sigma).unwrap_or(UNKNOWN);
            }
        }
    }
}

#[cfg(test)]
mod tests;
