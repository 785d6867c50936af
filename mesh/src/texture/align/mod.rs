//! Poses of photographs, adjusted until they agree about the brightness of a mesh.
//!
//! With poses of a depth camera, or of a tracker that slowly drifts, a photograph is shifted against the surface by pixels, and detail of different
//! photographs does not meet. The brightness of points on the mesh is the mean of the views that see them; each view moves so that it shows
//! what the others show; both alternate, on reduced images first. What all photographs of a camera have in common is estimated with their poses: the distortion of
//! its lens beyond the given calibration. Cameras with a rolling shutter turn while a photograph is exposed row by row; each has a rotation over its rows.
//!
//! # Reference
//! Q.-Y. Zhou, V. Koltun, *Color Map Optimization for 3D Reconstruction with Consumer Depth Cameras*, SIGGRAPH 2014, section 4.1.
//! *Differs from the paper*: a view is compared with the mean of the others, not with one that includes it; gain and offset for each view; robust
//! errors; given poses count as measurements, which holds what all views have in common; photographs of a camera are deformed together, each by itself only by
//! a rotation over its rows.

mod lens;
mod pyramid;
mod row_rotation;
mod samples;
mod step;
#[cfg(test)]
mod tests;

use linecarve_lines::camera::Camera;
use nalgebra::Isometry3;
use rayon::prelude::*;

use super::distortion::DistortionGrid;
use super::photo::LoadPhoto;
use super::types::TextureView;
use crate::TriangleMesh;
use pyramid::{LEVELS, Pyramid};
use samples::{SurfacePoint, seen, surface_points};
use step::{Aligned, Expected};

/// Rounds on each level, and before them on the smallest one without the lens.
const ROUNDS: usize = 8;
/// Rounds on each level for a view by itself.
const SINGLE_ROUNDS: usize = 12;
/// Views that would move further than this share of the longer side keep their pose.
const LARGEST_MOVE: f64 = 0.05;

/// Poses that agree about the brightness of a mesh.
pub struct PhotoAlignment {
    /// The views; as given where the photograph cannot be read or sees too little.
    pub views: Vec<TextureView>,
    /// Displacements of each photograph, by its lens and by motion while its rows were exposed; `None` where it cannot be read or sees too little.
    pub distortions: Vec<Option<DistortionGrid>>,
    /// Root mean square of how far the photographs moved, in their pixels.
    pub moved_px: f64,
    points: Vec<SurfacePoint>,
    lenses: Vec<Lens>,
    /// Mean brightness of each point at each level; NaN where no view sees it.
    brightness: Vec<Vec<f32>>,
}

/// A photograph with the points that it sees.
struct Photo<'a> {
    index: usize,
    size: (u32, u32),
    /// Number of its lens.
    lens: usize,
    pyramid: Pyramid,
    points: Vec<u32>,
    aligned: Aligned<'a>,
    /// Whether it shows what the others show. Others do not count.
    fits: bool,
}

/// What photographs of a camera with the same size have in common.
struct Lens {
    camera: Camera,
    size: (u32, u32),
    distortion: DistortionGrid,
}

/// Sum of the brightness of a point, and the number of views.
#[derive(Clone, Copy, Default)]
struct Sum {
    brightness: f64,
    count: u32,
}

