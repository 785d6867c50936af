//! Pixels of a depth image with their camera.

use nalgebra::{Point3, Vector3};

/// Largest difference of neighbouring inverse depths on one surface, as a share of them: an angle of some 80 degrees to the ray.
const LARGEST_SLOPE: f64 = 0.025;
/// Largest distance of four inverse depths in a row from a line, of the two in the middle from those at the ends, as a share of them. Outlines
/// bend more. Tuned on the kitchen of 7-Scenes, a synthetic living room and a rendered room.
const LARGEST_BEND: f64 = 0.004;

/// A [`CompactDepth`](super::CompactDepth) unpacked, four bytes a pixel.
#[derive(Debug, Clone)]
pub struct DepthImage {
    /// Focal lengths and principal point, in pixels.
    focal_px: [f64; 2],
    center_px: [f64; 2],
    columns: usize,
    rows: usize,
    /// Inverse depths row by row; 0 where unknown.
    rhos: Vec<f32>,
}

impl DepthImage {
    /// Inverse depths row by row, of a camera with these focal lengths and this principal point in pixels; 0 where unknown.
    pub(super) fn new(
        [focal_px, center_px]: [[f64; 2]; 2],
        columns: usize,
        rhos: Vec<f32>,
    ) -> Self {
        Self {
            focal_px,
            center_px,
            columns,
            rows: rhos.len() / columns.max(1),
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

    /// How far a point in the frame of the depth camera lies before the surface measured along its ray; negative behind it. Where the four pixels
    /// around lie on one surface, the distance is that from their plane, else the difference to the depth of the nearest. `None`
    /// outside the image and where depth is unknown.
    #[inline]
    pub fn distance(&self, point_in_depth: &Point3<f64>) -> Option<f64> {
        let [x, y, z] = [point_in_depth.x, point_in_depth.y, point_in_depth.z];
        if z.is_nan() || z <= 0.0 {
            return None;
        }
        let inverse = 1.0 / z;
        let column = x * inverse * self.focal_px[0] + self.center_px[0];
        let row = y * inverse * self.focal_px[1] + self.center_px[1];
        let (columns, rows) = (self.columns as f64, self.rows as f64);
        if !(column >= -0.5 && row >= -0.5 && column < columns - 0.5 && row < rows - 0.5) {
            return None;
        }
        let Some(surface) = self.surface(column, row) else {
            let nearest = self.get((column + 0.5) as usize, (row + 0.5) as usize)?;
            return Some(nearest - z);
        };
        // The plane m . x = 1: the inverse depth along the ray (x, y, 1) is m . (x, y, 1).
        let [right, down] = [0, 1].map(|axis| surface.slope[axis] * self.focal_px[axis]);
        let along = surface.rho - (right * x + down * y) * inverse;
        Some((1.0 - surface.rho * z) / Vector3::new(right, down, along).norm())
    }

    /// The surface between four known pixels; `None` where they do not lie on one.
    #[inline]
    fn surface(&self, column: f64, row: f64) -> Option<Surface> {
        let (left, top) = (column as usize, row as usize);
        if column < 0.0 || row < 0.0 || left + 1 >= self.columns || top + 1 >= self.rows {
            return None;
        }
        let [a, b] = [self.rho(left, top)?, self.rho(left + 1, top)?];
        let [c, d] = [self.rho(left, top + 1)?, self.rho(left + 1, top + 1)?];
        let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        if high - low > LARGEST_SLOPE * low {
            return None;
        }
        let (x, y) = (column - left as f64, row - top as f64);
        let (above, below) = (a + x * (b - a), c + x * (d - c));
        Some(Surface {
            rho: above + y * (below - above),
            slope: [
                slope(left, self.columns, [a, b], |column| self.rho(column, top)),
                slope(top, self.rows, [a, c], |row| self.rho(left, row)),
            ],
        })
    }

    #[inline]
    fn rho(&self, column: usize, row: usize) -> Option<f64> {
        let rho = self.rhos[row * self.columns + column];
        (rho > 0.0).then_some(f64::from(rho))
    }
}

/// The plane of a surface at a point of the image.
struct Surface {
    /// Inverse depth, which changes evenly over the image of a plane.
    rho: f64,
    /// Its change a pixel to the right and down; 0 where it does not change evenly.
    slope: [f64; 2],
}

/// Change of the inverse depth a pixel along an axis with `count` pixels, around the `middle` ones at `index` and the next; 0 where it does not change
/// evenly from the pixel before them to the one behind them, or one is unknown.
#[inline]
fn slope(index: usize, count: usize, middle: [f64; 2], rho: impl Fn(usize) -> Option<f64>) -> f64 {
    if index < 1 || index + 2 >= count {
        return 0.0;
    }
    let (Some(first), Some(last)) = (rho(index - 1), rho(index + 2)) else {
        return 0.0;
    };
    let sum = middle[0] + middle[1];
    match (first + last - sum).abs() <= 0.5 * LARGEST_BEND * sum {
        true => (last - first) / 3.0,
        false => 0.0,
    }
}
