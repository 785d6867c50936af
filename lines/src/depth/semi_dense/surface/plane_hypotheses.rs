//! Predicts planes between edges from a triangulation of known edge depths.

use nalgebra::Point2;

use super::super::view::MatchView;
use crate::depth::map::InverseDepthMap;
use crate::triangulation::{ImageTriangulation, ImageVertex, SurfaceSamples};

/// Spacing of vertices along an edge chain.
const VERTEX_SPACING_PX: usize = 5;
/// Minimum distance of a grid pixel from edges.
const EDGE_DISTANCE_PX: usize = 3;
/// Largest ratio of inverse depths in a triangle; beyond it the corners lie on different surfaces.
const MAX_RATIO: f64 = 1.5;

/// A predicted surface plane at a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PlaneHypothesis {
    /// The pixel.
    pub(super) pixel: [u16; 2],
    /// Predicted inverse depth.
    pub(super) rho: f32,
    /// Gradient of the inverse depth per pixel along x and y.
    pub(super) slope: [f32; 2],
}

/// A hypothesis for each grid pixel away from edges inside a triangle of similar depths, row by row.
///
/// # Complexity
/// Expected O(n log n) for `n` edge pixels, plus the grid pixels in the bounding boxes of the triangles.
pub(super) fn plane_hypotheses(
    reference: &MatchView,
    map: &InverseDepthMap,
    spacing_px: usize,
) -> Vec<PlaneHypothesis> {
    let grid = Grid::new(reference, spacing_px);
    let mut hypotheses: Vec<Option<PlaneHypothesis>> = vec![None; grid.columns * grid.rows];
    let is_near_edge = grid.near_edges(reference);
    let (vertices, lines) = known_edges(reference, map);
    let triangulation = ImageTriangulation::new(&vertices, &lines);
    for triangle in triangulation.triangles(&SurfaceSamples::default()) {
        let corners = triangle.corners.map(|corner| vertices[corner as usize]);
        let (low, high) = extremes(corners.map(|corner| corner.rho));
        let Some(slope) = slope(&corners).filter(|_| high <= MAX_RATIO * low) else {
            continue;
        };
        grid.for_each_inside(&corners, |index, pixel| {
            let away = [
                f64::from(pixel[0]) - corners[0].pixel.x,
                f64::from(pixel[1]) - corners[0].pixel.y,
            ];
            let rho = corners[0].rho + away[0] * slope[0] + away[1] * slope[1];
            if !is_near_edge[index] && hypotheses[index].is_none() && rho > 0.0 {
                hypotheses[index] = Some(PlaneHypothesis {
                    pixel,
                    rho: rho as f32,
                    slope: slope.map(|component| component as f32),
                });
            }
        });
    }
    hypotheses.into_iter().flatten().collect()
}

/// Vertices at edge pixels with a known depth, and constraint edges between consecutive vertices of a chain.
fn known_edges(reference: &MatchView, map: &InverseDepthMap) -> (Vec<ImageVertex>, Vec<[u32; 2]>) {
    let chains = reference.chains();
    let (mut vertices, mut lines) = (Vec::new(), Vec::new());
    for (index, chain) in chains.iter().enumerate() {
        let positions = &chains.positions()[chains.start(index)..];
        let mut last: Option<(usize, u32)> = None;
        for (index_in_chain, (&[x, y], position)) in chain.iter().zip(positions).enumerate() {
            let is_due =
                last.is_none_or(|(before, _)| index_in_chain - before >= VERTEX_SPACING_PX);
            if !is_due && index_in_chain + 1 < chain.len() {
                continue;
            }
            let Some(known) = map.get(usize::from(x), usize::from(y)) else {
                continue;
            };
            let vertex = vertices.len() as u32;
            vertices.push(ImageVertex {
                pixel: Point2::new(f64::from(position[0]), f64::from(position[1])),
                rho: f64::from(known.rho),
            });
            let is_next = |before: usize| index_in_chain - before <= 2 * VERTEX_SPACING_PX;
            if let Some((_, before)) = last.filter(|(before, _)| is_next(*before)) {
                lines.push([before, vertex]);
            }
            last = Some((index_in_chain, vertex));
        }
    }
    (vertices, lines)
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

/// A pixel grid with a margin of half a spacing.
#[derive(Debug, Clone, Copy)]
struct Grid {
    spacing: usize,
    columns: usize,
    rows: usize,
}

impl Grid {
    fn new(view: &MatchView, spacing: usize) -> Self {
        let image = view.smoothed();
        let count = |side: usize| (side / spacing) + usize::from(side % spacing > spacing / 2);
        Self {
            spacing,
            columns: count(image.width()),
            rows: count(image.height()),
        }
    }

    /// Grid lines with coordinates from `low` to `high`.
    fn lines(&self, low: f64, high: f64, count: usize) -> std::ops::Range<usize> {
        let line = |at: f64| (at - (self.spacing / 2) as f64) / self.spacing as f64;
        let start = line(low).ceil().max(0.0) as usize;
        let end = (line(high).floor() + 1.0).clamp(0.0, count as f64) as usize;
        start..end.max(start)
    }

    fn pixel(&self, line: usize) -> usize {
        line * self.spacing + self.spacing / 2
    }

    /// Flags the grid pixels near an edge.
    fn near_edges(&self, view: &MatchView) -> Vec<bool> {
        let mut is_near = vec![false; self.columns * self.rows];
        let reach = EDGE_DISTANCE_PX as f64;
        for [x, y] in view.chains().pixels() {
            let (x, y) = (f64::from(*x), f64::from(*y));
            for row in self.lines(y - reach, y + reach, self.rows) {
                for column in self.lines(x - reach, x + reach, self.columns) {
                    is_near[row * self.columns + column] = true;
                }
            }
        }
        is_near
    }

    /// Calls `visit` with index and pixel of each grid pixel in the closed triangle.
    fn for_each_inside(&self, corners: &[ImageVertex; 3], mut visit: impl FnMut(usize, [u16; 2])) {
        let pixels = corners.map(|corner| corner.pixel);
        let [a, b, c] = pixels;
        let orientation = (b - a).perp(&(c - a)).signum();
        let (left, right) = extremes(pixels.map(|pixel| pixel.x));
        let (top, bottom) = extremes(pixels.map(|pixel| pixel.y));
        for row in self.lines(top, bottom, self.rows) {
            for column in self.lines(left, right, self.columns) {
                let (x, y) = (self.pixel(column), self.pixel(row));
                let point = Point2::new(x as f64, y as f64);
                let is_inside = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(from, to)| orientation * (to - from).perp(&(point - from)) >= 0.0);
                if is_inside {
                    visit(row * self.columns + column, [x as u16, y as u16]);
                }
            }
        }
    }
}
