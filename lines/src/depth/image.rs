//! Pixels of a depth image with their camera.

use std::array::from_fn;

use nalgebra::{Point2, Point3, Vector3};
use wide::f32x4;

/// Largest difference of neighbouring inverse depths on one surface, as a share of them: an angle of some 80 degrees to the ray.
const LARGEST_SLOPE: f32 = 0.025;
/// Largest distance of four inverse depths in a row from a line, of the two in the middle from those at the ends, as a share of them. Outlines
/// bend more. Tuned on the kitchen of 7-Scenes, a synthetic living room and a rendered room.
const LARGEST_BEND: f32 = 0.004;

const ONE: f32x4 = f32x4::ONE;
const HALF: f32x4 = f32x4::HALF;

/// A [`CompactDepth`](super::CompactDepth) unpacked, four bytes a pixel.
#[derive(Debug, Clone)]
pub struct DepthImage {
    /// Focal lengths and principal point, in pixels.
    focal_px: [f64; 2],
    center_px: [f64; 2],
    columns: usize,
    rows: usize,
    /// Inverse depths row by row, with a margin on all sides; 0 there and where unknown.
    rhos: Vec<f32>,
}

/// Pixels beside the image, before and behind it, so that every pixel has one before and two behind.
const MARGIN: [usize; 2] = [1, 2];

impl DepthImage {
    /// Inverse depths row by row, of a camera with these focal lengths and this principal point in pixels; 0 where unknown.
    pub(super) fn new(
        [focal_px, center_px]: [[f64; 2]; 2],
        [columns, rows]: [usize; 2],
        pixels: impl Iterator<Item = f32>,
    ) -> Self {
        let [before, behind] = MARGIN;
        let stride = columns + before + behind;
        let mut rhos = vec![0.0; stride * (rows + before + behind)];
        let mut pixels = pixels.fuse();
        for row in rhos.chunks_exact_mut(stride).skip(before).take(rows) {
            for (place, rho) in row[before..before + columns].iter_mut().zip(&mut pixels) {
                *place = rho;
            }
        }
        Self {
            focal_px,
            center_px,
            columns,
            rows,
            rhos,
        }
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Unit normals, inwards, of the four planes through the camera and the sides of the image, in the frame of the depth camera.
    pub fn sides(&self) -> [Vector3<f64>; 4] {
        let [fx, fy] = self.focal_px;
        let [cx, cy] = self.center_px;
        // A pixel reaches half of its width beyond its centre.
        let (left, right) = (cx + 0.5, self.columns as f64 - 0.5 - cx);
        let (top, bottom) = (cy + 0.5, self.rows as f64 - 0.5 - cy);
        [
            Vector3::new(fx, 0.0, left),
            Vector3::new(-fx, 0.0, right),
            Vector3::new(0.0, fy, top),
            Vector3::new(0.0, -fy, bottom),
        ]
        .map(|normal| normal.normalize())
    }

    /// Depth at a column and row, in units of the poses; `None` where it is unknown.
    ///
    /// # Panics
    /// When the column or the row is out of range.
    #[inline]
    pub fn get(&self, column: usize, row: usize) -> Option<f64> {
        self.rho(column, row).map(|rho| 1.0 / rho)
    }

    /// The point measured at a column and row, in the frame of the depth camera.
    ///
    /// # Panics
    /// When the column or the row is out of range.
    pub fn point(&self, column: usize, row: usize) -> Option<Point3<f64>> {
        let z = self.get(column, row)?;
        let x = (column as f64 - self.center_px[0]) / self.focal_px[0] * z;
        let y = (row as f64 - self.center_px[1]) / self.focal_px[1] * z;
        Some(Point3::new(x, y, z))
    }

    /// Column and row at which a point in the frame of the depth camera appears, inside the image or not; `None` unless it lies before the camera.
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let [fx, fy] = self.focal_px;
        let [cx, cy] = self.center_px;
        let pixel = || Point2::new(fx * point.x / point.z + cx, fy * point.y / point.z + cy);
        (point.z > 0.0).then(pixel)
    }

    /// Column and row of the pixel around a position, and the inverse depth there; `None` outside the image, and where depth is unknown.
    #[inline]
    pub fn sample(&self, position: &Point2<f64>) -> Option<([usize; 2], f64)> {
        let (x, y) = (position.x + 0.5, position.y + 0.5);
        if !(x >= 0.0 && y >= 0.0) {
            return None;
        }
        let (column, row) = (x as usize, y as usize);
        let is_inside = column < self.columns && row < self.rows;
        let rho = is_inside.then(|| self.rho(column, row)).flatten()?;
        Some(([column, row], rho))
    }

