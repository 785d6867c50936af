//! Depth of the mesh in a view, for the visibility of its points.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::types::TextureView;
use crate::TriangleMesh;

/// A surface hides points that are farther than it by more than this share of their depth.
const DEPTH_SHARE: f64 = 0.01;
/// What is farther by this share of the depth, or not there, is another surface behind an outline.
const JUMP_SHARE: f64 = 0.03;
/// Points this close to an outline are seen with less confidence, on both of its sides: with poses and surfaces slightly
/// wrong, the pixel may show what is on the other one.
const GUARD_PX: usize = 2;
/// Confidence of such points.
const GUARDED: f32 = 0.05;
/// Triangles are clipped at this share of their largest depth in front of the camera.
const NEAR_SHARE: f64 = 1e-4;

/// Projection of world points into an image.
#[derive(Debug, Clone)]
pub(super) struct Projection {
    camera_from_world: Isometry3<f64>,
    focal: [f64; 2],
    centre: [f64; 2],
}

/// A projected point: pixel coordinates (the centre of the first pixel is (0, 0)) and depth z.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projected {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: f64,
}

impl Projection {
    pub(super) fn new(view: &TextureView) -> Self {
        let camera = &view.camera;
        Self {
            camera_from_world: view.world_from_camera.inverse(),
            focal: [camera.fx(), camera.fy()],
            centre: [camera.cx(), camera.cy()],
        }
    }

    fn point_in_camera(&self, point: &Point3<f64>) -> Point3<f64> {
        self.camera_from_world * point
    }

    fn pixel(&self, point: &Point3<f64>) -> Projected {
        let inverse = 1.0 / point.z;
        Projected {
            x: self.focal[0] * point.x * inverse + self.centre[0],
            y: self.focal[1] * point.y * inverse + self.centre[1],
            z: point.z,
        }
    }

    /// `None` behind the camera.
    pub(super) fn project(&self, point: &Point3<f64>) -> Option<Projected> {
        let point = self.point_in_camera(point);
        (point.z > 0.0).then(|| self.pixel(&point))
    }

    /// Product of the two focal lengths: pixels per solid angle on the axis.
    pub(super) fn pixels(&self) -> f64 {
        self.focal[0] * self.focal[1]
    }
}

/// Inverse depth of the nearest surface at each pixel.
pub(super) struct DepthBuffer {
    width: usize,
    height: usize,
    /// 0 where there is no surface.
    inverse: Vec<f32>,
    /// Largest inverse depth within [`GUARD_PX`].
    guarded: Vec<f32>,
    /// Smallest inverse depth within [`GUARD_PX`].
    smallest: Vec<f32>,
}

/// Change of the inverse depth of a triangle per pixel, along x plus along y.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slope(f64);

impl DepthBuffer {
    /// Draws all triangles, whichever side they show.
    pub(super) fn new(
        mesh: &TriangleMesh,
        projection: &Projection,
        (width, height): (u32, u32),
    ) -> Self {
        let (width, height) = (width as usize, height as usize);
        let mut buffer = Self {
            width,
            height,
            inverse: vec![0.0; width * height],
            guarded: Vec::new(),
            smallest: Vec::new(),
        };
        let points: Vec<Point3<f64>> = mesh
            .positions
            .par_iter()
            .map(|position| projection.point_in_camera(position))
            .collect();
        for triangle in &mesh.triangles {
            let corners = triangle.map(|corner| points[corner as usize]);
            buffer.draw_clipped(&corners, projection);
        }
        buffer.guarded = buffer.around(f32::max);
        buffer.smallest = buffer.around(f32::min);
        buffer
    }

    fn draw_clipped(&mut self, corners: &[Point3<f64>; 3], projection: &Projection) {
        let far = corners
            .iter()
            .fold(0.0, |far: f64, corner| far.max(corner.z));
        let near = NEAR_SHARE * far;
        if near.is_nan() || near <= 0.0 {
            return;
        }
        if corners.iter().all(|corner| corner.z >= near) {
            self.draw(corners.map(|corner| projection.pixel(&corner)));
            return;
        }
        // At most four corners are left in front of the near plane.
        let mut kept: Vec<Projected> = Vec::with_capacity(4);
        for (at, from) in corners.iter().enumerate() {
            let to = &corners[(at + 1) % 3];
            if from.z >= near {
                kept.push(projection.pixel(from));
            }
            if (from.z >= near) != (to.z >= near) {
                let share = (near - from.z) / (to.z - from.z);
                let mut cut = from + (to - from) * share;
                cut.z = near;
                kept.push(projection.pixel(&cut));
            }
        }
        for pair in kept[1..].windows(2) {
            self.draw([kept[0], pair[0], pair[1]]);
        }
    }

