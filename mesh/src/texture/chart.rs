//! Charts: connected triangles of one view, laid out as they lie in its image.

use nalgebra::Point3;

use super::depth_buffer::Projection;
use super::observe::{Observation, Observations};
use super::pack::pack;
use super::types::TextureView;
use crate::TriangleMesh;

/// Texels between the triangles of a chart and its border.
const PADDING: f64 = 2.0;
/// Longest side, in texels, of a triangle that no view sees: enough for the colours of its vertices.
const UNSEEN_SIDE: f64 = 3.0;
/// Longest side, in texels, of a triangle with a chart of its own.
const MAX_TRIANGLE_SIDE: f64 = 2048.0;

/// Where the corners of triangles lie.
pub(super) struct Layout {
    /// Texture coordinates in texels of the atlas.
    pub(super) corners: Vec<[[f32; 2]; 3]>,
    pub(super) size: [u32; 2],
    pub(super) charts: usize,
}

/// A chart before packing.
struct Chart {
    triangles: std::ops::Range<usize>,
    low: [f64; 2],
    high: [f64; 2],
}

/// Charts of all triangles, with coordinates in pixels of their views.
struct Charts {
    charts: Vec<Chart>,
    /// Triangles, chart by chart.
    order: Vec<u32>,
    corners: Vec<[[f64; 2]; 3]>,
}

/// Lays out all triangles. Charts of a view keep the grid of its pixels unless the atlas would be larger than `max_texels`.
/// `None` when even charts of the smallest size do not fit.
pub(super) fn lay_out(
    mesh: &TriangleMesh,
    views: &[TextureView],
    observations: &Observations,
    labels: &[Option<usize>],
    neighbours: &[[Option<u32>; 3]],
    max_texels: u32,
) -> Option<Layout> {
    let charts = Charts::new(mesh, views, observations, labels, neighbours);
    let mut scale = 1.0;
    loop {
        let sizes: Vec<[u32; 2]> = charts
            .charts
            .iter()
            .map(|chart| chart.size(scale))
            .collect();
        let packed = pack(&sizes);
        if let Some((places, size)) = packed
            && u64::from(size[0]) * u64::from(size[1]) <= u64::from(max_texels)
        {
            return Some(Layout {
                corners: charts.placed(&places, scale),
                size,
                charts: places.len(),
            });
        }
        scale *= 0.8;
        if scale < 1e-2 {
            // Charts are then no more than their padding.
            return None;
        }
    }
}

impl Chart {
    /// Whole pixels below the lowest corner, which keeps the grid of the view.
    fn start(&self, scale: f64) -> [f64; 2] {
        self.low.map(|low| (low * scale).floor())
    }

    fn size(&self, scale: f64) -> [u32; 2] {
        let start = self.start(scale);
        std::array::from_fn(|axis| {
            (self.high[axis] * scale - start[axis] + 2.0 * PADDING + 1.0).ceil() as u32
        })
    }
}

impl Charts {
    fn new(
        mesh: &TriangleMesh,
        views: &[TextureView],
        observations: &Observations,
        labels: &[Option<usize>],
        neighbours: &[[Option<u32>; 3]],
    ) -> Self {
        let projections: Vec<Projection> = views.iter().map(Projection::new).collect();
        let label = |triangle: u32| {
            let at = labels[triangle as usize]?;
            Some(&observations.of_triangle[triangle as usize][at])
        };
        let mut charts = Self {
            charts: Vec::new(),
            order: Vec::with_capacity(labels.len()),
            corners: vec![[[0.0; 2]; 3]; labels.len()],
        };
        let largest = observations.sizes.iter().flatten();
        let size = largest.fold((1, 1), |a: (u32, u32), b| (a.0.max(b.0), a.1.max(b.1)));
        let mut mask = Mask::new(size);
        let mut is_placed = vec![false; labels.len()];
        let mut open: Vec<u32> = Vec::new();
        for seed in 0..labels.len() as u32 {
            if is_placed[seed as usize] {
                continue;
            }
            let Some(seed_label) = label(seed).filter(|observation| observation.is_whole) else {
                is_placed[seed as usize] = true;
                let points = mesh.triangles[seed as usize].map(|c| mesh.positions[c as usize]);
                charts.add_alone(seed, &points, label(seed));
                continue;
            };
            let (view, first) = (seed_label.view, charts.order.len());
            let projection = &projections[view as usize];
            mask.begin();
            open.push(seed);
            while let Some(triangle) = open.pop() {
                let belongs = |o: &&Observation| o.view == view && o.is_whole;
                if is_placed[triangle as usize] || label(triangle).filter(belongs).is_none() {
                    continue;
                }
                let points = mesh.triangles[triangle as usize].map(|c| mesh.positions[c as usize]);
                let Some(corners) = projected(projection, &points) else {
                    continue;
                };
                if !mask.claim(&corners) {
                    continue;
                }
                is_placed[triangle as usize] = true;
                charts.order.push(triangle);
                charts.corners[triangle as usize] = corners;
                open.extend(neighbours[triangle as usize].iter().rev().flatten());
            }
            charts.close(first);
        }
        charts
    }