/// Adjusts the poses of the photographs of a mesh to each other. Arguments as for [`texture_mesh`](super::texture_mesh); the photographs are read once.
///
/// The result is the same for any number of threads.
///
/// # Complexity
/// O(views x points), and O(nodes^3) for the 63 nodes or so of each lens, with about 60 000 points on the mesh. Memory holds each photograph with a longest side of 640 pixels at most, one byte
/// a pixel, and of all together at most 360 MB.
pub fn align_photos(
    mesh: &TriangleMesh,
    views: &[TextureView],
    load: &LoadPhoto<'_>,
) -> PhotoAlignment {
    let points = surface_points(mesh);
    let mut photos: Vec<Photo<'_>> = (0..views.len())
        .into_par_iter()
        .filter_map(|index| {
            let photo = load(index)?;
            let all = views.len();
            Photo::new(mesh, &points, (index, all), &views[index], &photo)
        })
        .collect();
    let mut lenses: Vec<Lens> = Vec::new();
    for photo in &mut photos {
        let same = |lens: &Lens| lens.is_of(&views[photo.index], photo.size);
        photo.lens = lenses.iter().position(same).unwrap_or_else(|| {
            lenses.push(Lens {
                camera: views[photo.index].camera.clone(),
                size: photo.size,
                distortion: photo.aligned.distortion.clone(),
            });
            lenses.len() - 1
        });
    }
    let mut counts = vec![0; lenses.len()];
    for photo in &photos {
        counts[photo.lens] += 1;
    }
    let mut brightness = vec![Vec::new(); LEVELS];
    for level in (0..LEVELS).rev() {
        if level + 1 == LEVELS {
            for _ in 0..ROUNDS {
                let (sums, values) = look(&photos, &points, level);
                photos
                    .par_iter_mut()
                    .zip(values)
                    .for_each(|(photo, own)| photo.step(&points, &sums, &own, level));
            }
        }
        for _ in 0..ROUNDS {
            let (sums, values) = look(&photos, &points, level);
            lens::step(&mut photos, &counts, level, |photo, at| {
                photo.expected(&points, &sums, &values[at])
            });
        }
        let (sums, _) = look(&photos, &points, level);
        let mean = |sum: &Sum| sum.mean().unwrap_or(f64::NAN) as f32;
        brightness[level] = sums.iter().map(mean).collect();
    }
    let mut aligned = views.to_vec();
    let mut distortions = vec![None; views.len()];
    let mut squares = 0.0;
    for photo in &photos {
        let moved = photo.moved_px(&points);
        if moved <= LARGEST_MOVE * photo.longer_side() {
            aligned[photo.index].world_from_camera = photo.aligned.camera_from_world.inverse();
            distortions[photo.index] = Some(photo.aligned.distortion_with_rows());
            squares += moved * moved;
        }
        // The photographs of a lens have the same distortion.
        lenses[photo.lens].distortion = photo.aligned.distortion.clone();
    }
    PhotoAlignment {
        views: aligned,
        distortions,
        moved_px: (squares / photos.len().max(1) as f64).sqrt(),
        points,
        lenses,
        brightness,
    }
}

impl PhotoAlignment {
    /// The pose from which a further photograph shows what the views showed, and its displacements: those of their lens if it has the same camera, and
    /// those by motion while its rows were exposed. The given pose where it sees too little of it.
    pub fn align(
        &self,
        mesh: &TriangleMesh,
        view: &TextureView,
        photo: &image::RgbImage,
    ) -> (Isometry3<f64>, Option<DistortionGrid>) {
        let Some(mut photo) = Photo::new(mesh, &self.points, (0, self.views.len()), view, photo)
        else {
            return (view.world_from_camera, None);
        };
        let mut lenses = self.lenses.iter();
        if let Some(lens) = lenses.find(|lens| lens.is_of(view, photo.size)) {
            photo.aligned.distortion = lens.distortion.clone();
        }
        for level in (0..LEVELS).rev() {
            for _ in 0..SINGLE_ROUNDS {
                let expected = photo.points.iter().filter_map(|&point| {
                    let brightness = f64::from(self.brightness[level][point as usize]);
                    let position = &self.points[point as usize].position;
                    (!brightness.is_nan()).then_some(Expected {
                        position,
                        brightness,
                    })
                });
                photo.aligned.step(photo.pyramid.level(level), expected);
            }
        }
        match photo.moved_px(&self.points) <= LARGEST_MOVE * photo.longer_side() {
            true => {
                let distortion = photo.aligned.distortion_with_rows();
                (photo.aligned.camera_from_world.inverse(), Some(distortion))
            }
            false => (view.world_from_camera, None),
        }
    }
}

