//! Planes predicted from a triangulation of known edge depths.

use nalgebra::Point2;

use super::super::view::MatchView;
use super::field::Grid;
use super::plane::PixelPlane;
use crate::inverse_depth::InverseDepthMap;
use crate::triangulation::{ImageTriangulation, ImageVertex, SurfaceSamples};

/// Spacing of vertices along an edge chain.
const VERTEX_SPACING_PX: usize = 5;
/// Largest ratio of inverse depths in a triangle; beyond it the corners lie on different surfaces.
const MAX_RATIO: f64 = 1.5;

/// The known edge depths, triangulated in the image.
pub(super) struct EdgeTriangles {
    triangles: Vec<[ImageVertex; 3]>,
}

impl EdgeTriangles {
    /// # Complexity
    /// Expected O(n log n) for `n` edge pixels.
    pub(super) fn new(reference: &MatchView, map: &InverseDepthMap) -> Self {
        let vertices = known_edges(reference, map);
        let triangulation = ImageTriangulation::new(&vertices);
        let none = SurfaceSamples::default();
        let corners = triangulation
            .triangles(&none)
            .map(|triangle| triangle.corners.map(|corner| vertices[corner as usize]));
        Self {
            triangles: corners.collect(),
        }
    }

    /// The predicted plane of each grid pixel, row by row.
    ///
    /// # Complexity
    /// Linear in the grid pixels in the bounding boxes of the triangles.
    pub(super) fn planes(&self, grid: &Grid) -> Vec<Option<PixelPlane>> {
        let mut planes = vec![None; grid.columns * grid.rows];
        for corners in &self.triangles {
            let rho = corners.map(|corner| corner.rho);
            let (low, high) = extremes(rho);
            let Some(slope) = slope(corners).filter(|_| high <= MAX_RATIO * low) else {
                continue;
            };
            for_each_inside(grid, corners, |index, pixel| {
                let away = pixel - corners[0].pixel;
                let rho = corners[0].rho + away.x * slope[0] + away.y * slope[1];
                if rho > 0.0 {
                    planes[index] = Some(PixelPlane {
                        rho: rho as f32,
                        slope: slope.map(|component| component as f32),
                    });
                }
            });
        }
        planes
    }
}

/// Vertices along edges, at pixels with a known depth.
fn known_edges(reference: &MatchView, map: &InverseDepthMap) -> Vec<ImageVertex> {
    let chains = reference.chains();
    let mut vertices = Vec::new();
    for (index, chain) in chains.iter().enumerate() {
        let positions = &chains.positions()[chains.start(index)..];
        let mut last: Option<usize> = None;
        for (index_in_chain, (&[x, y], position)) in chain.iter().zip(positions).enumerate() {
            let is_due = last.is_none_or(|before| index_in_chain - before >= VERTEX_SPACING_PX);
            if !is_due && index_in_chain + 1 < chain.len() {
                continue;
            }
            let Some(known) = map.get(usize::from(x), usize::from(y)) else {
                continue;
            };
            vertices.push(ImageVertex {
                pixel: Point2::new(f64::from(position[0]), f64::from(position[1])),
                rho: f64::from(known.rho),
            });
            last = Some(index_in_chain);
        }
    }
    vertices
}

/// Minimum and maximum.
fn extremes(values: [f64; 3]) -> (f64, f64) {
    let [a, b, c] = values;
    (a.min(b).min(c), a.max(b).max(c))
}

/// Gradient of the inverse depth over a triangle; `None` for a degenerate triangle.
fn slope(corners: &[ImageVertex; 3]) -> Option<[f64; 2]> {
    let [a, b, c] = corners;
    let (to_b, to_c) = (b.pixel - a.pixel, c.pixel - a.pixel);
    let (rise_b, rise_c) = (b.rho - a.rho, c.rho - a.rho);
    let area = to_b.perp(&to_c);
    let slope = [
        (rise_b * to_c.y - rise_c * to_b.y) / area,
        (rise_c * to_b.x - rise_b * to_c.x) / area,
    ];
    slope
        .iter()
        .all(|component| component.is_finite())
        .then_some(slope)
}

/// Calls `visit` with index and pixel of each grid pixel in the closed triangle.
fn for_each_inside(
    grid: &Grid,
    corners: &[ImageVertex; 3],
    mut visit: impl FnMut(usize, Point2<f64>),
) {
    let pixels = corners.map(|corner| corner.pixel);
    let [a, b, c] = pixels;
    let orientation = (b - a).perp(&(c - a)).signum();
    let lines = |[low, high]: [f64; 2], count: usize| {
        let line = |at: f64| (at - f64::from(grid.offset)) / f64::from(grid.spacing);
        let start = line(low).ceil().max(0.0) as usize;
        let end = (line(high).floor() + 1.0).clamp(0.0, count as f64) as usize;
        start..end.max(start)
    };
    let (left, right) = extremes(pixels.map(|pixel| pixel.x));
    let (top, bottom) = extremes(pixels.map(|pixel| pixel.y));
    for row in lines([top, bottom], grid.rows) {
        for column in lines([left, right], grid.columns) {
            let point = Point2::from(grid.pixel(column, row).map(f64::from));
            let is_inside = [(a, b), (b, c), (c, a)]
                .iter()
                .all(|(from, to)| orientation * (to - from).perp(&(point - from)) >= 0.0);
            if is_inside {
                visit(row * grid.columns + column, point);
            }
        }
    }
}
