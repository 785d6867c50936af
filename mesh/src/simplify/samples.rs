//! Points of the original surface, and which triangle stands for each of them.

use nalgebra::{Point3, Vector3};

use super::live::{doubled_area, height};

/// A point of the original surface.
pub(super) struct Sample {
    pub(super) point: Point3<f64>,
    /// The side on which the surface is seen there, of no particular length; zero where it means nothing: at vertices, and in
    /// triangles thinner than the tolerance.
    pub(super) facing: Vector3<f64>,
}

/// The samples, and those that each triangle stands for.
pub(super) struct Samples {
    pub(super) all: Vec<Sample>,
    pub(super) of_triangle: Vec<Vec<u32>>,
    /// The triangle that stands for each.
    pub(super) owner: Vec<u32>,
    /// The last sample of each triangle of the original, which lies inside it.
    pub(super) inside: Vec<u32>,
}

/// A triangle is parted so many times along each side at most.
const MOST_PARTS: usize = 12;

/// So many parts of a triangle's sides that they are no longer than `step`.
pub(super) fn parts(corners: &[Point3<f64>; 3], step: f64, most: usize) -> usize {
    let [a, b, c] = corners;
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    ((longest / step).ceil() as usize).clamp(1, most)
}

/// The middles of the triangles into which a triangle falls when each side is cut into equal parts, as weights of its
/// corners.
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
    /// Every vertex, and points of every triangle no farther apart than about `step`.
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
            for weights in middles(parts(&corners, step, MOST_PARTS)) {
                add(blend(&corners, weights), facing);
            }
            samples.inside.push(samples.all.len() as u32 - 1);
        }
        samples
    }
}