impl<'a> Photo<'a> {
    fn new(
        mesh: &TriangleMesh,
        points: &[SurfacePoint],
        (index, all): (usize, usize),
        view: &'a TextureView,
        photo: &image::RgbImage,
    ) -> Option<Self> {
        let (width, height) = photo.dimensions();
        (width > 0 && height > 0).then(|| Self {
            index,
            pyramid: Pyramid::new(photo, all),
            size: (width, height),
            lens: 0,
            points: seen(mesh, points, view, (width, height)),
            aligned: Aligned::new(view, (width, height)),
            fits: true,
        })
    }

    /// Brightness of each of its points: of one in two on the second level, of one in four on the third.
    fn values(&self, points: &[SurfacePoint], level: usize) -> Vec<f32> {
        let every = 1 << level;
        let level = self.pyramid.level(level);
        let value = |point: &u32| {
            let position = &points[*point as usize].position;
            point
                .is_multiple_of(every)
                .then(|| self.aligned.brightness_of(level, position))?
        };
        let values = self.points.iter().map(value);
        values.map(|value| value.unwrap_or(f32::NAN)).collect()
    }

    fn longer_side(&self) -> f64 {
        f64::from(self.size.0.max(self.size.1))
    }

    /// What the other views show of its points; `own` is what it shows itself.
    fn expected<'b>(
        &self,
        points: &'b [SurfacePoint],
        sums: &[Sum],
        own: &[f32],
    ) -> Vec<Expected<'b>> {
        let expected = |(&point, own): (&u32, &f32)| {
            let sum = sums[point as usize];
            let brightness = match self.fits {
                true => sum.without(f64::from(*own))?,
                false => sum.mean()?,
            };
            let position = &points[point as usize].position;
            Some(Expected {
                position,
                brightness,
            })
        };
        self.points.iter().zip(own).filter_map(expected).collect()
    }

    /// Moves towards what the other views show.
    fn step(&mut self, points: &[SurfacePoint], sums: &[Sum], own: &[f32], level: usize) {
        let expected = self.expected(points, sums, own);
        let level = self.pyramid.level(level);
        self.fits = self.aligned.step(level, expected.into_iter()).is_some();
    }

    /// Root mean square of how far its points moved, in its pixels.
    fn moved_px(&self, points: &[SurfacePoint]) -> f64 {
        let moved = |&point: &u32| self.aligned.moved_px(&points[point as usize].position);
        let sum: f64 = self.points.iter().map(moved).sum();
        (sum / self.points.len().max(1) as f64).sqrt()
    }
}

impl Lens {
    fn is_of(&self, view: &TextureView, size: (u32, u32)) -> bool {
        self.camera == view.camera && self.size == size
    }
}

impl Sum {
    fn mean(self) -> Option<f64> {
        (self.count > 0).then(|| self.brightness / f64::from(self.count))
    }

    /// The mean of the views but one; `None` when no other sees the point.
    fn without(self, own: f64) -> Option<f64> {
        (self.count > 1 && !own.is_nan())
            .then(|| (self.brightness - own) / f64::from(self.count - 1))
    }
}

/// Sums of the brightness of each point over the views that see it, in their order, and the brightness of the points of each view.
fn look(photos: &[Photo<'_>], points: &[SurfacePoint], level: usize) -> (Vec<Sum>, Vec<Vec<f32>>) {
    let values: Vec<Vec<f32>> = photos
        .par_iter()
        .map(|photo| photo.values(points, level))
        .collect();
    let mut sums = vec![Sum::default(); points.len()];
    for (photo, values) in photos.iter().zip(&values).filter(|(photo, _)| photo.fits) {
        let seen = photo.points.iter().zip(values);
        for (point, value) in seen.filter(|(_, value)| !value.is_nan()) {
            let sum = &mut sums[*point as usize];
            sum.brightness += f64::from(*value);
            sum.count += 1;
        }
    }
    (sums, values)
}
