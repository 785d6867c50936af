//! Depth images reduced for alignment, with the plane at each pixel.

use linecarve_lines::depth::InverseDepthMap;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::camera::Pinhole;

/// Width of reduced images that is aimed at.
const WIDTH: usize = 160;

/// Neighbours on either side, in pixels, that determine a plane.
const PLANE_REACH: usize = 2;

/// Largest relative difference of inverse depth between neighbouring pixels of a surface.
const MAX_SLOPE: f32 = 0.03;

/// A depth image, reduced to about 160 pixels of width, and the plane at each pixel.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(crate) struct DenseView {
    width: usize,
    height: usize,
    /// Pixels of the image along a side of a reduced pixel.
    factor: usize,
    /// Inverse depth; 0 where unknown.
    rho: Vec<f32>,
    /// Standard deviation of the inverse depth relative to it.
    relative_sigma: Vec<f32>,
}

/// The surface at the pixels of a [`DenseView`] in coordinates of its camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct DenseSurface {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Focal lengths and principal point of the reduced image.
    pub(crate) fx: f32,
    pub(crate) fy: f32,
    pub(crate) cx: f32,
    pub(crate) cy: f32,
    /// Mean depth of the pixels, the length against which rotations are compared.
    pub(crate) depth: f64,
    /// Position of each pixel; z is 0 where it is unknown.
    pub(crate) points: Vec<Vector3<f32>>,
    /// The plane `plane . x = 1` at each pixel; zero where there is none.
    pub(crate) planes: Vec<Vector3<f32>>,
    /// Squared standard deviation of each depth relative to it.
    pub(crate) variances: Vec<f32>,
    /// Squared standard deviation of each plane along the image axes.
    pub(crate) slope_variances: Vec<f32>,
}

impl DenseView {
    /// Reduces a depth image: means of inverse depth over blocks that lie on one surface.
    pub(crate) fn new(map: &InverseDepthMap) -> Self {
        Self::of_width(map, WIDTH)
    }

    /// As [`new`](Self::new), reduced to about `width` pixels.
    pub(crate) fn of_width(map: &InverseDepthMap, width: usize) -> Self {
        let factor = (map.width() / width).max(1);
        let (width, height) = (map.width() / factor, map.height() / factor);
        let mut rho = vec![0.0; width * height];
        let mut relative_sigma = vec![0.0; width * height];
        for (at, (rho, sigma)) in rho.iter_mut().zip(&mut relative_sigma).enumerate() {
            let (x, y) = (at % width * factor, at / width * factor);
            let (mut count, mut sum, mut sum_sigma) = (0_usize, 0.0_f32, 0.0_f32);
            let (mut low, mut high) = (f32::INFINITY, 0.0_f32);
            for row in y..y + factor {
                for column in x..x + factor {
                    if let Some(sample) = map.get(column, row) {
                        count += 1;
                        sum += sample.rho;
                        sum_sigma += sample.sigma;
                        low = low.min(sample.rho);
                        high = high.max(sample.rho);
                    }
                }
            }
            // A block across an edge, or with holes, has no depth.
            let mean = sum / count.max(1) as f32;
            let mean_sigma = sum_sigma / count.max(1) as f32;
            let is_surface = 4 * count >= 3 * factor * factor
                && high - low <= MAX_SLOPE * mean + 4.0 * mean_sigma;
            if is_surface {
                *rho = mean;
                *sigma = mean_sigma / mean;
            }
        }
        Self {
            width,
            height,
            factor,
            rho,
            relative_sigma,
        }
    }

    /// Positions and planes of the pixels for a camera.
    ///
    /// Inverse depth is affine in the pixel over a plane; its slopes are fitted by least squares to pairs of opposite neighbours.
    pub(crate) fn surface(&self, camera: &Pinhole) -> DenseSurface {
        let scale = 1.0 / self.factor as f64;
        let mut surface = DenseSurface {
            width: self.width,
            height: self.height,
            fx: (camera.fx * scale) as f32,
            fy: (camera.fy * scale) as f32,
            cx: ((camera.cx + 0.5) * scale - 0.5) as f32,
            cy: ((camera.cy + 0.5) * scale - 0.5) as f32,
            depth: 0.0,
            points: vec![Vector3::zeros(); self.rho.len()],
            planes: vec![Vector3::zeros(); self.rho.len()],
            variances: self
                .relative_sigma
                .iter()
                .map(|sigma| sigma * sigma)
                .collect(),
            slope_variances: vec![0.0; self.rho.len()],
        };
        let (mut depths, mut known) = (0.0, 0);
        for (at, &rho) in self.rho.iter().enumerate().filter(|(_, rho)| **rho > 0.0) {
            let (x, y) = (at % self.width, at / self.width);
            let ray = surface.ray(x, y);
            surface.points[at] = ray / rho;
            depths += f64::from(1.0 / rho);
            known += 1;
            let across = Neighbors::new(1, x, self.width, self.width, y, self.height);
            let down = Neighbors::new(self.width, y, self.height, 1, x, self.width);
            if let [Some(along_x), Some(along_y)] = [across, down].map(|one| self.slope(at, &one)) {
                let (a, b) = (along_x[0] * surface.fx, along_y[0] * surface.fy);
                surface.planes[at] = Vector3::new(a, b, rho - a * ray.x - b * ray.y);
                let variance = surface.variances[at] * rho * rho;
                let unit = (surface.fx * surface.fx / along_x[1])
                    .max(surface.fy * surface.fy / along_y[1]);
                surface.slope_variances[at] = variance * unit;
            }
        }
        surface.depth = depths / f64::from(known.max(1));
        surface
    }