    /// A chart of one triangle in its own plane, with the resolution of a view.
    fn add_alone(&mut self, triangle: u32, points: &[Point3<f64>; 3], view: Option<&Observation>) {
        let [a, b, c] = points;
        let longest = [(b - a).norm(), (c - b).norm(), (a - c).norm()]
            .into_iter()
            .fold(0.0, f64::max);
        let texels = match view {
            Some(view) => {
                (f64::from(view.density / view.cosine).sqrt() * longest).min(MAX_TRIANGLE_SIDE)
            }
            None => UNSEEN_SIDE,
        };
        let scale = if longest > 0.0 {
            texels.max(UNSEEN_SIDE) / longest
        } else {
            0.0
        };
        let along = (b - a).try_normalize(0.0).unwrap_or_default();
        let across = (c - a) - along * along.dot(&(c - a));
        let corner = |x: f64, y: f64| [x * scale, y * scale];
        self.corners[triangle as usize] = [
            corner(0.0, 0.0),
            corner((b - a).norm(), 0.0),
            corner(along.dot(&(c - a)), across.norm()),
        ];
        let first = self.order.len();
        self.order.push(triangle);
        self.close(first);
    }

    /// Ends the chart that began with the triangle at `first` of the order.
    fn close(&mut self, first: usize) {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for triangle in &self.order[first..] {
            for corner in &self.corners[*triangle as usize] {
                for axis in 0..2 {
                    low[axis] = low[axis].min(corner[axis]);
                    high[axis] = high[axis].max(corner[axis]);
                }
            }
        }
        if first < self.order.len() {
            let triangles = first..self.order.len();
            self.charts.push(Chart {
                triangles,
                low,
                high,
            });
        }
    }

    fn placed(&self, places: &[[u32; 2]], scale: f64) -> Vec<[[f32; 2]; 3]> {
        let mut placed = vec![[[0.0; 2]; 3]; self.corners.len()];
        for (chart, place) in self.charts.iter().zip(places) {
            let start = chart.start(scale);
            for triangle in &self.order[chart.triangles.clone()] {
                placed[*triangle as usize] = self.corners[*triangle as usize].map(|corner| {
                    // The centre of the first pixel of a view is (0, 0), that of an atlas (0.5, 0.5).
                    std::array::from_fn(|axis| {
                        let inside = corner[axis] * scale - start[axis] + PADDING + 0.5;
                        (f64::from(place[axis]) + inside) as f32
                    })
                });
            }
        }
        placed
    }
}

fn projected(projection: &Projection, points: &[Point3<f64>; 3]) -> Option<[[f64; 2]; 3]> {
    let mut corners = [[0.0; 2]; 3];
    for (corner, point) in corners.iter_mut().zip(points) {
        let pixel = projection.project(point)?;
        *corner = [pixel.x, pixel.y];
    }
    Some(corners)
}

/// The pixels of a view that a chart has taken.
struct Mask {
    width: u32,
    height: u32,
    /// The last chart at each pixel.
    chart: Vec<u32>,
    current: u32,
}

impl Mask {
    fn new((width, height): (u32, u32)) -> Self {
        let chart = vec![0; width as usize * height as usize];
        Self {
            width,
            height,
            chart,
            current: 0,
        }
    }

    fn begin(&mut self) {
        self.current += 1;
    }

    /// Takes the pixels inside a triangle, unless one of them is taken.
    fn claim(&mut self, corners: &[[f64; 2]; 3]) -> bool {
        let inside: Vec<usize> = texels_inside(corners, 0.0, [self.width, self.height])
            .map(|(x, y)| (y * self.width + x) as usize)
            .collect();
        if inside.iter().any(|at| self.chart[*at] == self.current) {
            return false;
        }
        for at in inside {
            self.chart[at] = self.current;
        }
        true
    }
}

/// Grid points (x, y) within `margin` of a triangle, in row order. Without margin, a point on an edge belongs to one of the two
/// triangles of that edge; triangles without area have none.
pub(super) fn texels_inside(
    corners: &[[f64; 2]; 3],
    margin: f64,
    [width, height]: [u32; 2],
) -> impl Iterator<Item = (u32, u32)> + use<> {
    let [a, b, c] = *corners;
    let doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    // Turned so that the inside lies to the left of each edge.
    let [a, b, c] = if doubled < 0.0 { [a, c, b] } else { [a, b, c] };
    let edge = move |from: [f64; 2], to: [f64; 2]| {
        let (x, y) = (from[1] - to[1], to[0] - from[0]);
        let length = x.hypot(y);
        // Of two triangles with opposite directions of an edge, one owns its points.
        let is_owner = y > 0.0 || (y == 0.0 && x > 0.0);
        (x, y, from, margin * length, is_owner)
    };
    let edges = [edge(a, b), edge(b, c), edge(c, a)];
    let is_flat = doubled == 0.0 || !doubled.is_finite();
    let range = move |axis: usize, side: u32| {
        let values = [a[axis], b[axis], c[axis]];
        let low = values.into_iter().fold(f64::INFINITY, f64::min) - margin;
        let high = values.into_iter().fold(f64::NEG_INFINITY, f64::max) + margin;
        let low = low.ceil().clamp(0.0, f64::from(side)) as u32;
        let high = (high.floor() + 1.0).clamp(0.0, f64::from(side)) as u32;
        if is_flat && margin == 0.0 {
            0..0
        } else {
            low..high
        }
    };
    let columns = range(0, width);
    range(1, height).flat_map(move |row| {
        columns.clone().filter_map(move |column| {
            let (px, py) = (f64::from(column), f64::from(row));
            let inside = edges.iter().all(|(x, y, from, reach, is_owner)| {
                let side = x * (px - from[0]) + y * (py - from[1]) + reach;
                side > 0.0 || (side == 0.0 && *is_owner)
            });
            inside.then_some((column, row))
        })
    })
}
