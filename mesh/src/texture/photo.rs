//! Photographs with their depth buffers, read one per thread at a time.

use image::RgbImage;
use rayon::prelude::*;

use super::depth_buffer::{DepthBuffer, Projection};
use super::distortion::DistortionGrid;
use super::types::{TextureView, bilinear};
use crate::TriangleMesh;

/// Reads the photograph of a view by its index; `None` when it is missing.
pub type LoadPhoto<'a> = dyn Fn(usize) -> Option<RgbImage> + Sync + 'a;

/// A photograph.
pub(super) struct Photo {
    pub(super) projection: Projection,
    pub(super) depth: DepthBuffer,
    image: RgbImage,
    distortion: Option<DistortionGrid>,
}

impl Photo {
    fn new(
        mesh: &TriangleMesh,
        view: &TextureView,
        distortion: Option<&DistortionGrid>,
        image: RgbImage,
    ) -> Self {
        let projection = Projection::new(view);
        let depth = DepthBuffer::new(mesh, &projection, image.dimensions());
        Self {
            projection,
            depth,
            image,
            distortion: distortion.cloned(),
        }
    }

    pub(super) fn size(&self) -> (u32, u32) {
        self.image.dimensions()
    }

    fn in_image(&self, pixel: [f64; 2]) -> [f64; 2] {
        let distortion = self.distortion.as_ref();
        distortion.map_or(pixel, |distortion| distortion.photo_from_pinhole(pixel))
    }

    /// sRGB colour at a pixel of the pinhole camera, bilinear, 0 to 255; outside the image that of its border.
    pub(super) fn color(&self, x: f64, y: f64) -> [f32; 3] {
        let [x, y] = self.in_image([x, y]);
        bilinear(&self.image, x, y).map(|value| value as f32)
    }

    /// Gradient magnitude of the green channel at the pixel nearest to one of the pinhole camera, per pixel.
    pub(super) fn gradient(&self, x: f64, y: f64) -> f32 {
        let [x, y] = self.in_image([x, y]);
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
    distortions: &[Option<DistortionGrid>],
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
                Some((
                    index,
                    Photo::new(mesh, &views[index], distortions[index].as_ref(), image),
                ))
            })
            .collect();
        consume(&photos);
    }
}
