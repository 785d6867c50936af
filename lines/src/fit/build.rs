//! Conversion of two fitted lines to a 3D segment with covariance, with rejection of unreliable segments.

use std::ops::Range;

use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

use super::fitter::{FitInput, Fitted};
use super::options::{DepthModel, FitOptions};
use super::segment::Segment;
use crate::camera::Camera;
use crate::image::sobel;

/// One end of a segment.
struct End {
    pixel: Point2<f64>,
    rho: f64,
    rho_sigma: f64,
    point: Point3<f64>,
    covariance: Matrix3<f64>,
}

/// The 3D segment of a fit; `None` when a depth is not positive or the segment is nearly parallel to a view ray.
pub(super) fn build(
    fitted: &Fitted,
    pixels: Range<u32>,
    chain: u32,
    input: &FitInput<'_>,
    options: &FitOptions,
    is_inlier: impl Fn(usize) -> bool,
) -> Option<Segment> {
    let inliers = fitted.sums.image.n;
    let chain_pixels = input.chains.chain(chain as usize);
    let [first, last] = fitted.ends;
    let ends = [
        end(fitted, first, input.camera, options)?,
        end(fitted, last, input.camera, options)?,
    ];
    let along = ends[1].point - ends[0].point;
    let length = along.norm();
    if length.is_nan() || length <= 0.0 {
        return None;
    }
    let largest_cosine = options.minimum_view_angle_rad.cos();
    let is_seen_sideways = ends.iter().all(|end| {
        let cosine = along.dot(&end.point.coords).abs() / (length * end.point.coords.norm());
        cosine <= largest_cosine
    });
    if !is_seen_sideways {
        return None;
    }
    let [start, stop] = ends;
    Some(Segment {
        keyframe: input.keyframe,
        ends_in_camera: [start.point, stop.point],
        end_covariances: [start.covariance, stop.covariance],
        ends_px: [start.pixel, stop.pixel],
        inverse_depths: [start.rho, stop.rho],
        inverse_depth_sigmas: [start.rho_sigma, stop.rho_sigma],
        pixels,
        chain,
        inliers: inliers as u32,
        image_rms_px: fitted.lines.image.rms_px,
        depth_rms_sigmas: depth_rms(fitted, options),
        mean_gradient: mean_gradient(fitted, chain_pixels, input, is_inlier),
    })
}

/// Root mean square residual of the depth line, in standard deviations ([`DepthModel::InverseDepth`]) or pixels ([`DepthModel::Depth`]).
fn depth_rms(fitted: &Fitted, options: &FitOptions) -> f64 {
    let rms = (fitted.lines.depth.chi2 / fitted.sums.depth.n).sqrt();
    match options.depth_model {
        DepthModel::InverseDepth => rms,
        DepthModel::Depth => rms * fitted.sums.scale.unwrap_or(1.0),
    }
}

fn end(fitted: &Fitted, pixel: Vector2<f64>, camera: &Camera, options: &FitOptions) -> Option<End> {
    let lines = &fitted.lines;
    let position = lines.image.position(pixel);
    let on_line = fitted.sums.origin + lines.image.center + lines.image.direction * position;
    let value = lines.depth.at(position);
    // Residuals larger than the assumed noise replace it.
    let degrees = (fitted.sums.depth.n - 2.0).max(1.0);
    let reduced = fitted.lines.depth.chi2 / degrees;
    let (rho, variance) = match options.depth_model {
        DepthModel::InverseDepth => (value, lines.depth.variance(position) * reduced.max(1.0)),
        DepthModel::Depth => {
            let rho = 1.0 / value;
            // d rho = rho^2 d z
            (rho, lines.depth.variance(position) * reduced * rho.powi(4))
        }
    };
    if !(rho.is_finite() && rho > 0.0) {
        return None;
    }
    let rho_sigma = (variance * options.depth_correlation_px).sqrt();
    let pixel = Point2::from(on_line);
    let ray = Vector3::new(
        (pixel.x - camera.cx()) / camera.fx(),
        (pixel.y - camera.cy()) / camera.fy(),
        1.0,
    );
    let point = Point3::from(ray / rho);
    // All pixels determine the position across the line; the end of the edge determines the position along it.
    let across_variance = options.pixel_sigma_px.powi(2)
        * (1.0 / fitted.sums.image.n + position * position / lines.image.spread);
    let along = lines.image.direction;
    let across = Vector2::new(-along.y, along.x);
    // A shift along the image line also changes the depth.
    let rho_slope = match options.depth_model {
        DepthModel::InverseDepth => lines.depth.slope,
        DepthModel::Depth => -lines.depth.slope * rho * rho,
    };
    let in_space = |d: Vector2<f64>| Vector3::new(d.x / camera.fx(), d.y / camera.fy(), 0.0) / rho;
    let by_rho = -ray / (rho * rho);
    let by_along = in_space(along) + by_rho * rho_slope;
    let by_across = in_space(across);
    let covariance = by_along * by_along.transpose() * options.end_sigma_px.powi(2)
        + by_across * by_across.transpose() * across_variance
        + by_rho * by_rho.transpose() * (rho_sigma * rho_sigma);
    let is_finite = point
        .coords
        .iter()
        .chain(covariance.iter())
        .all(|c| c.is_finite());
    is_finite.then_some(End {
        pixel,
        rho,
        rho_sigma,
        point,
        covariance,
    })
}

fn mean_gradient(
    fitted: &Fitted,
    chain_pixels: &[[u16; 2]],
    input: &FitInput<'_>,
    is_inlier: impl Fn(usize) -> bool,
) -> Vector2<f64> {
    let (mut gx, mut gy, mut count) = (0, 0, 0);
    for (position, &[x, y]) in chain_pixels
        .iter()
        .enumerate()
        .take(fitted.last + 1)
        .skip(fitted.first)
    {
        if is_inlier(position) {
            let (dx, dy) = sobel(input.image, usize::from(x), usize::from(y));
            gx += dx;
            gy += dy;
            count += 1;
        }
    }
    // The Sobel weights sum to 8 per unit of slope.
    Vector2::new(f64::from(gx), f64::from(gy)) / (8.0 * f64::from(count.max(1)))
}
