//! Photographs with their depth buffers, read one per thread at a time.

use image::RgbImage;
use rayon::prelude::*;

use super::depth_buffer::{DepthBuffer, Projection};
use super::types::TextureView;
use crate::TriangleMesh;

/// Reads the photograph of a view by its index; `None` when it is missing.
pub type LoadPhoto<'a> = dyn Fn(usize) -> Option<RgbImage> + Sync + 'a;

/// A photograph.
pub(super) struct Photo {
    pub(super) projection: Projection,
    pub(super) depth: DepthBuffer,
    image: RgbImage,
}

impl Photo {
    fn new(mesh: &TriangleMesh, view: &TextureView, image: RgbImage) -> Self {
        let projection = Projection::new(view);
        let depth = DepthBuffer::new(mesh, &projection, image.dimensions());
        Self {
            projection,
            depth,
            image,
        }
    }

    pub(super) fn size(&self) -> (u32, u32) {
        self.image.dimensions()
    }

    /// sRGB colour at a pixel, bilinear, 0 to 255; outside the image that of its border.
    pub(super) fn color(&self, x: f64, y: f64) -> [f32; 3] {
        let (width, height) = self.image.dimensions();
        let limit = |value: f64, side: u32| (value as f32).clamp(0.0, (side - 1) as f32);
        let (x, y) = (limit(x, width), limit(y, height));
        let (left, top) = (x as usize, y as usize);
        let (u, v) = (x - left as f32, y - top as f32);
        let right = (left + 1).min(width as usize - 1);
        let bottom = (top + 1).min(height as usize - 1);
        let samples = self.image.as_raw();
        let at = |x: usize, y: usize| {
            let start = 3 * (y * width as usize + x);
            [samples[start], samples[start + 1], samples[start + 2]].map(f32::from)
        };
        let (a, b, c, d) = (
            at(left, top),
            at(right, top),
            at(left, bottom),
            at(right, bottom),
        );
        std::array::from_fn(|i| {
            (1.0 - v) * ((1.0 - u) * a[i] + u * b[i]) + v * ((1.0 - u) * c[i] + u * d[i])
        })
    }

    /// Gradient magnitude of the green channel at the nearest pixel, per pixel.
    pub(super) fn gradient(&self, x: f64, y: f64) -> f32 {
        let (width, height) = self.image.dimensions();
        let limit = |value: f64, side: u32| (value.round().max(0.0) as u32).min(side - 1);
        let (x, y) = (limit(x, width), limit(y, height));
        let green = |x: u32, y: u32| f32::from(self.image.get_pixel(x, y).0[1]);
        let along = green((x + 1).min(width - 1), y) - green(x.saturating_sub(1), y);
        let down = green(x, (y + 1).min(height - 1)) - green(x, y.saturating_sub(1));
        0.5 * along.hypot(down)
    }
}

/// Reads all photographs in groups of one per thread and passes each group on, in order.
pub(super) fn for_each_group(
    mesh: &TriangleMesh,
    views: &[TextureView],
    load: &LoadPhoto<'_>,
    mut consume: impl FnMut(&[(usize, Photo)]),
) {
    let group = rayon::current_num_threads().max(1);
    for first in (0..views.len()).step_by(group) {
        let indices = first..(first + group).min(views.len());
        let photos: Vec<(usize, Photo)> = indices
            .into_par_iter()
            .filter_map(|index| {
                let image = load(index).filter(|image| image.width() > 0 && image.height() > 0)?;
                Some((index, Photo::new(mesh, &views[index], image)))
            })
            .collect();
        consume(&photos);
    }
}
