//! Rendering of colour and depth images.

use image::{Rgb as Pixel, RgbImage};
use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3, Vector3};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

use super::lighting::Lighting;
use super::scene::Scene;
use super::texture::Rgb;
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::srgb::encoded;

/// Samples per pixel along each side.
const SUPERSAMPLING: usize = 3;

/// Renders frames of a scene; its lighting is computed once.
pub struct FrameRenderer<'a> {
    scene: &'a Scene,
    rays: RayScene,
    lighting: Lighting,
    camera: Camera,
    width: usize,
    height: usize,
}

/// Colour and exact depth of one frame.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedFrame {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// Linear light of each pixel in row order: the mean over the pixel's area.
    pub light: Vec<[f32; 3]>,
    /// Depth z in metres at each pixel centre, in row order; `None` without a surface.
    pub depth: Vec<Option<f64>>,
}

impl<'a> FrameRenderer<'a> {
    /// A renderer with a pinhole camera (lens distortion is ignored) and images of `width` by `height` pixels.
    pub fn new(scene: &'a Scene, camera: &Camera, width: u32, height: u32) -> Self {
        let rays = RayScene::new(&scene.mesh());
        let lighting = Lighting::compute(scene, &rays);
        Self {
            scene,
            rays,
            lighting,
            camera: camera.without_distortion(),
            width: width as usize,
            height: height as usize,
        }
    }

    /// The ray-cast scene of the triangles.
    pub fn ray_scene(&self) -> &RayScene {
        &self.rays
    }

    /// Renders the frame of a camera at `world_from_camera`.
    pub fn render(&self, world_from_camera: &Isometry3<f64>) -> RenderedFrame {
        self.render_rows(&|_| *world_from_camera)
    }

    /// Renders a frame whose camera is at `world_from_camera(y)` when row `y` is exposed: that of a rolling shutter.
    pub fn render_rows(
        &self,
        world_from_camera: &dyn Fn(usize) -> Isometry3<f64>,
    ) -> RenderedFrame {
        let poses: Vec<Isometry3<f64>> = (0..self.height).map(world_from_camera).collect();
        let eye = |row: usize| Point3::from(poses[row].translation.vector);
        let direction = |row: usize, x: f64, y: f64| {
            poses[row].rotation
                * Vector3::new(
                    (x - self.camera.cx()) / self.camera.fx(),
                    (y - self.camera.cy()) / self.camera.fy(),
                    1.0,
                )
        };
        let mut depth = Vec::with_capacity(self.width * self.height);
        let mut seen = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            let eye = eye(y);
            for x in 0..self.width {
                let ray = direction(y, x as f64, y as f64);
                let hit = self.surface_on(&eye, &ray);
                depth.push(hit.map(|(_, distance)| distance));
                seen.push(hit.map(|(surface, _)| surface));
            }
        }
        let mut light = Vec::with_capacity(self.width * self.height);
        for y in 0..self.height {
            let eye = eye(y);
            for x in 0..self.width {
                // Where all neighbours show one surface, its samples need no search.
                let surface = self.common_surface(&seen, x, y);
                let mut sum = [0.0; 3];
                for step in 0..SUPERSAMPLING * SUPERSAMPLING {
                    let offset = |k: usize| (k as f64 + 0.5) / SUPERSAMPLING as f64 - 0.5;
                    let ray = direction(
                        y,
                        x as f64 + offset(step % SUPERSAMPLING),
                        y as f64 + offset(step / SUPERSAMPLING),
                    );
                    let color = match surface {
                        Some(surface) => self.color_on_plane(surface, &eye, &ray),
                        None => match self.surface_on(&eye, &ray) {
                            Some((surface, distance)) => {
                                self.color(surface, &(eye + ray * distance))
                            }
                            None => background(&ray),
                        },
                    };
                    for (total, part) in sum.iter_mut().zip(color) {
                        // Sensors saturate at one: values are clipped before averaging.
                        *total += part.min(1.0);
                    }
                }
                light.push(sum.map(|s| (s / (SUPERSAMPLING * SUPERSAMPLING) as f64) as f32));
            }
        }
        RenderedFrame {
            width: self.width as u32,
            height: self.height as u32,
            light,
            depth,
        }
    }

    /// The first surface that a ray hits from its front, and the hit.
    fn surface_on(&self, eye: &Point3<f64>, ray: &Vector3<f64>) -> Option<(u32, f64)> {
        let hit = self.rays.cast_where(eye, ray, f64::MAX, |_, front| front)?;
        // Two triangles per rectangle.
        Some((hit.triangle / 2, hit.distance))
    }

    fn common_surface(&self, seen: &[Option<u32>], x: usize, y: usize) -> Option<u32> {
        let own = seen[y * self.width + x]?;
        let columns = x.saturating_sub(1)..(x + 2).min(self.width);
        for row in y.saturating_sub(1)..(y + 2).min(self.height) {
            let line = &seen[row * self.width..(row + 1) * self.width];
            if line[columns.clone()]
                .iter()
                .any(|other| *other != Some(own))
            {
                return None;
            }
        }
        Some(own)
    }

    fn color_on_plane(&self, surface: u32, eye: &Point3<f64>, ray: &Vector3<f64>) -> Rgb {
        let plane = &self.scene.surfaces[surface as usize];
        let normal = plane.normal();
        let distance = (plane.origin - eye).dot(&normal) / ray.dot(&normal);
        self.color(surface, &(eye + ray * distance))
    }

    fn color(&self, surface: u32, point: &Point3<f64>) -> Rgb {
        let rectangle = &self.scene.surfaces[surface as usize];
        let (u, v) = rectangle.coordinates(point);
        let (albedo, glow) = rectangle.color_at(u, v);
        let light = self.lighting.at(surface as usize, (u, v), rectangle.size);
        std::array::from_fn(|c| albedo[c] * (light[c] * (1.0 - glow) + glow))
    }
}

/// A pale background, lighter above.
fn background(ray: &Vector3<f64>) -> Rgb {
    let up = 0.5 + 0.5 * ray.z / ray.norm();
    std::array::from_fn(|channel| 0.45 + 0.3 * up + 0.03 * channel as f64)
}

impl RenderedFrame {
    /// The frame as 8-bit sRGB: light times `gain`, plus normal noise of `noise` 8-bit steps. The random stream
    /// depends on the seed and on `frame`.
    pub fn color_image(&self, gain: f64, noise: f64, seed: u64, frame: u64) -> RgbImage {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        // Even streams belong to colour, odd ones to depth.
        random.set_stream(2 * frame + 2);
        let normal = Normal::new(0.0, noise).ok().filter(|_| noise > 0.0);
        let mut picture = RgbImage::new(self.width, self.height);
        for (pixel, light) in picture.pixels_mut().zip(&self.light) {
            *pixel = Pixel(light.map(|channel| {
                let grain = normal.map_or(0.0, |normal| normal.sample(&mut random));
                (encoded(f64::from(channel) * gain) + grain)
                    .round()
                    .clamp(0.0, 255.0) as u8
            }));
        }
        picture
    }
}
