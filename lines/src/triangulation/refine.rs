//! Delaunay triangulation of a keyframe and its greedy refinement.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::Point2;
use spade::handles::{FaceHandle, FixedVertexHandle, InnerTag};
use spade::{DelaunayTriangulation, HasPosition, Triangulation};

use super::options::RefineOptions;
use super::samples::{SurfaceSample, SurfaceSamples};

/// A surface point in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageVertex {
    /// Its pixel.
    pub pixel: Point2<f64>,
    /// Its inverse depth.
    pub rho: f64,
}

/// A triangle of an [`ImageTriangulation`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImageTriangle {
    /// Vertex indices, counter-clockwise with y up.
    pub corners: [u32; 3],
    /// Number of samples inside.
    pub samples: u32,
    /// Largest deviation of a sample from the triangle, in its standard deviations; 0 without samples.
    pub deviation_sigmas: f64,
}

/// A vertex as stored in the triangulation.
#[derive(Debug, Clone, Copy)]
struct Node {
    x: f64,
    y: f64,
    rho: f64,
    vertex: u32,
}

impl HasPosition for Node {
    type Scalar = f64;

    fn position(&self) -> spade::Point2<f64> {
        spade::Point2::new(self.x, self.y)
    }
}

/// Largest absolute coordinate of a vertex.
const MAX_COORDINATE_PX: f64 = 1e6;
/// Smaller absolute coordinates become 0: `spade` refuses very small values.
const MIN_COORDINATE_PX: f64 = 1e-12;

/// A Delaunay triangulation of surface points in the image.
///
/// Deterministic: ties of deviation go to the lower row, then column.
#[derive(Debug)]
pub struct ImageTriangulation {
    triangulation: DelaunayTriangulation<Node>,
    given: usize,
    added: Vec<ImageVertex>,
}

impl ImageTriangulation {
    /// Triangulates vertices.
    ///
    /// Vertices that are not finite, beyond 1e6 pixels or without positive inverse depth are ignored. Of several vertices at one pixel the
    /// first one counts.
    ///
    /// # Complexity
    /// Expected about `n log n`.
    pub fn new(vertices: &[ImageVertex]) -> Self {
        let nodes = (0..).zip(vertices);
        let nodes = nodes.filter_map(|(index, vertex)| node(vertex, index));
        Self {
            triangulation: DelaunayTriangulation::bulk_load_stable(nodes.collect())
                .expect("coordinates that were checked"),
            given: vertices.len(),
            added: Vec::new(),
        }
    }

    fn insert(&mut self, vertex: ImageVertex) -> Option<FixedVertexHandle> {
        let index = self.given + self.added.len();
        self.added.push(vertex);
        let node = node(&vertex, index as u32)?;
        self.triangulation.insert(node).ok()
    }

    /// Inserts samples until all deviations are within the bound, subject to the minimum distance; returns the inserted vertices.
    ///
    /// First, each grid square without a vertex gets the sample nearest to its centre. The options must be
    /// [valid](RefineOptions::validate).
    ///
    /// # Complexity
    /// Expected O(n log n) for n samples.
    pub fn refine(&mut self, samples: &SurfaceSamples, options: &RefineOptions) -> &[ImageVertex] {
        let before = self.added.len();
        self.fill_gaps(samples, options);
        let mut queue = BinaryHeap::new();
        for face in self.triangulation.inner_faces() {
            queue.extend(worst(&face, samples, options));
        }
        while let Some(candidate) = queue.pop() {
            // Triangles are replaced, never restored: equal corners identify the same triangle.
            if corners(&self.triangulation.face(candidate.face)) != candidate.corners {
                continue;
            }
            let Some(node) = self.insert_sample(samples, candidate.column, candidate.row) else {
                continue;
            };
            for edge in self.triangulation.vertex(node).out_edges() {
                if let Some(face) = edge.face().as_inner() {
                    queue.extend(worst(&face, samples, options));
                }
            }
        }
        &self.added[before..]
    }

    fn insert_sample(
        &mut self,
        samples: &SurfaceSamples,
        column: u32,
        row: u32,
    ) -> Option<FixedVertexHandle> {
        let (column, row) = (column as usize, row as usize);
        let rho = f64::from(samples.get(column, row)?.rho);
        self.insert(ImageVertex {
            pixel: samples.pixel(column, row),
            rho,
        })
    }

