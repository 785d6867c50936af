//! Sampling of surfaces, lines and clouds.

use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::Shape;

/// Area of a shape's triangles.
pub fn surface_area(shape: &Shape) -> f64 {
    shape.triangles.iter().map(|t| area(shape, t)).sum()
}

/// Area of a triangle of a shape.
pub(crate) fn area(shape: &Shape, triangle: &[u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|corner| shape.positions[corner as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// Samples on the triangles of a shape, uniform by area, each with its triangle; none when the area is 0.
///
/// Stratified sampling: the area is divided into `count` equal parts with one sample each, which gives a lower
/// variance than independent samples at the same expectation. Samples are ordered by triangle.
pub fn sample_surface(shape: &Shape, count: usize, seed: u64) -> Vec<(Point3<f64>, u32)> {
    let total = surface_area(shape);
    if !(total > 0.0 && total.is_finite()) || count == 0 {
        return Vec::new();
    }
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut samples = Vec::with_capacity(count);
    let part = total / count as f64;
    let draw =
        move |drawn: usize, random: &mut ChaCha8Rng| part * (drawn as f64 + random.random::<f64>());
    let mut next = draw(0, &mut random);
    let mut covered = 0.0;
    let mut last_with_area = None;
    for (index, triangle) in shape.triangles.iter().enumerate() {
        let area = area(shape, triangle);
        if area <= 0.0 {
            continue;
        }
        last_with_area = Some(index as u32);
        covered += area;
        while samples.len() < count && next < covered {
            samples.push((in_triangle(shape, triangle, &mut random), index as u32));
            next = draw(samples.len(), &mut random);
        }
    }
    // Rounding of the running sum may leave the last part without a sample.
    while let (true, Some(triangle)) = (samples.len() < count, last_with_area) {
        let corners = shape.triangles[triangle as usize];
        samples.push((in_triangle(shape, &corners, &mut random), triangle));
    }
    samples
}

fn in_triangle(shape: &Shape, triangle: &[u32; 3], random: &mut ChaCha8Rng) -> Point3<f64> {
    let [a, b, c] = triangle.map(|corner| shape.positions[corner as usize]);
    let r = random.random::<f64>().sqrt();
    let s = random.random::<f64>();
    a + (b - a) * (r * (1.0 - s)) + (c - a) * (r * s)
}

/// Samples along the lines of a shape, both ends included, at most `step` apart.
pub fn sample_lines(shape: &Shape, step: f64) -> Vec<Point3<f64>> {
    /// Maximum number of parts per line.
    const MAX_PARTS: f64 = 1e6;
    let mut samples = Vec::new();
    for [a, b] in &shape.lines {
        let (a, b) = (shape.positions[*a as usize], shape.positions[*b as usize]);
        let parts = ((b - a).norm() / step).ceil().clamp(1.0, MAX_PARTS) as usize;
        samples.extend((0..=parts).map(|part| a + (b - a) * (part as f64 / parts as f64)));
    }
    samples
}

/// All points of a cloud, or a uniform random subset of `count`, in order.
pub fn sample_cloud(points: &[Point3<f64>], count: usize, seed: u64) -> Vec<Point3<f64>> {
    if points.len() <= count {
        return points.to_vec();
    }
    // Selection sampling gives every subset the same probability (Knuth, The Art of Computer Programming 2,
    // 3.4.2, algorithm S).
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut taken = Vec::with_capacity(count);
    for (index, point) in points.iter().enumerate() {
        let left = (points.len() - index) as f64;
        if random.random::<f64>() * left < (count - taken.len()) as f64 {
            taken.push(*point);
        }
    }
    taken
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape() -> Shape {
        Shape {
            positions: [
                [0.0, 0.0, 0.0],
                [3.0, 0.0, 0.0],
                [0.0, 2.0, 0.0],
                [0.0, 0.0, 1.0],
            ]
            .map(Point3::from)
            .to_vec(),
            triangles: vec![[0, 1, 2], [0, 0, 1], [0, 2, 3]],
            lines: vec![[0, 1], [2, 2]],
            colors: None,
        }
    }

    #[test]
    fn samples_are_uniform_by_area() {
        let shape = shape();
        assert_eq!(surface_area(&shape), 4.0);
        let samples = sample_surface(&shape, 10_000, 1);
        assert_eq!(samples.len(), 10_000);
        let on_first = samples.iter().filter(|(_, t)| *t == 0).count();
        assert!((7499..=7501).contains(&on_first), "{on_first}");
        // The mean of uniform points is the centroid.
        let mean: nalgebra::Vector3<f64> = samples
            .iter()
            .filter(|(_, t)| *t == 0)
            .map(|(p, _)| p.coords)
            .sum::<nalgebra::Vector3<f64>>()
            / on_first as f64;
        assert!(
            (mean.x - 1.0).abs() < 0.03 && (mean.y - 2.0 / 3.0).abs() < 0.02,
            "{mean}"
        );
        assert!(
            samples
                .iter()
                .all(|(p, _)| p.x / 3.0 + p.y / 2.0 + p.z <= 1.0 + 1e-12)
        );
        assert_eq!(samples, sample_surface(&shape, 10_000, 1));
        assert_ne!(samples, sample_surface(&shape, 10_000, 2));
    }

    #[test]
    fn nothing_has_no_samples() {
        assert!(sample_surface(&Shape::default(), 10, 1).is_empty());
        let flat = Shape {
            triangles: vec![[0, 0, 1]],
            ..shape()
        };
        assert!(sample_surface(&flat, 10, 1).is_empty());
    }

    #[test]
    fn lines_are_sampled_with_their_ends() {
        let samples = sample_lines(&shape(), 0.8);
        // Four parts of 0.75, and a line without length, which gives its point twice.
        assert_eq!(samples.len(), 5 + 2);
        assert_eq!(samples[1].x, 0.75);
    }

    #[test]
    fn a_cloud_gives_each_point_at_most_once() {
        let points: Vec<_> = (0..1000)
            .map(|i| Point3::new(f64::from(i), 0.0, 0.0))
            .collect();
        assert_eq!(sample_cloud(&points, 5000, 1), points);
        let some = sample_cloud(&points, 100, 1);
        assert_eq!(some.len(), 100);
        assert!(some.is_sorted_by(|a, b| a.x < b.x));
        let mean = some.iter().map(|p| p.x).sum::<f64>() / 100.0;
        assert!((mean - 500.0).abs() < 100.0, "{mean}");
    }
}
