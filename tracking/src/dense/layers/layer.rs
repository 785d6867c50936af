//! A depth image with its placement, and the surface that both make.

use std::borrow::Cow;

use linecarve_lines::camera::Camera;
use linecarve_lines::depth::{DepthCorrection, InverseDepthMap};
use nalgebra::{Isometry3, Vector3};

use super::super::view::{DenseSurface, DenseView};
use crate::camera::Pinhole;

/// Width that depth images are reduced to, about: means over blocks have less noise, and pairs of keyframes are many.
const WIDTH: usize = 80;

/// Where a layer lies: the pose of its depth camera, and the correction of its depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LayerPlacement {
    /// `point_in_world = world_from_camera * point_in_camera`, of the depth camera.
    pub world_from_camera: Isometry3<f64>,
    /// Correction of the depth.
    pub depth: DepthCorrection,
}

impl LayerPlacement {
    /// A pose with depth as given.
    pub fn given(world_from_camera: Isometry3<f64>) -> Self {
        Self {
            world_from_camera,
            depth: DepthCorrection::IDENTITY,
        }
    }
}

/// A depth image, reduced to about 80 pixels of width, with the plane at each pixel.
///
/// Memory: 32 bytes a reduced pixel.
#[derive(Debug, Clone)]
pub struct DepthLayer {
    surface: DenseSurface,
    given: Isometry3<f64>,
}

/// The surface of a layer after the correction of its depth, in the frame of its camera.
pub(super) struct PlacedSurface<'a> {
    pub(super) surface: &'a DenseSurface,
    pub(super) points: Cow<'a, [Vector3<f32>]>,
    pub(super) planes: Cow<'a, [Vector3<f32>]>,
}

impl DepthLayer {
    /// The layer of a depth image with the pose of its camera, a pinhole.
    pub fn new(map: &InverseDepthMap, camera: &Camera, world_from_camera: &Isometry3<f64>) -> Self {
        let pinhole = Pinhole::new(camera, map.width(), map.height());
        Self {
            surface: DenseView::of_width(map, WIDTH).surface(&pinhole),
            given: *world_from_camera,
        }
    }

    /// The pose it was made with.
    pub fn given(&self) -> &Isometry3<f64> {
        &self.given
    }

    /// Mean depth of its pixels; 0 if none is known.
    pub fn mean_depth(&self) -> f64 {
        self.surface.depth
    }

    pub(super) fn surface(&self) -> &DenseSurface {
        &self.surface
    }

    /// How far a point in the frame of its camera lies in front of the surface that the layer shows along its ray, as a share of the
    /// depth; `None` where it shows none, or one that is seen at a grazing angle.
    pub fn distance(&self, point: &Vector3<f64>) -> Option<f64> {
        let point: Vector3<f32> = point.cast();
        let plane = self.surface.planes[self.surface.pixel_of(&point)?];
        // The cosine between normal and ray is 1 / (|plane| |point|) on the surface.
        let is_seen = plane.norm_squared() > 0.0
            && plane.norm() * point.norm() * LEAST_COSINE <= plane.dot(&point).abs();
        is_seen.then(|| f64::from(1.0 - plane.dot(&point)))
    }

    /// The same layer with corrected depth.
    pub fn corrected(&self, placement: &LayerPlacement) -> Self {
        let placed = self.placed(&placement.depth);
        let (points, planes) = (placed.points.into_owned(), placed.planes.into_owned());
        let mut surface = self.surface.clone();
        surface.points = points;
        surface.planes = planes;
        Self {
            surface,
            given: placement.world_from_camera,
        }
    }

    /// Points and planes with corrected depth. Planes stay planes but for a shift of the depth, for which they are tangents.
    pub(super) fn placed(&self, depth: &DepthCorrection) -> PlacedSurface<'_> {
        let surface = &self.surface;
        let mut points = Cow::Borrowed(&surface.points[..]);
        let mut planes = Cow::Borrowed(&surface.planes[..]);
        if *depth != DepthCorrection::IDENTITY {
            for (point, plane) in points.to_mut().iter_mut().zip(planes.to_mut()) {
                if point.z <= 0.0 {
                    continue;
                }
                let z = f64::from(point.z);
                let Some(corrected) = depth.depth(z) else {
                    (*point, *plane) = (Vector3::zeros(), Vector3::zeros());
                    continue;
                };
                *point *= (corrected / z) as f32;
                if *plane != Vector3::zeros() {
                    // Inverse depth is corrected to a * rho + b around this pixel.
                    let a = depth.slope(z) * (z / corrected).powi(2);
                    let b = 1.0 / corrected - a / z;
                    *plane = *plane * a as f32 + Vector3::z() * b as f32;
                }
            }
        }
        PlacedSurface {
            surface,
            points,
            planes,
        }
    }
}

/// Cosine of the largest angle between the normal of a surface and the ray to it with which depths are compared.
const LEAST_COSINE: f32 = 0.2;