    /// How far four points in the frame of the depth camera, given by their coordinates, lie before the surface measured along their rays;
    /// negative behind it. Where the four pixels around a point lie on one surface, the distance is that from their plane, else the difference
    /// to the depth of the nearest. NaN outside the image and where depth is unknown.
    ///
    /// Four at a time, because the fusion of depth images needs tens of millions; in single precision, which keeps micrometres.
    #[inline]
    pub fn distances(&self, [x, y, z]: [f32x4; 3]) -> f32x4 {
        let [fx, fy] = self.focal_px.map(|focal| f32x4::splat(focal as f32));
        let [cx, cy] = self.center_px.map(|center| f32x4::splat(center as f32));
        let inverse = ONE / z;
        let (across, along) = (x * inverse * fx, y * inverse * fy);
        let (column, row) = (across + cx, along + cy);
        let end = |count: usize| f32x4::splat(count as f32 - 0.5);
        let is_inside = column.simd_ge(-HALF)
            & row.simd_ge(-HALF)
            & column.simd_lt(end(self.columns))
            & row.simd_lt(end(self.rows))
            & z.simd_gt(f32x4::ZERO);
        if !is_inside.any() {
            return f32x4::splat(f32::NAN);
        }
        let surface = self.surfaces(is_inside & column, is_inside & row);
        // The plane m . x = 1: the inverse depth along the ray (x, y, 1) is m . (x, y, 1).
        let [right, down] = surface.slope;
        let constant = surface.rho - right * across - down * along;
        let (right, down) = (right * fx, down * fy);
        let normal = (right * right + down * down + constant * constant).sqrt();
        let is_known = is_inside & surface.rho.simd_gt(f32x4::ZERO);
        is_known.bitselect((ONE - surface.rho * z) / normal, f32x4::splat(f32::NAN))
    }

    /// The surfaces at four places inside the image, by their columns and rows.
    #[inline]
    fn surfaces(&self, column: f32x4, row: f32x4) -> Surfaces {
        let (left, top) = (column.fast_trunc_int(), row.fast_trunc_int());
        let (x, y) = (
            column - f32x4::from_i32x4(left),
            row - f32x4::from_i32x4(top),
        );
        let [left, top] = [left.to_array(), top.to_array()];
        let places: [[usize; 2]; 4] = from_fn(|lane| [left[lane] as usize, top[lane] as usize]);
        let row = |step| places.map(|[column, row]| self.four(column, row + step));
        let [above, _, lower, below] = [0, 1, 2, 3].map(row);
        let [before, a, b, behind] = f32x4::transpose(row(1).map(f32x4::new));
        let second = |row: [[f32; 4]; 4]| f32x4::new(row.map(|four| four[1]));
        let (above, c, below) = (second(above), second(lower), second(below));
        let d = f32x4::new(lower.map(|four| four[2]));
        let low = a.fast_min(b).fast_min(c.fast_min(d));
        let high = a.fast_max(b).fast_max(c.fast_max(d));
        let is_surface = low.simd_gt(f32x4::ZERO)
            & (high - low).simd_le(low * LARGEST_SLOPE)
            & x.simd_ge(f32x4::ZERO)
            & y.simd_ge(f32x4::ZERO);
        let (upper, lower) = (a + x * (b - a), c + x * (d - c));
        let is_left = x.simd_lt(HALF);
        let nearest = y
            .simd_lt(HALF)
            .bitselect(is_left.bitselect(a, b), is_left.bitselect(c, d));
        Surfaces {
            rho: is_surface.bitselect(upper + y * (lower - upper), nearest),
            slope: [
                is_surface & slope([before, a, b, behind]),
                is_surface & slope([above, a, c, below]),
            ],
        }
    }

    /// Inverse depths of the pixel before a column, of that in it and of the next two, in a row counted from one before the image.
    #[inline]
    fn four(&self, column: usize, row: usize) -> [f32; 4] {
        let start = row * self.stride() + column;
        let four = self.rhos[start..].first_chunk();
        four.copied().unwrap_or_default()
    }

    #[inline]
    fn stride(&self) -> usize {
        self.columns + MARGIN[0] + MARGIN[1]
    }

    #[inline]
    fn rho(&self, column: usize, row: usize) -> Option<f64> {
        assert!(column < self.columns && row < self.rows);
        let [margin, _] = MARGIN;
        let rho = self.rhos[(row + margin) * self.stride() + column + margin];
        (rho > 0.0).then_some(f64::from(rho))
    }
}

/// The planes of surfaces at four points of the image.
struct Surfaces {
    /// Inverse depths, which change evenly over the image of a plane; 0 where unknown.
    rho: f32x4,
    /// Their changes a pixel to the right and down; 0 where they do not change evenly.
    slope: [f32x4; 2],
}

/// Change of the inverse depth a pixel between the middle two of four pixels in a row; 0 where it does not change evenly, or one is unknown.
#[inline]
fn slope([first, left, right, last]: [f32x4; 4]) -> f32x4 {
    let sum = left + right;
    let is_even = (first + last - sum)
        .abs()
        .simd_le(sum * (0.5 * LARGEST_BEND))
        & first.simd_gt(f32x4::ZERO)
        & last.simd_gt(f32x4::ZERO);
    is_even & ((last - first) * (1.0 / 3.0))
}
