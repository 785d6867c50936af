//! Rendering of a picture, and PNG output.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use image::{Rgb, RgbImage};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::buffer::{Face, Sample, SampleBuffer, ViewRays};
use super::occlusion::Openness;
use super::options::{Background, RenderOptions, RenderOptionsError};
use super::outline::outline_at;
use super::segments::draw_segments;
use super::shade::{Albedo, Light};
use super::view::View;
use crate::encode_image::encode_png;
use crate::files::{WriteError, write_atomically};
use crate::raycast::RayScene;
use crate::srgb::{encoded_color, linear_color};
use crate::texture::{Texture, TextureError};
use crate::{LineSet, TriangleMesh};

/// A mesh prepared for rendering from any number of views.
///
/// ```
/// use linecarve_mesh::TriangleMesh;
/// use linecarve_mesh::render::{RenderOptions, Renderer, View};
/// use nalgebra::{Point3, Vector3};
///
/// let mesh = TriangleMesh {
///     positions: vec![Point3::new(-1.0, -1.0, 2.0), Point3::new(3.0, -1.0, 2.0), Point3::new(-1.0, 3.0, 2.0)],
///     triangles: vec![[0, 2, 1]],
///     ..TriangleMesh::default()
/// };
/// let up = -Vector3::y();
/// let view = View::look_at(&Point3::origin(), &Point3::new(0.0, 0.0, 1.0), &up, (64, 48), 1.0)?;
/// let picture = Renderer::new(&mesh).draw(None, &view, &RenderOptions::default(), &|_, _| {})?;
/// assert_eq!(picture.dimensions(), (64, 48));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Renderer<'a> {
    mesh: &'a TriangleMesh,
    texture: Option<&'a Texture>,
    scene: RayScene,
}

/// What a view shows of a mesh, whatever its colours.
struct Geometry<'v> {
    view: &'v View,
    buffer: SampleBuffer,
    openness: Option<Openness>,
    progress: &'v (dyn Fn(usize, usize) + Sync),
    /// Rows done and to do.
    done: AtomicUsize,
    total: usize,
}

/// What the samples of a pixel on one side of a triangle share: they are close to each other.
#[derive(Clone, Copy)]
struct Known<const N: usize> {
    face: Face,
    /// Linear light towards the viewer in each picture.
    light: [[f64; 3]; N],
}

/// What a picture shows: colours from a function in place of those of the mesh, and segments.
type Content<'a> = (Option<&'a PointColors<'a>>, Option<&'a LineSet>);

/// A function from points of a surface, many of them neighbours, to their sRGB colours.
pub type PointColors<'a> = dyn Fn(&[Point3<f64>]) -> Vec<[u8; 3]> + 'a;

/// Why a picture cannot be rendered or written.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// An option is out of its range.
    #[error(transparent)]
    Options(#[from] RenderOptionsError),
    /// The picture has no pixels or too many.
    #[error(
        "a picture of {width} x {height} pixels with {supersampling} x {supersampling} samples each cannot be drawn: at least one pixel and at most {} samples",
        MAX_SAMPLES
    )]
    Size {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
        /// Samples per pixel along each side.
        supersampling: u32,
    },
    /// The PNG could not be encoded.
    #[error("cannot encode {}: {source}", path.display())]
    Encode {
        /// The file.
        path: PathBuf,
        /// Error of the encoder.
        source: image::ImageError,
    },
    /// The file could not be written.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// Maximum samples of a picture: about 6 GB of buffer.
const MAX_SAMPLES: u64 = 1 << 27;

impl<'a> Renderer<'a> {
    /// Prepares a mesh. With an empty mesh, only background and segments are drawn.
    pub fn new(mesh: &'a TriangleMesh) -> Self {
        Self {
            mesh,
            texture: None,
            scene: RayScene::new(mesh),
        }
    }

    /// Draws a texture in place of vertex colours.
    ///
    /// # Errors
    /// When the texture does not fit the mesh.
    pub fn with_texture(mut self, texture: &'a Texture) -> Result<Self, TextureError> {
        texture.validate(self.mesh.triangles.len())?;
        self.texture = Some(texture);
        Ok(self)
    }

    /// The ray-cast scene of the mesh.
    pub fn scene(&self) -> &RayScene {
        &self.scene
    }

