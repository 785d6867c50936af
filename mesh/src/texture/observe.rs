//! What the views see of each triangle.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::depth_buffer::{DepthBuffer, Projected};
use super::distortion::DistortionGrid;
use super::photo::{LoadPhoto, Photo, for_each_group};
use super::types::TextureView;
use crate::TriangleMesh;

/// Sample points on a triangle are about this many pixels apart.
const SAMPLE_PX: f64 = 3.0;
/// Largest number of sample points along a triangle's side.
const MAX_SAMPLES: usize = 12;
/// Triangles seen at a flatter angle are taken as not seen: cosine of the angle between view and normal.
const MIN_COSINE: f64 = 0.1;
/// Views kept per triangle: those with the most pixels per area.
pub(super) const MAX_VIEWS: usize = 16;

/// Visible share of a triangle from which on its colour is compared with that of other views.
const COMPARABLE_SHARE: f32 = 0.9;

/// Means of channels from here on, 0 to 255, are those of clipped colours in part.
pub(super) const BRIGHTEST_USABLE: f32 = 240.0;

/// What one view sees of one triangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation {
    pub(super) view: u32,
    /// Share of the triangle that is visible, 0 to 1.
    pub(super) share: f32,
    /// Pixels per unit of area on the triangle.
    pub(super) density: f32,
    /// Cosine of the angle between view and normal.
    pub(super) cosine: f32,
    /// Mean sRGB colour of the visible part, 0 to 255.
    pub(super) color: [f32; 3],
    /// Mean gradient magnitude of the visible part, per pixel.
    pub(super) gradient: f32,
    /// Whether the whole triangle lies inside the image.
    pub(super) is_whole: bool,
    /// How well the view suits as texture, 0 and up: see `quality`.
    pub(super) quality: f32,
}

impl Observation {
    /// Whether its colour is that of the whole triangle: those of different parts say nothing about each other.
    pub(super) fn is_comparable(&self) -> bool {
        self.share > COMPARABLE_SHARE
    }

    /// Whether its colour is that of a surface too bright for the photograph, or may be.
    pub(super) fn is_clipped(&self) -> bool {
        self.color.iter().any(|value| *value >= BRIGHTEST_USABLE)
    }
}

/// Observations of each triangle, in the order of views, and which views could be read.
pub(super) struct Observations {
    pub(super) of_triangle: Vec<Vec<Observation>>,
    /// Size of each photograph; `None` when it is missing.
    pub(super) sizes: Vec<Option<(u32, u32)>>,
}

/// Looks at all triangles in all views.
pub(super) fn observe(
    mesh: &TriangleMesh,
    views: &[TextureView],
    distortions: &[Option<DistortionGrid>],
    load: &LoadPhoto<'_>,
) -> Observations {
    let mut of_triangle = vec![Vec::new(); mesh.triangles.len()];
    let mut sizes = vec![None; views.len()];
    for_each_group(mesh, views, distortions, load, |photos| {
        let seen: Vec<Vec<(u32, Observation)>> = photos
            .par_iter()
            .map(|(view, photo)| observe_view(mesh, photo, &views[*view], *view as u32))
            .collect();
        for ((view, photo), seen) in photos.iter().zip(seen) {
            sizes[*view] = Some(photo.size());
            for (triangle, observation) in seen {
                add(&mut of_triangle[triangle as usize], observation);
            }
        }
    });
    Observations { of_triangle, sizes }
}

/// Adds an observation, in place of the coarsest one when there are enough.
fn add(observations: &mut Vec<Observation>, new: Observation) {
    if observations.len() == MAX_VIEWS {
        let worth = |o: &Observation| o.density * o.share * o.cosine;
        let coarsest = (0..observations.len())
            .min_by(|&a, &b| worth(&observations[a]).total_cmp(&worth(&observations[b])));
        match coarsest {
            Some(at) if worth(&observations[at]) < worth(&new) => observations.remove(at),
            _ => return,
        };
    }
    observations.push(new);
}

fn observe_view(
    mesh: &TriangleMesh,
    photo: &Photo,
    view: &TextureView,
    index: u32,
) -> Vec<(u32, Observation)> {
    let eye = Point3::from(view.world_from_camera.translation.vector);
    let projected: Vec<Option<Projected>> = mesh
        .positions
        .iter()
        .map(|position| photo.projection.project(position))
        .collect();
    let mut seen = Vec::new();
    for (triangle, corners) in mesh.triangles.iter().enumerate() {
        let pixels = corners.map(|corner| projected[corner as usize]);
        if is_outside(&pixels, photo.size()) {
            continue;
        }
        let points = corners.map(|corner| mesh.positions[corner as usize]);
        if let Some(observation) = observe_triangle(&points, pixels, photo, &eye, index) {
            seen.push((triangle as u32, observation));
        }
    }
    seen
}

