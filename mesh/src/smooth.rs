//! Smooths surfaces that are piecewise flat, and keeps their edges sharp.
//!
//! 1. **Normals**: each triangle's normal becomes the mean of those around it, weighted by area, by distance, and by how alike the normals
//!    are. Across an edge of the surface normals differ, and do not mix.
//! 2. **Vertices** move until their triangles have these normals, each within its own bound.
//!
//! # Reference
//! The weights of normals: Y. Zheng, H. Fu, O. K.-C. Au, C.-L. Tai, *Bilateral normal filtering for mesh denoising*, IEEE TVCG 2011, local
//! scheme. The vertices: X. Sun, P. Rosin, R. Martin, F. Langbein, *Fast and effective feature-preserving mesh denoising*, IEEE TVCG 2007.
//!
//! *Differs from the papers*: bounds, and vertices on the boundary stay.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::edge_uses::for_each_edge;

/// How a surface is smoothed.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct SmoothOptions {
    /// Standard deviation of the weight by normals: the length of their difference, 1 at 60 degrees.
    pub normal_sigma: f64,
    /// Rounds of averaging normals.
    pub normal_rounds: usize,
    /// Rounds of moving vertices.
    pub vertex_rounds: usize,
}

impl Default for SmoothOptions {
    /// More rounds change a surface from depth images by less than its noise. Each adds a triangle to how far a change reaches.
    fn default() -> Self {
        Self {
            normal_sigma: 0.25,
            normal_rounds: 2,
            vertex_rounds: 2,
        }
    }
}

impl SmoothOptions {
    /// How many triangles away a vertex may be and still have an influence on the position of another one.
    pub fn reach(&self) -> usize {
        self.normal_rounds + self.vertex_rounds + 1
    }
}

/// The positions of the vertices of a surface, or of a part of it, after smoothing; vertex `i` moves by at most `bounds[i]`. Vertices on the
/// boundary, those where more than two triangles meet at an edge, and those without a bound above 0 stay.
///
/// A position depends on the triangles within [`SmoothOptions::reach`] of its vertex alone: of a part that is cut out of a surface, vertices that
/// are further from the cut have the positions that they have in the whole, if the order of the triangles is the same.
///
/// # Complexity
/// Linear in the triangles, where few of them meet at a vertex.
///
/// # Panics
/// When there are not as many bounds as positions.
pub fn smooth_piecewise_flat(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    bounds: &[f64],
    options: &SmoothOptions,
) -> Vec<Point3<f64>> {
    assert_eq!(bounds.len(), positions.len(), "one bound a vertex");
    let surface = Surface::new(positions.to_vec(), triangles.to_vec());
    let limit = |bound: &f64| if *bound > 0.0 { *bound } else { 0.0 };
    let mut limits: Vec<f64> = bounds.iter().map(limit).collect();
    surface.hold_rims(&mut limits);
    let normals = surface.filtered_normals(options);
    surface.fitted(&normals, &limits, options.vertex_rounds)
}

/// Lists of numbers, one after the other.
struct Lists {
    starts: Vec<u32>,
    items: Vec<u32>,
}

impl Lists {
    fn new(lists: impl Iterator<Item = impl IntoIterator<Item = u32>>) -> Self {
        let (mut starts, mut items) = (vec![0], Vec::new());
        for list in lists {
            items.extend(list);
            starts.push(items.len() as u32);
        }
        Self { starts, items }
    }

    fn get(&self, index: usize) -> &[u32] {
        &self.items[self.starts[index] as usize..self.starts[index + 1] as usize]
    }
}

/// A mesh whose vertices have distinct positions.
struct Surface {
    positions: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// Triangles at each vertex, ascending.
    at_vertex: Lists,
    /// Triangles that share a vertex with each, ascending, without itself.
    around: Lists,
}

impl Surface {
    fn new(positions: Vec<Point3<f64>>, triangles: Vec<[u32; 3]>) -> Self {
        let mut uses: Vec<[u32; 2]> = (0..)
            .zip(&triangles)
            .flat_map(|(index, triangle)| triangle.map(|vertex| [vertex, index]))
            .collect();
        uses.sort_unstable();
        // A triangle may use a position twice.
        uses.dedup();
        let mut rest = uses.as_slice();
        let at_vertex = Lists::new((0..positions.len() as u32).map(|vertex| {
            let (own, others) = rest.split_at(rest.partition_point(|[at, _]| *at == vertex));
            rest = others;
            own.iter().map(|[_, triangle]| *triangle)
        }));
        let around = Lists::new((0..).zip(&triangles).map(|(index, triangle)| {
            let at = |vertex: &u32| at_vertex.get(*vertex as usize).iter().copied();
            let mut around: Vec<u32> = triangle.iter().flat_map(at).collect();
            around.sort_unstable();
            around.dedup();
            around.retain(|other| *other != index);
            around
        }));
        Self {
            positions,
            triangles,
            at_vertex,
            around,
        }
    }