    /// Draws the mesh and, over it, segments.
    ///
    /// Parallel over rows; the same bytes for any number of threads. `progress` is called with rows done and rows to do,
    /// from any thread.
    ///
    /// # Errors
    /// When an option is out of its range or the picture has no pixel or too many.
    pub fn draw(
        &self,
        lines: Option<&LineSet>,
        view: &View,
        options: &RenderOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<RgbImage, PictureError> {
        let geometry = self.geometry(view, options, progress)?;
        let [picture] = geometry.draw(self, [(None, lines)], options);
        Ok(picture)
    }

    /// [`Renderer::draw`] with colours from a function of the surface position instead of vertex colours, so that
    /// errors appear where they are. `paint` is called once, with about one point a pixel.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub fn draw_colored(
        &self,
        paint: &PointColors<'_>,
        lines: Option<&LineSet>,
        view: &View,
        options: &RenderOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<RgbImage, PictureError> {
        let geometry = self.geometry(view, options, progress)?;
        let [picture] = geometry.draw(self, [(Some(paint), lines)], options);
        Ok(picture)
    }

    /// [`Renderer::draw`] and, without segments, [`Renderer::draw_colored`] from one view, in little more time than one of
    /// them.
    ///
    /// # Errors
    /// As [`Renderer::draw`].
    pub fn draw_both(
        &self,
        paint: &PointColors<'_>,
        lines: Option<&LineSet>,
        view: &View,
        options: &RenderOptions,
    ) -> Result<[RgbImage; 2], PictureError> {
        let geometry = self.geometry(view, options, &|_, _| {})?;
        Ok(geometry.draw(self, [(None, lines), (Some(paint), None)], options))
    }

    /// What pictures from one view share.
    fn geometry<'v>(
        &self,
        view: &'v View,
        options: &RenderOptions,
        progress: &'v (dyn Fn(usize, usize) + Sync),
    ) -> Result<Geometry<'v>, PictureError> {
        options.validate()?;
        let count = u64::from(view.width)
            * u64::from(view.height)
            * u64::from(options.supersampling * options.supersampling);
        if count == 0 || count > MAX_SAMPLES {
            return Err(PictureError::Size {
                width: view.width,
                height: view.height,
                supersampling: options.supersampling,
            });
        }
        let step = options.supersampling as usize;
        let height = view.height as usize;
        let occluded = options.occlusion_rays > 0;
        let total = height * step + (usize::from(occluded) + 1) * height;
        let done = AtomicUsize::new(0);
        let row_done = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
        let buffer = SampleBuffer::draw(self.mesh, view, step, options.back_faces, &row_done);
        let occlusion = (options.occlusion_rays, options.back_faces);
        let openness =
            occluded.then(|| Openness::measure(&self.scene, view, &buffer, occlusion, &row_done));
        Ok(Geometry {
            view,
            buffer,
            openness,
            progress,
            done,
            total,
        })
    }
}