    /// Slope of the inverse depth along an axis in 1 / pixel, and the weight of the least squares: pairs of opposite neighbours on
    /// parallel lines around a pixel.
    fn slope(&self, at: usize, neighbors: &Neighbors) -> Option<[f32; 2]> {
        let rho = self.rho[at];
        let noise = 4.0 * self.relative_sigma[at] * rho;
        let (mut sum, mut weight) = (0.0_f32, 0.0_f32);
        for line in neighbors.lines.clone() {
            let center = (at as isize + line * neighbors.line_stride) as usize;
            for reach in 1..=neighbors.reach {
                let (before, after) = (
                    self.rho[center - reach * neighbors.stride],
                    self.rho[center + reach * neighbors.stride],
                );
                if before <= 0.0 || after <= 0.0 {
                    break;
                }
                let step = (after - before).abs();
                let bend = (after + before - 2.0 * self.rho[center]).abs();
                let away = (self.rho[center] - rho).abs();
                let reach = reach as f32;
                let is_surface = step <= 2.0 * reach * MAX_SLOPE * rho + noise
                    && bend <= 2.0 * noise
                    && away <= MAX_SLOPE * rho * line.unsigned_abs() as f32 + noise;
                if !is_surface {
                    break;
                }
                sum += reach * (after - before);
                weight += 2.0 * reach * reach;
            }
        }
        (weight > 0.0).then(|| [sum / weight, weight])
    }
}

/// Which pixels around one lie on both sides of it along an axis.
struct Neighbors {
    stride: usize,
    reach: usize,
    line_stride: isize,
    lines: std::ops::RangeInclusive<isize>,
}

impl Neighbors {
    fn new(
        stride: usize,
        position: usize,
        length: usize,
        line_stride: usize,
        line: usize,
        lines: usize,
    ) -> Self {
        let lowest = line.min(PLANE_REACH) as isize;
        let highest = (lines - 1 - line).min(PLANE_REACH) as isize;
        Self {
            stride,
            reach: PLANE_REACH.min(position).min(length - 1 - position),
            line_stride: line_stride as isize,
            lines: -lowest..=highest,
        }
    }
}

impl DenseSurface {
    /// Direction of a pixel with z = 1.
    fn ray(&self, x: usize, y: usize) -> Vector3<f32> {
        Vector3::new(
            (x as f32 - self.cx) / self.fx,
            (y as f32 - self.cy) / self.fy,
            1.0,
        )
    }

    /// Index of the pixel at which a point is seen.
    pub(crate) fn pixel_of(&self, point: &Vector3<f32>) -> Option<usize> {
        if point.z <= 0.0 {
            return None;
        }
        let inverse = 1.0 / point.z;
        let x = self.fx * point.x * inverse + self.cx + 0.5;
        let y = self.fy * point.y * inverse + self.cy + 0.5;
        let is_inside = x >= 0.0 && y >= 0.0 && x < self.width as f32 && y < self.height as f32;
        is_inside.then(|| y as usize * self.width + x as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use linecarve_lines::camera::Camera;
    use linecarve_lines::depth::InverseDepth;

    #[test]
    fn planes_of_a_slanted_wall_are_exact() {
        let camera = Camera::pinhole(500.0, 510.0, 320.0, 240.0).unwrap();
        let camera = Pinhole::new(&camera, 640, 480);
        let plane = Vector3::new(0.1_f32, -0.2, 0.5);
        let mut map = InverseDepthMap::unknown(640, 480).unwrap();
        for at in 0..640 * 480 {
            let (x, y) = (at % 640, at / 640);
            let ray = Vector3::new((x as f32 - 320.0) / 500.0, (y as f32 - 240.0) / 510.0, 1.0);
            map.set(x, y, InverseDepth::new(plane.dot(&ray), 1e-4));
        }
        let surface = DenseView::new(&map).surface(&camera);
        assert_eq!((surface.width, surface.height), (160, 120));
        for at in [161, 5000, 60 * 160 + 80] {
            assert!(
                (surface.planes[at] - plane).norm() < 1e-4,
                "{}",
                surface.planes[at]
            );
            assert_eq!(surface.pixel_of(&surface.points[at]), Some(at));
        }
        // Beside an unknown column no plane is fitted across it.
        for y in 0..480 {
            map.set(322, y, None);
            map.set(323, y, None);
        }
        let surface = DenseView::new(&map).surface(&camera);
        for column in 79..=81 {
            assert_eq!(surface.planes[60 * 160 + column], Vector3::zeros());
        }
        assert_eq!(surface.pixel_of(&Vector3::new(0.0, 0.0, -1.0)), None);
    }
}
