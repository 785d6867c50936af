//! Where a surface is flat.

use nalgebra::Vector3;

use crate::TriangleMesh;

/// At a vertex of a flat surface, least length of the sum of the normals of its triangles, weighted by area, over the sum of the weights. Two flat
/// halves that meet at an angle of 36 degrees have as much.
const LEAST_FLAT: f64 = 0.95;

/// Whether the surface is flat around each vertex; not on creases and corners.
///
/// # Complexity
/// Linear in vertices and triangles.
pub fn flat_vertices(mesh: &TriangleMesh) -> Vec<bool> {
    let mut sums = vec![(Vector3::zeros(), 0.0); mesh.positions.len()];
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.map(|corner| mesh.positions[corner as usize]);
        let normal = (b - a).cross(&(c - a));
        for corner in triangle {
            let (sum, lengths) = &mut sums[*corner as usize];
            *sum += normal;
            *lengths += normal.norm();
        }
    }
    let is_flat = |(sum, lengths): &(Vector3<f64>, f64)| sum.norm() > LEAST_FLAT * lengths;
    sums.iter().map(is_flat).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;

    #[test]
    fn vertices_on_a_crease_are_not_flat() {
        // Two squares of 2 x 1 cells that meet along y at x = 1, the second one at an angle.
        for (angle_deg, is_flat) in [(0.0_f64, true), (30.0, true), (45.0, false), (90.0, false)] {
            let (sin, cos) = angle_deg.to_radians().sin_cos();
            let mut mesh = TriangleMesh::default();
            for y in 0..3 {
                let y = f64::from(y);
                let rows = [[0.0, 0.0], [1.0, 0.0], [1.0 + cos, sin]];
                mesh.positions
                    .extend(rows.map(|[x, z]| Point3::new(x, y, z)));
            }
            for corner in [0, 1, 3, 4] {
                mesh.triangles.push([corner, corner + 1, corner + 4]);
                mesh.triangles.push([corner, corner + 4, corner + 3]);
            }
            let flat = flat_vertices(&mesh);
            assert_eq!(flat[4], is_flat, "{angle_deg}");
            assert!(flat[0] && flat[8]);
        }
    }
}