impl Geometry<'_> {
    /// Pictures of it.
    fn draw<const N: usize>(
        &self,
        renderer: &Renderer<'_>,
        contents: [Content<'_>; N],
        options: &RenderOptions,
    ) -> [RgbImage; N] {
        let (view, buffer) = (self.view, &self.buffer);
        let light = self.light(renderer, contents.map(|(paint, _)| paint), options);
        std::array::from_fn(|index| {
            let mut light: Vec<[f64; 3]> = light.iter().map(|pixel| pixel[index]).collect();
            if let (_, Some(lines)) = contents[index] {
                draw_segments(&mut light, lines, view, buffer, options);
            }
            let mut picture = RgbImage::new(view.width, view.height);
            for (pixel, color) in picture.pixels_mut().zip(&light) {
                *pixel = Rgb(encoded_color(*color));
            }
            picture
        })
    }

    fn row_done(&self) {
        (self.progress)(self.done.fetch_add(1, Ordering::Relaxed) + 1, self.total);
    }

    /// Colours of the samples of each row of pixels: of the first in each pixel, and of those on another triangle than the one before.
    fn painted(&self, paint: &PointColors<'_>, rays: &ViewRays) -> Vec<Vec<[u8; 3]>> {
        let (view, buffer) = (self.view, &self.buffer);
        let step = buffer.supersampling;
        let points_of = |y: usize| {
            let mut points = Vec::new();
            for x in 0..view.width as usize {
                let mut known = None;
                for row in y * step..(y + 1) * step {
                    for column in x * step..(x + 1) * step {
                        let Some(sample) = buffer.at(column, row) else {
                            continue;
                        };
                        if known.replace(sample.face) != Some(sample.face) {
                            let ray = rays.direction(column, row);
                            points.push(rays.origin() + ray * f64::from(sample.depth));
                        }
                    }
                }
            }
            points
        };
        let rows: Vec<Vec<Point3<f64>>> = (0..view.height as usize)
            .into_par_iter()
            .map(points_of)
            .collect();
        let mut colors = paint(&rows.concat()).into_iter();
        rows.iter()
            .map(|row| colors.by_ref().take(row.len()).collect())
            .collect()
    }

    /// Linear light of each pixel in each picture, without segments.
    fn light<const N: usize>(
        &self,
        renderer: &Renderer<'_>,
        paints: [Option<&PointColors<'_>>; N],
        options: &RenderOptions,
    ) -> Vec<[[f64; 3]; N]> {
        let (view, buffer, openness) = (self.view, &self.buffer, self.openness.as_ref());
        let step = buffer.supersampling;
        let width = view.width as usize;
        let rays = ViewRays::new(view, step);
        let albedo = Albedo::new(renderer.mesh, renderer.texture, options.clay);
        let rotation = &view.world_from_camera.rotation;
        let lamps = Light::new(
            &view.up,
            &(rotation * Vector3::x()),
            &(rotation * Vector3::z()),
        );
        let painted = paints.map(|paint| paint.map(|paint| self.painted(paint, &rays)));
        let light_of = |sample: &Sample, place: (usize, usize), paints: &mut [Paints<'_>; N]| {
            let ray = rays.direction(place.0, place.1);
            let open = openness.map_or(1.0, |openness| openness.at(buffer, &rays, sample, place));
            let lit = lamps.on(
                (sample, &buffer.normal(sample)),
                &-ray.normalize(),
                open,
                options,
            );
            paints.each_mut().map(|paints| {
                let point = || rays.origin() + ray * f64::from(sample.depth);
                let surface = paints.next().map_or_else(
                    || albedo.at(sample.face.triangle(), &point()),
                    |color| linear_color(*color),
                );
                lit.reflected(surface)
            })
        };
        let sample_light =
            |place: (usize, usize), known: &mut Option<Known<N>>, paints: &mut [Paints<'_>; N]| {
                let sample = buffer.at(place.0, place.1)?;
                let light = match known {
                    Some(known) if known.face == sample.face => known.light,
                    _ => {
                        let face = sample.face;
                        let light = light_of(sample, place, paints);
                        known.insert(Known { face, light }).light
                    }
                };
                let (jump, fold) = outline_at(buffer, sample, place);
                let kept = (1.0 - options.outline_darkness * jump)
                    * (1.0 - options.crease_darkness * fold);
                Some(light.map(|color| color.map(|v| v * kept)))
            };
        let mut light = vec![[[0.0; 3]; N]; width * view.height as usize];
        light
            .par_chunks_mut(width)
            .enumerate()
            .for_each(|(y, line)| {
                let behind = [background(options.background, y, view.height); N];
                let mut paints = painted.each_ref().map(|rows| match rows {
                    Some(rows) => rows[y].iter(),
                    None => Paints::default(),
                });
                for (x, pixel) in line.iter_mut().enumerate() {
                    let mut known = None;
                    for row in y * step..(y + 1) * step {
                        for column in x * step..(x + 1) * step {
                            let colors = sample_light((column, row), &mut known, &mut paints)
                                .unwrap_or(behind);
                            let sums = pixel.as_flattened_mut().iter_mut();
                            for (sum, part) in sums.zip(colors.as_flattened()) {
                                // Clipped before averaging: a bright sample would
                                // hide an outline.
                                *sum += part.min(1.0);
                            }
                        }
                    }
                    let count = (step * step) as f64;
                    *pixel = pixel.map(|color| color.map(|sum| sum / count));
                }
                self.row_done();
            });
        light
    }
}

/// Colours of a row, in the order in which they are needed.
type Paints<'a> = std::slice::Iter<'a, [u8; 3]>;

fn background(background: Background, y: usize, height: u32) -> [f64; 3] {
    match background {
        Background::Plain(color) => linear_color(color),
        Background::Gradient(top, bottom) => {
            let t = y as f64 / f64::from(height.max(2) - 1);
            let (top, bottom) = (linear_color(top), linear_color(bottom));
            std::array::from_fn(|channel| top[channel] + t * (bottom[channel] - top[channel]))
        }
    }
}

/// Writes a picture as PNG, atomically.
///
/// # Errors
/// When the picture cannot be encoded or the file cannot be written.
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), PictureError> {
    let bytes = encode_png(picture).map_err(|source| PictureError::Encode {
        path: path.to_owned(),
        source,
    })?;
    write_atomically(path, |out| out.write_all(&bytes))?;
    Ok(())
}