    /// Inserts a vertex into each grid square that has samples but no vertex.
    fn fill_gaps(&mut self, samples: &SurfaceSamples, options: &RefineOptions) {
        let step = samples.step_px().max(1);
        let side = (options.largest_gap_px / f64::from(step)).round().max(1.0) as usize;
        let (columns, rows) = (
            samples.columns().div_ceil(side),
            samples.rows().div_ceil(side),
        );
        let mut is_taken = vec![false; columns * rows];
        for vertex in self.triangulation.vertices() {
            let square = |along: f64| along / (f64::from(step) * side as f64);
            let (x, y) = (square(vertex.data().x), square(vertex.data().y));
            if x >= 0.0 && y >= 0.0 && x < columns as f64 && y < rows as f64 {
                is_taken[y as usize * columns + x as usize] = true;
            }
        }
        for row in 0..rows {
            for column in 0..columns {
                if is_taken[row * columns + column] {
                    continue;
                }
                let middle = |index: usize| index * side + side / 2;
                let away = |index: usize, middle: usize| index.abs_diff(middle).pow(2);
                let nearest = (row * side..((row + 1) * side).min(samples.rows()))
                    .flat_map(|y| {
                        (column * side..((column + 1) * side).min(samples.columns()))
                            .map(move |x| (x, y))
                    })
                    .filter(|(x, y)| samples.get(*x, *y).is_some())
                    .min_by_key(|(x, y)| away(*x, middle(column)) + away(*y, middle(row)));
                if let Some((x, y)) = nearest {
                    self.insert_sample(samples, x as u32, y as u32);
                }
            }
        }
    }

    /// The triangles with the deviations of their samples.
    pub fn triangles(&self, samples: &SurfaceSamples) -> impl Iterator<Item = ImageTriangle> {
        self.triangulation.inner_faces().map(move |face| {
            let mut triangle = ImageTriangle {
                corners: face.vertices().map(|vertex| vertex.data().vertex),
                samples: 0,
                deviation_sigmas: 0.0,
            };
            for_each_sample(&face, samples, |_, _, difference| {
                triangle.samples += 1;
                let deviation = difference.deviation(0.0);
                triangle.deviation_sigmas = triangle.deviation_sigmas.max(deviation);
            });
            triangle
        })
    }
}

type Face<'a> = FaceHandle<'a, InnerTag, Node, (), (), ()>;

/// A vertex as stored; `None` when it is ignored.
fn node(vertex: &ImageVertex, index: u32) -> Option<Node> {
    let coordinate = |value: f64| {
        if value.abs() < MIN_COORDINATE_PX {
            0.0
        } else {
            value
        }
    };
    let (x, y) = (coordinate(vertex.pixel.x), coordinate(vertex.pixel.y));
    let is_usable = x.abs() <= MAX_COORDINATE_PX
        && y.abs() <= MAX_COORDINATE_PX
        && vertex.rho > 0.0
        && vertex.rho.is_finite();
    is_usable.then_some(Node {
        x,
        y,
        rho: vertex.rho,
        vertex: index,
    })
}

/// The sample with the largest deviation from a triangle.
#[derive(Debug, Clone, Copy)]
struct WorstSample {
    deviation: f64,
    row: u32,
    column: u32,
    face: spade::handles::FixedFaceHandle<InnerTag>,
    corners: [usize; 3],
}

impl Ord for WorstSample {
    fn cmp(&self, other: &Self) -> Ordering {
        self.deviation
            .total_cmp(&other.deviation)
            .then((other.row, other.column).cmp(&(self.row, self.column)))
            .then(other.corners.cmp(&self.corners))
    }
}

