//! Pixels of a depth image with their camera.

use nalgebra::{Point3, Vector3};

/// Largest difference of neighbouring depths on one surface, as a share of the depth: an angle of some 80 degrees to the ray.
const LARGEST_SLOPE: f32 = 0.025;
/// Distance in pixels over which the slope of a surface is measured on either side: noise of neighbouring pixels would tilt it.
const SLOPE_REACH: usize = 3;
/// Largest second difference of the depth over that distance, as a share of the depth. Outlines bend more.
const LARGEST_BEND: f64 = 0.01;

/// A [`CompactDepth`](super::CompactDepth) unpacked, four bytes a pixel.
#[derive(Debug, Clone)]
pub struct DepthImage {
    /// Focal lengths and principal point, in pixels.
    focal_px: [f64; 2],
    center_px: [f64; 2],
    columns: usize,
    rows: usize,
    /// Row by row; 0 where the depth is unknown.
    depths: Vec<f32>,
}

impl DepthImage {
    /// Depths row by row, of a camera with these focal lengths and this principal point in pixels.
    pub(super) fn new(
        [focal_px, center_px]: [[f64; 2]; 2],
        columns: usize,
        depths: Vec<f32>,
    ) -> Self {
        Self {
            focal_px,
            center_px,
            columns,
            rows: depths.len() / columns.max(1),
            depths,
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
    pub fn get(&self, column: usize, row: usize) -> Option<f32> {
        let depth = self.depths[row * self.columns + column];
        (depth > 0.0).then_some(depth)
    }

    /// The point measured at a column and row, in the frame of the depth camera.
    ///
    /// # Panics
    /// When the column or the row is out of range.
    pub fn point(&self, column: usize, row: usize) -> Option<Point3<f64>> {
        let z = f64::from(self.get(column, row)?);
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
        let Some(depth) = self.interpolated(column, row) else {
            let nearest = self.get((column + 0.5) as usize, (row + 0.5) as usize)?;
            return Some(f64::from(nearest) - z);
        };
        // The plane m . x = 1, divided by the inverse depth: m = (-f dz/du / z, -f dz/dv / z, 1 - m_x x - m_y y) on the ray (x, y, 1).
        let right = self.slope(column as usize, self.columns, depth, |column| {
            (column, row as usize)
        });
        let down = self.slope(row as usize, self.rows, depth, |row| (column as usize, row));
        let slope = [right * self.focal_px[0], down * self.focal_px[1]].map(|it| -it / depth);
        let along = 1.0 - (slope[0] * x + slope[1] * y) * inverse;
        let normal = Vector3::new(slope[0], slope[1], along);
        Some((depth - z) / normal.norm())
    }

    /// Depth between four known pixels of one surface.
    #[inline]
    fn interpolated(&self, column: f64, row: f64) -> Option<f64> {
        let (left, top) = (column as usize, row as usize);
        if column < 0.0 || row < 0.0 || left + 1 >= self.columns || top + 1 >= self.rows {
            return None;
        }
        let [a, b] = [self.get(left, top)?, self.get(left + 1, top)?];
        let [c, d] = [self.get(left, top + 1)?, self.get(left + 1, top + 1)?];
        let (low, high) = (a.min(b).min(c.min(d)), a.max(b).max(c.max(d)));
        if high - low > LARGEST_SLOPE * low {
            return None;
        }
        let (x, y) = (column - left as f64, row - top as f64);
        let [a, b, c, d] = [a, b, c, d].map(f64::from);
        let (above, below) = (a + x * (b - a), c + x * (d - c));
        Some(above + y * (below - above))
    }

    /// Change of the depth a pixel along one axis, between two pixels that lie on either side at the same distance; 0 where depth does not change
    /// evenly between them, or one is unknown. `at` gives column and row of an index along the axis.
    #[inline]
    fn slope(
        &self,
        index: usize,
        count: usize,
        depth: f64,
        at: impl Fn(usize) -> (usize, usize),
    ) -> f64 {
        if index < SLOPE_REACH || index + SLOPE_REACH >= count {
            return 0.0;
        }
        let value = |index: usize| {
            let (column, row) = at(index);
            self.get(column, row).map(f64::from)
        };
        let ends = (value(index - SLOPE_REACH), value(index + SLOPE_REACH));
        let (Some(first), Some(last)) = ends else {
            return 0.0;
        };
        let bend = first + last - 2.0 * depth;
        match bend.abs() <= LARGEST_BEND * depth {
            true => (last - first) / (2 * SLOPE_REACH) as f64,
            false => 0.0,
        }
    }
}
