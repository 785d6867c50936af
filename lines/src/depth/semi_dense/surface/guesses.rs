//! Where the surface between edges may lie: planes through the corners of triangles whose depth is known.

use nalgebra::Point2;

use super::super::view::MatchView;
use crate::depth::map::InverseDepthMap;
use crate::triangulation::{ImageTriangulation, ImageVertex, SurfaceSamples};

/// Of the known pixels of an edge every this many become a vertex.
const VERTEX_SPACING_PX: usize = 5;
/// Places nearer to an edge than this are left to the edge.
const EDGE_DISTANCE_PX: usize = 3;
/// Inverse depths of the corners of a triangle differ at most by this factor: beyond it they lie on different surfaces.
const LARGEST_RATIO: f64 = 1.5;

/// A plane through which a place of the image may see the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Guess {
    /// The place.
    pub(super) pixel: [u16; 2],
    /// Inverse depth there.
    pub(super) rho: f32,
    /// Change of the inverse depth from one pixel to the next, along x and y.
    pub(super) slope: [f32; 2],
}

/// A guess for each place of a grid that is not near an edge and lies in a triangle of known depths of about one size; row by row.
///
/// # Complexity
/// Expected `n log n` for `n` pixels on edges, and the places in the boxes around the triangles.
pub(super) fn guesses(
    reference: &MatchView,
    map: &InverseDepthMap,
    spacing_px: usize,
) -> Vec<Guess> {
    let grid = Grid::new(reference, spacing_px);
    let mut guesses: Vec<Option<Guess>> = vec![None; grid.columns * grid.rows];
    let is_taken = grid.near_edges(reference);
    let (vertices, lines) = known_edges(reference, map);
    let triangulation = ImageTriangulation::new(&vertices, &lines);
    for triangle in triangulation.triangles(&SurfaceSamples::default()) {
        let corners = triangle.corners.map(|corner| vertices[corner as usize]);
        let (low, high) = extremes(corners.map(|corner| corner.rho));
        let Some(slope) = slope(&corners).filter(|_| high <= LARGEST_RATIO * low) else {
            continue;
        };
        grid.for_each_inside(&corners, |place, pixel| {
            let away = [
                f64::from(pixel[0]) - corners[0].pixel.x,
                f64::from(pixel[1]) - corners[0].pixel.y,
            ];
            let rho = corners[0].rho + away[0] * slope[0] + away[1] * slope[1];
            if !is_taken[place] && guesses[place].is_none() && rho > 0.0 {
                guesses[place] = Some(Guess {
                    pixel,
                    rho: rho as f32,
                    slope: slope.map(|component| component as f32),
                });
            }
        });
    }
    guesses.into_iter().flatten().collect()
}

/// Some of the pixels with a known depth, and the lines between those that follow each other on an edge.
fn known_edges(reference: &MatchView, map: &InverseDepthMap) -> (Vec<ImageVertex>, Vec<[u32; 2]>) {
    let chains = reference.chains();
    let (mut vertices, mut lines) = (Vec::new(), Vec::new());
    for (index, chain) in chains.iter().enumerate() {
        let positions = &chains.positions()[chains.start(index)..];
        let mut last: Option<(usize, u32)> = None;
        for (place, (&[x, y], position)) in chain.iter().zip(positions).enumerate() {
            let is_due = last.is_none_or(|(before, _)| place - before >= VERTEX_SPACING_PX);
            if !is_due && place + 1 < chain.len() {
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
            let is_next = |before: usize| place - before <= 2 * VERTEX_SPACING_PX;
            if let Some((_, before)) = last.filter(|(before, _)| is_next(*before)) {
                lines.push([before, vertex]);
            }
            last = Some((place, vertex));
        }
    }
    (vertices, lines)
}

/// Least and largest.
fn extremes(values: [f64; 3]) -> (f64, f64) {
    let [a, b, c] = values;
    (a.min(b).min(c), a.max(b).max(c))
}

/// Change of the inverse depth over a triangle along x and y; `None` of a triangle without an area.
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

/// The places of an image at which points are sought: every `spacing` pixels, the first half a spacing from the border.
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

    /// Lines of the grid from `low` to `high`.
    fn lines(&self, low: f64, high: f64, count: usize) -> std::ops::Range<usize> {
        let line = |at: f64| (at - (self.spacing / 2) as f64) / self.spacing as f64;
        let start = line(low).ceil().max(0.0) as usize;
        let end = (line(high).floor() + 1.0).clamp(0.0, count as f64) as usize;
        start..end.max(start)
    }

    fn pixel(&self, line: usize) -> usize {
        line * self.spacing + self.spacing / 2
    }

    /// Which places are near a pixel of an edge.
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

    /// Calls `visit` with number and pixel of each place in a triangle, its sides included.
    fn for_each_inside(&self, corners: &[ImageVertex; 3], mut visit: impl FnMut(usize, [u16; 2])) {
        let pixels = corners.map(|corner| corner.pixel);
        let [a, b, c] = pixels;
        let turn = (b - a).perp(&(c - a)).signum();
        let (left, right) = extremes(pixels.map(|pixel| pixel.x));
        let (top, bottom) = extremes(pixels.map(|pixel| pixel.y));
        for row in self.lines(top, bottom, self.rows) {
            for column in self.lines(left, right, self.columns) {
                let (x, y) = (self.pixel(column), self.pixel(row));
                let place = Point2::new(x as f64, y as f64);
                let is_inside = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(from, to)| turn * (to - from).perp(&(place - from)) >= 0.0);
                if is_inside {
                    visit(row * self.columns + column, [x as u16, y as u16]);
                }
            }
        }
    }
}