impl PartialOrd for WorstSample {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for WorstSample {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for WorstSample {}

fn corners(face: &Face<'_>) -> [usize; 3] {
    let mut corners = face.vertices().map(|vertex| vertex.index());
    corners.sort_unstable();
    corners
}

/// The sample with the largest deviation that exceeds the bound and keeps the minimum distance from the corners.
fn worst(
    face: &Face<'_>,
    samples: &SurfaceSamples,
    options: &RefineOptions,
) -> Option<WorstSample> {
    let nodes = face.vertices().map(|vertex| *vertex.data());
    let nearest = options.minimum_distance_px * options.minimum_distance_px;
    let mut worst: Option<(f64, usize, usize)> = None;
    let relative_error = options.relative_error / options.bound_sigmas;
    for_each_sample(face, samples, |column, row, difference| {
        let least = worst.map_or(options.bound_sigmas, |(largest, ..)| largest);
        // Most samples are well within the bound, which costs no root.
        if difference.is_within(least, relative_error) {
            return;
        }
        let deviation = difference.deviation(relative_error);
        if deviation <= least {
            return;
        }
        let pixel = samples.pixel(column, row);
        let is_free = nodes
            .iter()
            .all(|node| (node.x - pixel.x).powi(2) + (node.y - pixel.y).powi(2) >= nearest);
        if is_free {
            worst = Some((deviation, column, row));
        }
    });
    worst.map(|(deviation, column, row)| WorstSample {
        deviation,
        row: row as u32,
        column: column as u32,
        face: face.fix(),
        corners: corners(face),
    })
}

/// A sample beside the triangle that it lies in.
#[derive(Debug, Clone, Copy)]
struct Difference {
    sample: SurfaceSample,
    /// Difference of the inverse depths.
    size: f64,
}

impl Difference {
    /// Whether it is certainly less than `bound` standard deviations.
    #[inline]
    fn is_within(&self, bound: f64, relative_error: f64) -> bool {
        /// More than all roundings on either side.
        const SLACK: f64 = 1.0 - 1e-9;
        let noise = f64::from(self.sample.sigma);
        let error = relative_error * f64::from(self.sample.rho);
        self.size * self.size < SLACK * bound * bound * (noise * noise + error * error)
    }

    /// In standard deviations.
    fn deviation(&self, relative_error: f64) -> f64 {
        let error = relative_error * f64::from(self.sample.rho);
        self.size / f64::from(self.sample.sigma).hypot(error)
    }
}

/// Calls `visit` with column, row and difference of each sample in a triangle, borders included, in order of rows.
fn for_each_sample(
    face: &Face<'_>,
    samples: &SurfaceSamples,
    mut visit: impl FnMut(usize, usize, Difference),
) {
    let [a, b, c] = face.vertices().map(|vertex| *vertex.data());
    let (bx, by, cx, cy) = (b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y);
    let area = bx * cy - by * cx;
    let step = f64::from(samples.step_px());
    // An area that is not a number is no area either.
    if area.is_nan() || area <= 0.0 || step == 0.0 {
        return;
    }
    // Inverse depth over the triangle: a.rho + (slope, offset from a).
    let (br, cr) = (b.rho - a.rho, c.rho - a.rho);
    let slope_x = (br * cy - cr * by) / area;
    let slope_y = (cr * bx - br * cx) / area;
    let first = samples.pixel(0, 0);
    let rows = grid_range(
        a.y.min(b.y).min(c.y) - first.y,
        a.y.max(b.y).max(c.y) - first.y,
        step,
        samples.rows(),
    );
    for row in rows {
        let y = samples.pixel(0, row).y;
        // Where the row runs inside the triangle: left of all three edges.
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            let (dx, dy) = (to.x - from.x, to.y - from.y);
            // dx (y - from.y) - dy (x - from.x) >= 0
            let across = dx * (y - from.y);
            if dy > 0.0 {
                high = high.min(from.x + across / dy);
            } else if dy < 0.0 {
                low = low.max(from.x + across / dy);
            } else if across < 0.0 {
                high = f64::NEG_INFINITY;
            }
        }
        for column in grid_range(low - first.x, high - first.x, step, samples.columns()) {
            let Some(sample) = samples.get(column, row) else {
                continue;
            };
            let x = samples.pixel(column, row).x;
            let rho = a.rho + slope_x * (x - a.x) + slope_y * (y - a.y);
            let size = (f64::from(sample.rho) - rho).abs();
            visit(column, row, Difference { sample, size });
        }
    }
}

/// Indices of the grid lines from `low` to `high`.
fn grid_range(low: f64, high: f64, step: f64, count: usize) -> std::ops::Range<usize> {
    let start = (low / step).ceil().max(0.0);
    let end = ((high / step).floor() + 1.0).min(count as f64);
    if start < end {
        start as usize..end as usize
    } else {
        0..0
    }
}

#[cfg(test)]
mod tests;
