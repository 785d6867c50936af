//! Shading of a sample.

use nalgebra::{Point3, Vector3};

use super::buffer::Sample;
use super::options::{BackFaces, RenderOptions};
use crate::TriangleMesh;
use crate::raycast::closest_in_triangle;
use crate::srgb::{linear_color, linear_value};
use crate::texture::Texture;

/// Linear tint of back faces.
const BACK_TINT: [f64; 3] = [0.42, 0.16, 0.15];

/// Colours of a mesh in linear light.
pub(super) struct Albedo<'a> {
    mesh: &'a TriangleMesh,
    texture: Option<&'a Texture>,
    /// Of the vertices.
    colors: Option<Vec<[f32; 3]>>,
    clay: [f64; 3],
}

impl<'a> Albedo<'a> {
    /// Vertex colours are ignored when their number differs from that of the vertices, or there is a texture.
    pub(super) fn new(mesh: &'a TriangleMesh, texture: Option<&'a Texture>, clay: [u8; 3]) -> Self {
        let colors = mesh
            .colors
            .as_ref()
            .filter(|colors| colors.len() == mesh.positions.len())
            .map(|colors| {
                colors
                    .iter()
                    .map(|color| linear_color(*color).map(|v| v as f32))
                    .collect()
            });
        Self {
            mesh,
            texture,
            colors,
            clay: linear_color(clay),
        }
    }

    /// Linear colour of a point of a triangle.
    pub(super) fn at(&self, triangle: u32, point: &Point3<f64>) -> [f64; 3] {
        let corners = self.mesh.triangles[triangle as usize];
        let weights = || {
            let positions = corners.map(|corner| &self.mesh.positions[corner as usize]);
            closest_in_triangle(point, positions)
        };
        if let Some(texture) = self.texture {
            let color = texture.color_at(triangle, weights());
            return color.map(|value| linear_value(value / 255.0));
        }
        let Some(colors) = &self.colors else {
            return self.clay;
        };
        let mut color = [0.0; 3];
        for (corner, weight) in corners.into_iter().zip(weights()) {
            for (sum, part) in color.iter_mut().zip(colors[corner as usize]) {
                *sum += weight * f64::from(part);
            }
        }
        color
    }
}

/// Lights of a view.
pub(super) struct Light {
    up: Vector3<f64>,
    key: Vector3<f64>,
}

impl Light {
    /// Sky along `up`, a lamp over the left shoulder of the viewer who looks along `forward`.
    pub(super) fn new(up: &Vector3<f64>, right: &Vector3<f64>, forward: &Vector3<f64>) -> Self {
        Self {
            up: *up,
            key: (up * 1.1 - right * 0.55 - forward * 0.6).normalize(),
        }
    }

    /// The light on a sample; its normal and `toward_viewer` have unit length.
    pub(super) fn on(
        &self,
        (sample, normal): (&Sample, &Vector3<f64>),
        toward_viewer: &Vector3<f64>,
        openness: f64,
        options: &RenderOptions,
    ) -> LitSample {
        let is_tinted = !sample.face.is_front() && options.back_faces == BackFaces::Tinted;
        if !options.is_lit {
            return LitSample {
                is_tinted,
                light: None,
            };
        }
        let sky = 0.5 + 0.5 * normal.dot(&self.up);
        // An area light also illuminates slightly beyond its horizon.
        let key = ((normal.dot(&self.key) + 0.25) / 1.25).max(0.0);
        let head = normal.dot(toward_viewer).max(0.0);
        let ambient = openness * (0.34 + 0.16 * sky);
        let direct = (0.4 + 0.6 * openness) * (0.42 * key + 0.16 * head);
        let light = std::array::from_fn(|channel| {
            // Shade is a little blue and light a little warm, as in a room with a window.
            let cool = [0.96, 1.0, 1.06][channel];
            let warm = [1.04, 1.0, 0.95][channel];
            ambient * cool + direct * warm
        });
        LitSample {
            is_tinted,
            light: Some(light),
        }
    }
}

/// The light on a sample.
pub(super) struct LitSample {
    /// Whether it shows a back face with a colour of its own.
    is_tinted: bool,
    /// By channel; `None` without lamps.
    light: Option<[f64; 3]>,
}

impl LitSample {
    /// Linear light reflected to the viewer by a surface of linear `color`.
    pub(super) fn reflected(&self, color: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|channel| {
            let surface = match self.is_tinted {
                true => 0.3 * color[channel] + 0.7 * BACK_TINT[channel],
                false => color[channel],
            };
            (self.light).map_or(surface, |light| surface * light[channel] * 1.12)
        })
    }
}