    /// Sets the limits of vertices to 0 at edges that have not two triangles.
    fn hold_rims(&self, limits: &mut [f64]) {
        for_each_edge(&self.triangles, limits.len(), |ends, corners| {
            if corners.len() != 2 {
                ends.iter().for_each(|end| limits[*end as usize] = 0.0);
            }
        });
    }

    /// The centre of a triangle, and its normal with the length of twice its area.
    fn face(&self, index: usize) -> (Point3<f64>, Vector3<f64>) {
        let [a, b, c] = self.triangles[index].map(|vertex| self.positions[vertex as usize]);
        let center = (a.coords + b.coords + c.coords) / 3.0;
        (center.into(), (b - a).cross(&(c - a)))
    }

    /// Unit normals of the triangles; zero for those without an area.
    fn filtered_normals(&self, options: &SmoothOptions) -> Vec<Vector3<f64>> {
        let count = self.triangles.len();
        let (centers, scaled): (Vec<_>, Vec<_>) = (0..count).map(|index| self.face(index)).unzip();
        let areas: Vec<f64> = scaled.iter().map(Vector3::norm).collect();
        let squared =
            |index: usize, other: u32| (centers[index] - centers[other as usize]).norm_squared();
        // The mean distance of the triangles around each.
        let by_distance = |index: usize| {
            let around = self.around.get(index);
            let sum: f64 = around.iter().map(|it| squared(index, *it).sqrt()).sum();
            let mean = sum / around.len().max(1) as f64;
            0.5 / mean.powi(2).max(f64::MIN_POSITIVE)
        };
        let by_distance: Vec<f64> = (0..count).map(by_distance).collect();
        let by_normal = 0.5 / options.normal_sigma.powi(2);
        let mut normals: Vec<Vector3<f64>> = scaled.iter().map(unit).collect();
        for _ in 0..options.normal_rounds {
            normals = (0..count)
                .into_par_iter()
                .map(|index| {
                    let own = normals[index];
                    let around = self.around.get(index).iter();
                    let weighted = around.map(|&other| {
                        let normal = normals[other as usize];
                        let exponent = by_distance[index] * squared(index, other)
                            + by_normal * (normal - own).norm_squared();
                        areas[other as usize] * (-exponent).exp() * normal
                    });
                    unit(&(areas[index] * own + weighted.sum::<Vector3<f64>>()))
                })
                .collect();
        }
        normals
    }

    /// The positions where triangles have these normals, none further than its limit from where it is.
    fn fitted(&self, normals: &[Vector3<f64>], limits: &[f64], rounds: usize) -> Vec<Point3<f64>> {
        let mut fitted = self.positions.clone();
        for _ in 0..rounds {
            let centers: Vec<Vector3<f64>> = self
                .triangles
                .par_iter()
                .map(|corners| {
                    let corners = corners.map(|vertex| fitted[vertex as usize].coords);
                    corners.iter().sum::<Vector3<f64>>() / 3.0
                })
                .collect();
            fitted = (0..fitted.len())
                .into_par_iter()
                .map(|vertex| {
                    let (now, before) = (fitted[vertex], self.positions[vertex]);
                    let triangles = self.at_vertex.get(vertex);
                    if limits[vertex] == 0.0 || triangles.is_empty() {
                        return now;
                    }
                    let offsets = triangles.iter().map(|&triangle| {
                        let normal = normals[triangle as usize];
                        normal.dot(&(centers[triangle as usize] - now.coords)) * normal
                    });
                    let offset = offsets.sum::<Vector3<f64>>() / triangles.len() as f64;
                    let moved = now + offset - before;
                    let length = moved.norm();
                    match length <= limits[vertex] {
                        true => before + moved,
                        false if length.is_finite() => before + limits[vertex] / length * moved,
                        false => now,
                    }
                })
                .collect();
        }
        fitted
    }
}