    /// Draws the pixels whose centres lie in a triangle or on its edges.
    fn draw(&mut self, corners: [Projected; 3]) {
        let Some(plane) = Plane::through(&corners) else {
            return;
        };
        let [low_x, high_x] = range(corners.map(|corner| corner.x), self.width);
        let [low_y, high_y] = range(corners.map(|corner| corner.y), self.height);
        let edges = edges(&corners);
        for y in low_y..high_y {
            let row = &mut self.inverse[y * self.width..(y + 1) * self.width];
            for (x, nearest) in row.iter_mut().enumerate().take(high_x).skip(low_x) {
                let (px, py) = (x as f64, y as f64);
                if edges.iter().all(|[a, b, c]| a * px + b * py + c >= 0.0) {
                    *nearest = nearest.max(plane.at(px, py) as f32);
                }
            }
        }
    }

    /// The largest or smallest inverse depth around each pixel.
    fn around(&self, of: fn(f32, f32) -> f32) -> Vec<f32> {
        let (width, height) = (self.width, self.height);
        let window =
            |at: usize, end: usize| at.saturating_sub(GUARD_PX)..(at + GUARD_PX + 1).min(end);
        let mut along = self.inverse.clone();
        let rows = self.inverse.chunks_exact(width);
        for (row, target) in rows.zip(along.chunks_exact_mut(width)) {
            for (x, found) in target.iter_mut().enumerate() {
                *found = row[window(x, width)].iter().copied().fold(*found, of);
            }
        }
        let mut both = along.clone();
        for (y, target) in both.chunks_exact_mut(width).enumerate() {
            for row in window(y, height) {
                let row = &along[row * width..(row + 1) * width];
                for (found, value) in target.iter_mut().zip(row) {
                    *found = of(*found, *value);
                }
            }
        }
        both
    }

    /// Slope of a triangle with the given corners in the image; `None` when it is seen from the side.
    pub(super) fn slope(corners: &[Projected; 3]) -> Option<Slope> {
        Plane::through(corners).map(|plane| Slope(plane.x.abs() + plane.y.abs()))
    }

    /// Slope of a triangle around one of its points, for triangles that reach behind the camera.
    pub(super) fn slope_around(
        point: &Point3<f64>,
        corners: &[Point3<f64>; 3],
        projection: &Projection,
    ) -> Option<Slope> {
        let [a, b, c] =
            corners.map(|corner| projection.project(&(point + (corner - point) * 1e-3)));
        Self::slope(&[a?, b?, c?])
    }

    /// Confidence, 0 to 1, that the pixel around a point on a triangle of the given slope shows that point.
    pub(super) fn visibility(&self, point: &Projected, slope: Slope) -> f32 {
        let (x, y) = (point.x.round(), point.y.round());
        if !(x >= 0.0 && y >= 0.0 && x < self.width as f64 && y < self.height as f64) {
            return 0.0;
        }
        let at = y as usize * self.width + x as usize;
        let own = (1.0 + DEPTH_SHARE) / point.z;
        if f64::from(self.inverse[at]) > own + slope.0 {
            return 0.0;
        }
        let slope = slope.0 * (GUARD_PX as f64 + 1.0);
        let behind = (1.0 - JUMP_SHARE) / point.z;
        if f64::from(self.guarded[at]) > own + slope
            || f64::from(self.smallest[at]) < behind - slope
        {
            GUARDED
        } else {
            1.0
        }
    }
}

/// Inverse depth as a function of the pixel, which is linear.
struct Plane {
    x: f64,
    y: f64,
    constant: f64,
}

impl Plane {
    fn through(corners: &[Projected; 3]) -> Option<Self> {
        let [a, b, c] = corners;
        let doubled = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
        if !(doubled.is_finite() && doubled.abs() > 1e-12) {
            return None;
        }
        let (to_b, to_c) = (1.0 / b.z - 1.0 / a.z, 1.0 / c.z - 1.0 / a.z);
        let x = (to_b * (c.y - a.y) - to_c * (b.y - a.y)) / doubled;
        let y = (to_c * (b.x - a.x) - to_b * (c.x - a.x)) / doubled;
        Some(Self {
            x,
            y,
            constant: 1.0 / a.z - x * a.x - y * a.y,
        })
    }

    fn at(&self, x: f64, y: f64) -> f64 {
        self.x * x + self.y * y + self.constant
    }
}

/// Pixels from the smallest to the largest of three coordinates, within an image side.
fn range(values: [f64; 3], side: usize) -> [usize; 2] {
    let low = values.iter().copied().fold(f64::INFINITY, f64::min).ceil();
    let high = values
        .iter()
        .copied()
        .fold(f64::NEG_INFINITY, f64::max)
        .floor()
        + 1.0;
    [low, high].map(|value| value.clamp(0.0, side as f64) as usize)
}

/// Lines a x + b y + c along the edges, positive inside.
fn edges(corners: &[Projected; 3]) -> [[f64; 3]; 3] {
    let line = |from: &Projected, to: &Projected, opposite: &Projected| {
        let (a, b) = (from.y - to.y, to.x - from.x);
        let c = -(a * from.x + b * from.y);
        let sign = if a * opposite.x + b * opposite.y + c < 0.0 {
            -1.0
        } else {
            1.0
        };
        [sign * a, sign * b, sign * c]
    };
    let [a, b, c] = corners;
    [line(a, b, c), line(b, c, a), line(c, a, b)]
}
