//! Samples of the original surface, and the triangle that represents each.

use nalgebra::{Point3, Vector3};

use super::live::{doubled_area, height};

/// A sample of the original surface.
pub(super) struct Sample {
    pub(super) point: Point3<f64>,
    /// Normal of the surface, unnormalised; zero at vertices and in triangles thinner than the tolerance, where
    /// it is undefined.
    pub(super) facing: Vector3<f64>,
}

/// All samples, and the samples represented by each triangle.
pub(super) struct Samples {
    pub(super) all: Vec<Sample>,
    pub(super) of_triangle: Vec<Vec<u32>>,
    /// The triangle that represents each sample.
    pub(super) owner: Vec<u32>,
    /// The last sample of each original triangle; it lies inside the triangle.
    pub(super) inside: Vec<u32>,
}

/// Maximum subdivisions per triangle edge.
const MAX_PARTS: usize = 12;

/// Number of subdivisions per edge so that no part exceeds `step`.
pub(super) fn parts(corners: &[Point3<f64>; 3], step: f64, most: usize) -> usize {
    let [a, b, c] = corners;
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    ((longest / step).ceil() as usize).clamp(1, most)
}

/// Barycentric coordinates of the centroids of all sub-triangles when each edge is cut into equal parts.
pub(super) fn middles(parts: usize) -> impl Iterator<Item = [f64; 3]> {
    let n = parts as f64;
    (0..parts).flat_map(move |i| {
        (0..2 * (parts - i) - 1).map(move |j| {
            let (whole, third) = ((j / 2) as f64, if j % 2 == 0 { 1.0 } else { 2.0 });
            let (u, v) = ((i as f64 + third / 3.0) / n, (whole + third / 3.0) / n);
            [1.0 - u - v, u, v]
        })
    })
}

pub(super) fn blend([a, b, c]: &[Point3<f64>; 3], [u, v, w]: [f64; 3]) -> Point3<f64> {
    Point3::from(a.coords * u + b.coords * v + c.coords * w)
}

impl Samples {
    /// All vertices, and samples inside every triangle at a spacing of about `step`.
    pub(super) fn new(
        positions: &[Point3<f64>],
        triangles: &[[u32; 3]],
        step: f64,
        tolerance: f64,
    ) -> Self {
        let mut samples = Self {
            all: Vec::new(),
            of_triangle: vec![Vec::new(); triangles.len()],
            owner: Vec::new(),
            inside: Vec::with_capacity(triangles.len()),
        };
        let mut is_taken = vec![false; positions.len()];
        for (triangle, corners) in triangles.iter().enumerate() {
            let list = &mut samples.of_triangle[triangle];
            let mut add = |point, facing| {
                list.push(samples.all.len() as u32);
                samples.owner.push(triangle as u32);
                samples.all.push(Sample { point, facing });
            };
            for &corner in corners {
                if !std::mem::replace(&mut is_taken[corner as usize], true) {
                    add(positions[corner as usize], Vector3::zeros());
                }
            }
            let corners = corners.map(|corner| positions[corner as usize]);
            let facing = if height(&corners) > tolerance {
                doubled_area(&corners).normalize()
            } else {
                Vector3::zeros()
            };
            for weights in middles(parts(&corners, step, MAX_PARTS)) {
                add(blend(&corners, weights), facing);
            }
            samples.inside.push(samples.all.len() as u32 - 1);
        }
        samples
    }
}