/// The vector with length 1; zero when it has no direction.
fn unit(vector: &Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::TriangleMesh;

    const SIDE: usize = 21;

    /// A square grid, folded along its middle by a right angle, with noise of this size across it.
    fn fold(noise: f64) -> TriangleMesh {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut mesh = TriangleMesh::default();
        let middle = (SIDE / 2) as f64;
        for (x, y) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (x as f64, y as f64))) {
            let off = noise * (2.0 * random.random::<f64>() - 1.0);
            let position = match x <= middle {
                true => [x, y, off],
                false => [middle + off, y, x - middle],
            };
            mesh.positions.push(position.into());
        }
        let at = |x: usize, y: usize| (y * SIDE + x) as u32;
        for (x, y) in (0..SIDE - 1).flat_map(|y| (0..SIDE - 1).map(move |x| (x, y))) {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            mesh.triangles.extend([[a, b, c], [a, c, d]]);
        }
        mesh
    }

    fn smooth(mesh: &mut TriangleMesh, bounds: &[f64]) {
        let options = SmoothOptions::default();
        mesh.positions = smooth_piecewise_flat(&mesh.positions, &mesh.triangles, bounds, &options);
    }

    /// Mean distance of the inner vertices beside the fold to the two planes, and that of those on the fold to it.
    fn distances(mesh: &TriangleMesh) -> [f64; 2] {
        let middle = SIDE / 2;
        let inner = |at: &usize| *at > 0 && *at < SIDE - 1;
        let mean = |columns: &[usize], distance: fn(&Point3<f64>, f64) -> f64| {
            let cells = columns
                .iter()
                .flat_map(|x| (1..SIDE - 1).map(move |y| y * SIDE + x));
            let all: Vec<f64> = cells
                .map(|index| distance(&mesh.positions[index], middle as f64))
                .collect();
            all.iter().sum::<f64>() / all.len() as f64
        };
        let sides: Vec<usize> = (0..SIDE).filter(inner).filter(|x| *x != middle).collect();
        [
            mean(&sides, |at, middle| at.z.abs().min((at.x - middle).abs())),
            mean(&[middle], |at, middle| at.z.hypot(at.x - middle)),
        ]
    }

    #[test]
    fn planes_become_flat_and_the_edge_between_them_stays_sharp() {
        let mut mesh = fold(0.1);
        let before = distances(&mesh);
        let bounds = vec![0.2; mesh.positions.len()];
        smooth(&mut mesh, &bounds);
        let after = distances(&mesh);
        assert!(after[0] < 0.4 * before[0], "{before:?} {after:?}");
        assert!(after[1] < before[1], "{before:?} {after:?}");
    }

    #[test]
    fn exact_planes_stay() {
        let (mut mesh, before) = (fold(0.0), fold(0.0));
        let bounds = vec![1.0; mesh.positions.len()];
        smooth(&mut mesh, &bounds);
        for (now, before) in mesh.positions.iter().zip(&before.positions) {
            assert!((now - before).norm() < 1e-3, "{before} {now}");
        }
    }

    #[test]
    fn bounds_hold_and_rims_stay() {
        let (mut mesh, before) = (fold(0.3), fold(0.3));
        let mut bounds = vec![0.02; mesh.positions.len()];
        bounds[10 * SIDE + 5] = 0.0;
        bounds[10 * SIDE + 6] = f64::NAN;
        smooth(&mut mesh, &bounds);
        let moved = |index: usize| (mesh.positions[index] - before.positions[index]).norm();
        assert!((0..mesh.positions.len()).all(|index| moved(index) <= 0.02 + 1e-12));
        assert!((0..SIDE).all(|x| moved(x) == 0.0));
        assert_eq!([moved(10 * SIDE + 5), moved(10 * SIDE + 6)], [0.0; 2]);
        assert!(moved(10 * SIDE + 7) > 0.0);
    }

    #[test]
    fn degenerate_meshes() {
        let mut empty = TriangleMesh::default();
        smooth(&mut empty, &[]);
        let mut mesh = fold(0.1);
        mesh.positions[10 * SIDE + 5].x = f64::NAN;
        mesh.triangles.push([3, 3, 4]);
        let bounds = vec![0.2; mesh.positions.len()];
        smooth(&mut mesh, &bounds);
        let far = mesh.positions[18 * SIDE + 18];
        assert!(far.coords.iter().all(|value| value.is_finite()));
    }
}