/// Whether a triangle lies behind the camera or beyond one side of the image.
fn is_outside(pixels: &[Option<Projected>; 3], (width, height): (u32, u32)) -> bool {
    let [Some(a), Some(b), Some(c)] = pixels else {
        return pixels.iter().all(Option::is_none);
    };
    let beyond = |axis: fn(&Projected) -> f64, side: u32| {
        let values = [axis(a), axis(b), axis(c)];
        values.iter().all(|v| *v < -0.5) || values.iter().all(|v| *v > f64::from(side) - 0.5)
    };
    beyond(|p| p.x, width) || beyond(|p| p.y, height)
}

fn observe_triangle(
    points: &[Point3<f64>; 3],
    pixels: [Option<Projected>; 3],
    photo: &Photo,
    eye: &Point3<f64>,
    view: u32,
) -> Option<Observation> {
    let [a, b, c] = points;
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
    let centroid = Point3::from((a.coords + b.coords + c.coords) / 3.0);
    let toward_eye: Vector3<f64> = eye - centroid;
    let distance = toward_eye.norm();
    let cosine = normal.dot(&toward_eye) / distance;
    if cosine.is_nan() || cosine < MIN_COSINE {
        return None;
    }
    let longest = [(b - a).norm(), (c - b).norm(), (a - c).norm()]
        .into_iter()
        .fold(0.0, f64::max);
    let focal = photo.projection.pixels().sqrt();
    let steps = (longest * focal / distance / SAMPLE_PX).ceil();
    let steps = (steps as usize).clamp(1, MAX_SAMPLES);

    let whole = match pixels {
        [Some(a), Some(b), Some(c)] => Some([a, b, c]),
        _ => None,
    };
    let slope = whole.as_ref().and_then(DepthBuffer::slope);
    let (width, height) = photo.size();
    let is_inside = |p: &Projected| {
        p.x >= 0.0 && p.y >= 0.0 && p.x <= f64::from(width - 1) && p.y <= f64::from(height - 1)
    };
    let mut sums = [0.0_f32; 3];
    let (mut weights, mut gradients, mut inverse_squares) = (0.0_f32, 0.0_f32, 0.0_f64);
    for share in samples(steps) {
        let point = Point3::from(a.coords * share[0] + b.coords * share[1] + c.coords * share[2]);
        let Some(pixel) = photo.projection.project(&point) else {
            continue;
        };
        // A triangle that reaches behind the camera has the slope of a small part of it.
        let Some(slope) =
            slope.or_else(|| DepthBuffer::slope_around(&point, points, &photo.projection))
        else {
            continue;
        };
        let weight = photo.depth.visibility(&pixel, slope);
        if weight <= 0.0 {
            continue;
        }
        let color = photo.color(pixel.x, pixel.y);
        for (sum, value) in sums.iter_mut().zip(color) {
            *sum += weight * value;
        }
        gradients += weight * photo.gradient(pixel.x, pixel.y);
        inverse_squares += f64::from(weight) / (pixel.z * pixel.z);
        weights += weight;
    }
    if weights <= 0.0 {
        return None;
    }
    Some(Observation {
        view,
        share: weights / (steps * steps) as f32,
        density: (photo.projection.pixels() * cosine * inverse_squares / f64::from(weights)) as f32,
        cosine: cosine as f32,
        color: sums.map(|sum| sum / weights),
        gradient: gradients / weights,
        is_whole: whole.is_some_and(|corners| corners.iter().all(is_inside)),
        quality: 0.0,
    })
}

/// Barycentric coordinates of the centroids of `steps * steps` equal parts of a triangle.
pub(super) fn samples(steps: usize) -> impl Iterator<Item = [f64; 3]> {
    let side = 1.0 / (3 * steps) as f64;
    (0..steps).flat_map(move |row| {
        let upright = (0..steps - row).map(move |column| (3 * column + 1, 3 * row + 1));
        let turned =
            (0..(steps - row).saturating_sub(1)).map(move |column| (3 * column + 2, 3 * row + 2));
        upright.chain(turned).map(move |(v, w)| {
            let (v, w) = (v as f64 * side, w as f64 * side);
            [1.0 - v - w, v, w]
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_are_the_centroids_of_equal_parts() {
        for steps in 1..6 {
            let all: Vec<_> = samples(steps).collect();
            assert_eq!(all.len(), steps * steps);
            let mean: Vec<f64> = (0..3)
                .map(|axis| all.iter().map(|s| s[axis]).sum::<f64>() / all.len() as f64)
                .collect();
            assert!(
                mean.iter().all(|m| (m - 1.0 / 3.0).abs() < 1e-12),
                "{mean:?}"
            );
            assert!(all.iter().flatten().all(|share| *share > 0.0));
        }
    }
}
