//! Irradiance on the surfaces of a scene, computed once for all frames.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::scene::{Lamp, Scene};
use super::surface::Surface;
use super::texture::Rgb;
use linecarve_mesh::raycast::RayScene;

/// Spacing of the irradiance grid; values between are interpolated.
const SPACING_M: f64 = 0.05;
/// Samples along each side of a lamp, for soft shadows.
const LAMP_POINTS: u32 = 5;
/// Rays for the ambient occlusion.
const AMBIENT_RAYS: usize = 64;
/// Length of these rays: farther objects do not occlude ambient light.
const AMBIENT_REACH_M: f64 = 0.7;
/// Inset of the outermost grid points: the border of a surface itself lies in other surfaces.
const INSET_M: f64 = 0.002;

/// Irradiance of all surfaces of a scene.
pub(super) struct Lighting {
    maps: Vec<LightMap>,
}

/// Irradiance on a grid of points of one surface.
struct LightMap {
    columns: usize,
    rows: usize,
    values: Vec<[f32; 3]>,
}

impl Lighting {
    /// Computes direct light with soft shadows and occluded ambient light.
    pub(super) fn compute(scene: &Scene, rays: &RayScene) -> Self {
        let maps = scene
            .surfaces
            .par_iter()
            .map(|surface| LightMap::compute(surface, scene, rays))
            .collect();
        Self { maps }
    }

    /// Irradiance at a position of a surface, by channel.
    pub(super) fn at(&self, surface: usize, position: (f64, f64), size: (f64, f64)) -> Rgb {
        self.maps[surface].at(position, size)
    }
}

impl LightMap {
    fn compute(surface: &Surface, scene: &Scene, rays: &RayScene) -> Self {
        let points = |length: f64| (length / SPACING_M).ceil() as usize + 1;
        let (columns, rows) = (points(surface.size.0), points(surface.size.1));
        let mut values = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                let u = inset(column, columns, surface.size.0);
                let v = inset(row, rows, surface.size.1);
                let point = surface.point(u, v) + surface.normal() * 1e-4;
                let light = irradiance(&point, &surface.normal(), scene, rays);
                values.push(light.map(|channel| channel as f32));
            }
        }
        Self {
            columns,
            rows,
            values,
        }
    }

    fn at(&self, (u, v): (f64, f64), size: (f64, f64)) -> Rgb {
        let x = (u / size.0).clamp(0.0, 1.0) * (self.columns - 1) as f64;
        let y = (v / size.1).clamp(0.0, 1.0) * (self.rows - 1) as f64;
        let column = (x as usize).min(self.columns - 2);
        let row = (y as usize).min(self.rows - 2);
        let (s, t) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let value = |c: usize, r: usize| self.values[r * self.columns + c];
        let corners = [
            value(column, row),
            value(column + 1, row),
            value(column, row + 1),
            value(column + 1, row + 1),
        ];
        std::array::from_fn(|channel| {
            let low = corners[0][channel] + s * (corners[1][channel] - corners[0][channel]);
            let high = corners[2][channel] + s * (corners[3][channel] - corners[2][channel]);
            f64::from(low + t * (high - low))
        })
    }
}

fn inset(index: usize, count: usize, length: f64) -> f64 {
    let margin = INSET_M.min(0.25 * length);
    (length * index as f64 / (count - 1) as f64).clamp(margin, length - margin)
}

fn irradiance(point: &Point3<f64>, normal: &Vector3<f64>, scene: &Scene, rays: &RayScene) -> Rgb {
    let open = ambient_share(point, normal, rays);
    // Ceilings reflect more than floors.
    let from_above = 0.85 + 0.15 * normal.z;
    let mut sum = scene.ambient.map(|channel| channel * open * from_above);
    for lamp in &scene.lamps {
        let share = lamp_share(lamp, point, normal, rays);
        for (channel, power) in sum.iter_mut().zip(lamp.power) {
            *channel += power * share;
        }
    }
    sum
}

fn ambient_share(point: &Point3<f64>, normal: &Vector3<f64>, rays: &RayScene) -> f64 {
    // The additive recurrence of M. Roberts, "The Unreasonable Effectiveness of Quasirandom Sequences", 2018.
    const PLASTIC: f64 = 1.324_717_957_244_746;
    let helper = Vector3::ith(normal.iamin(), 1.0);
    let tangent = helper.cross(normal).normalize();
    let bitangent = normal.cross(&tangent);
    let open = (0..AMBIENT_RAYS)
        .filter(|index| {
            let along = |power: i32| (0.5 + (index + 1) as f64 / PLASTIC.powi(power)).fract();
            let (radius, angle) = (along(1).sqrt(), std::f64::consts::TAU * along(2));
            let direction = tangent * (radius * angle.cos())
                + bitangent * (radius * angle.sin())
                + normal * (1.0 - radius * radius).sqrt();
            !rays.is_occluded(point, &direction, AMBIENT_REACH_M)
        })
        .count();
    open as f64 / AMBIENT_RAYS as f64
}

/// Irradiance from a lamp of unit power: the mean over its samples of cos cos / distance squared where visible.
fn lamp_share(lamp: &Lamp, point: &Point3<f64>, normal: &Vector3<f64>, rays: &RayScene) -> f64 {
    let axis = lamp.half_u.cross(&lamp.half_v).normalize();
    let mut sum = 0.0;
    for i in 0..LAMP_POINTS {
        for j in 0..LAMP_POINTS {
            let offset = |k: u32| (f64::from(k) + 0.5) / f64::from(LAMP_POINTS) * 2.0 - 1.0;
            let source = lamp.centre + lamp.half_u * offset(i) + lamp.half_v * offset(j);
            let toward = source - point;
            let squared = toward.norm_squared();
            let distance = squared.sqrt();
            let (sent, received) = (-toward.dot(&axis) / distance, toward.dot(normal) / distance);
            if sent > 0.0 && received > 0.0 && !rays.is_occluded(point, &toward, 0.999) {
                sum += sent * received / squared;
            }
        }
    }
    sum / f64::from(LAMP_POINTS * LAMP_POINTS)
}
