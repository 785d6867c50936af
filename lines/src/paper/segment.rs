//! What the paper does not say of a segment, and a map of segments may ask: its pixels, gradient and deviations.

use nalgebra::{Matrix3, Point2, Vector2};

use super::PaperInput;
use super::fit::Found;
use crate::fit::Segment;
use crate::image::sobel;

/// The segment of a fit on chain number `chain`, whose pixels begin at `first` among those of all chains; `None` when an end does not lie in
/// the image of the camera.
///
/// The deviations are those of the depths of the end pixels, and a pixel across the ray: the paper weighs nothing.
pub(super) fn build(
    found: &Found<'_>,
    chain: u32,
    first: u32,
    input: &PaperInput<'_>,
) -> Option<Segment> {
    let inliers = found.pixels;
    let pixels = [inliers.first()?, inliers.last()?];
    let mut ends_px = [Point2::origin(); 2];
    let mut sigmas = [0.0; 2];
    let mut covariances = [Matrix3::zeros(); 2];
    for end in 0..2 {
        let point = &found.ends[end];
        ends_px[end] = input.camera.project(point)?;
        let [x, y] = input.chains.chain(chain as usize)[pixels[end].index].map(usize::from);
        let sigma = f64::from(input.depth.get(x, y)?.sigma);
        sigmas[end] = sigma;
        let along = point.coords * (sigma * point.z);
        let pixel = point.z / input.camera.mean_focal_px();
        let across = Matrix3::from_diagonal_element(pixel * pixel);
        covariances[end] = along * along.transpose() + across;
    }
    let (mut gx, mut gy) = (0, 0);
    for pixel in inliers {
        let [x, y] = pixel.position.map(|it| it as usize).into();
        let (dx, dy) = sobel(input.image, x, y);
        gx += dx;
        gy += dy;
    }
    let count = inliers.len() as f64;
    Some(Segment {
        keyframe: input.keyframe,
        ends_in_camera: found.ends,
        end_covariances: covariances,
        ends_px,
        inverse_depths: found.ends.map(|end| 1.0 / end.z),
        inverse_depth_sigmas: sigmas,
        pixels: first + pixels[0].index as u32..first + pixels[1].index as u32 + 1,
        chain,
        inliers: inliers.len() as u32,
        image_rms_px: found.image_rms_px,
        depth_rms_sigmas: found.depth_rms_px,
        // The Sobel weights sum to 8 per unit of slope.
        mean_gradient: Vector2::new(f64::from(gx), f64::from(gy)) / (8.0 * count),
    })
}
