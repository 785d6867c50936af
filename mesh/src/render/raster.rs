//! First hits of all samples of a picture, triangle by triangle.
//!
//! A triangle is seen by a sample where the three edge functions of the sample's ray have one sign. The function of an edge is a scalar
//! product of the ray with the cross product of the edge's corners, seen from the camera; the neighbour across the edge has the very
//! same numbers with the opposite sign, so that no ray slips through between them. Samples are few and near each other, which
//! costs a fraction of a search of each ray.
//!
//! # Reference
//! M. Olano, T. Greer, *Triangle Scan Conversion using 2D Homogeneous Coordinates*, Graphics Hardware 1997. *Differs from the paper*: the
//! functions are evaluated for each sample, not summed up.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::options::BackFaces;
use super::view::View;

/// Rows of samples that are drawn together.
const BAND: usize = 16;
/// Corners nearer than this share of the largest coordinate of their triangle are taken to be at the plane of the camera.
const NEAREST: f64 = 1e-6;

/// What a sample sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    /// Depth z in the camera frame.
    pub(super) depth: f64,
    pub(super) triangle: u32,
    pub(super) is_front_face: bool,
}

/// A triangle prepared for drawing.
struct Drawn {
    triangle: u32,
    is_front_face: bool,
    /// For each corner the edge function of the edge opposite to it: its value is the scalar product with a ray.
    edges: [Vector3<f64>; 3],
    depths: [f64; 3],
    /// First and last column and row of samples that may see it.
    columns: [u32; 2],
    rows: [u32; 2],
}

/// Positions of the samples of a picture as rays of depth 1.
struct SampleGrid {
    width: usize,
    height: usize,
    /// First coordinate of the rays of each column, second of each row.
    x: Vec<f64>,
    y: Vec<f64>,
}

impl SampleGrid {
    fn new(view: &View, supersampling: usize) -> Self {
        let camera = &view.camera;
        let position = |index: usize| (index as f64 + 0.5) / supersampling as f64 - 0.5;
        let (width, height) = (
            view.width as usize * supersampling,
            view.height as usize * supersampling,
        );
        let x = |column: usize| (position(column) - camera.cx()) / camera.fx();
        let y = |row: usize| (position(row) - camera.cy()) / camera.fy();
        Self {
            width,
            height,
            x: (0..width).map(x).collect(),
            y: (0..height).map(y).collect(),
        }
    }
}

/// What each sample sees first of a mesh, row by row, as `keep` has it; triangles with an index or a coordinate that is not valid are left
/// out. Parallel over rows; `row_done` is called after each.
pub(super) fn first_hits<T: Copy + Send>(
    (positions, triangles): (&[Point3<f64>], &[[u32; 3]]),
    (view, supersampling): (&View, usize),
    back_faces: BackFaces,
    keep: impl Fn(&Seen) -> T + Sync,
    row_done: &(dyn Fn() + Sync),
) -> Vec<Option<T>> {
    let grid = SampleGrid::new(view, supersampling);
    let camera_from_world = view.world_from_camera.inverse();
    let corners: Vec<Vector3<f64>> = positions
        .iter()
        .map(|position| (camera_from_world * position).coords)
        .collect();
    let drawn: Vec<Drawn> = (0..triangles.len() as u32)
        .into_par_iter()
        .filter_map(|triangle| {
            let indices = triangles[triangle as usize];
            let [Some(a), Some(b), Some(c)] = indices.map(|index| corners.get(index as usize))
            else {
                return None;
            };
            Drawn::new(triangle, [a, b, c], &grid, back_faces)
        })
        .collect();
    let bands = grid.height.div_ceil(BAND);
    let mut of_band: Vec<Vec<u32>> = vec![Vec::new(); bands];
    for (index, triangle) in (0..).zip(&drawn) {
        let [first, last] = triangle.rows.map(|row| row as usize / BAND);
        for band in &mut of_band[first..=last] {
            band.push(index);
        }
    }
    let mut kept = vec![None; grid.width * grid.height];
    kept.par_chunks_mut((BAND * grid.width).max(1))
        .zip(of_band)
        .enumerate()
        .for_each(|(band, (kept, inside))| {
            let mut samples = vec![None; kept.len()];
            for triangle in inside {
                drawn[triangle as usize].draw(&grid, band * BAND, &mut samples);
            }
            for (kept, seen) in kept.iter_mut().zip(&samples) {
                *kept = seen.as_ref().map(&keep);
            }
            for _ in samples.chunks(grid.width) {
                row_done();
            }
        });
    kept
}

impl Drawn {
    /// `None` for a triangle that no sample sees.
    fn new(
        triangle: u32,
        [a, b, c]: [&Vector3<f64>; 3],
        grid: &SampleGrid,
        back_faces: BackFaces,
    ) -> Option<Self> {
        let edges = [c.cross(b), a.cross(c), b.cross(a)];
        // The camera is on the side of the front where the volume that it spans with the triangle is positive.
        let volume = a.dot(&edges[0]);
        if !volume.is_finite() || volume == 0.0 {
            return None;
        }
        if back_faces == BackFaces::Hidden && volume < 0.0 {
            return None;
        }
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        let mut extend = |point: &Vector3<f64>| {
            for axis in 0..2 {
                let along = point[axis] / point.z;
                low[axis] = low[axis].min(along);
                high[axis] = high[axis].max(along);
            }
        };
        let nearest = NEAREST * a.amax().max(b.amax()).max(c.amax());
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if from.z >= nearest {
                extend(from);
            }
            if (from.z >= nearest) != (to.z >= nearest) {
                let share = (nearest - from.z) / (to.z - from.z);
                let mut cut = from + (to - from) * share;
                cut.z = nearest;
                extend(&cut);
            }
        }
        let columns = within(&grid.x, low[0], high[0])?;
        let rows = within(&grid.y, low[1], high[1])?;
        Some(Self {
            triangle,
            is_front_face: volume > 0.0,
            edges,
            depths: [a.z, b.z, c.z],
            columns,
            rows,
        })
    }

    /// Draws the part in the rows of a band, of which `first` is the first. What is nearer stays; of equally near triangles the first.
    fn draw(&self, grid: &SampleGrid, first: usize, samples: &mut [Option<Seen>]) {
        let [u, v, w] = &self.edges;
        let rows =
            (self.rows[0] as usize).max(first)..=(self.rows[1] as usize).min(first + BAND - 1);
        let columns = self.columns[0] as usize..=self.columns[1] as usize;
        for row in rows {
            let y = grid.y[row];
            let rest = [u, v, w].map(|edge| edge.y * y + edge.z);
            let begin = (row - first) * grid.width;
            let line = &mut samples[begin + columns.start()..=begin + columns.end()];
            for (x, sample) in grid.x[columns.clone()].iter().zip(line) {
                let (u, v, w) = (u.x * x + rest[0], v.x * x + rest[1], w.x * x + rest[2]);
                let is_outside = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
                if is_outside {
                    continue;
                }
                let area = u + v + w;
                if area == 0.0 {
                    continue;
                }
                let depth = (u * self.depths[0] + v * self.depths[1] + w * self.depths[2]) / area;
                if depth >= 0.0 && sample.is_none_or(|other: Seen| depth < other.depth) {
                    *sample = Some(Seen {
                        depth,
                        triangle: self.triangle,
                        is_front_face: self.is_front_face,
                    });
                }
            }
        }
    }
}

/// First and last index of the increasing positions between two bounds, or one before and behind, as bounds are rounded.
fn within(positions: &[f64], low: f64, high: f64) -> Option<[u32; 2]> {
    let first = positions.partition_point(|position| *position < low);
    let end = positions.partition_point(|position| *position <= high);
    let (first, end) = (first.saturating_sub(1), (end + 1).min(positions.len()));
    let is_beside = low > high || positions.is_empty();
    (!is_beside && first < end).then(|| [first as u32, end as u32 - 1])
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::TriangleMesh;
    use crate::raycast::RayScene;

    /// Triangles around and behind the camera, also such that reach past it, and a closed box around all.
    fn scene() -> TriangleMesh {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut mesh = TriangleMesh::default();
        for index in 0..400 {
            let mut draw = |bound: f64| Vector3::from_fn(|_, _| random.random_range(-bound..bound));
            let center = Point3::from(draw(3.0));
            let size = if index % 50 == 0 { 4.0 } else { 0.3 };
            for _ in 0..3 {
                mesh.positions.push(center + draw(size));
            }
            let first = mesh.positions.len() as u32 - 3;
            mesh.triangles.push([first, first + 1, first + 2]);
        }
        let first = mesh.positions.len() as u32;
        for corner in 0..8 {
            let side = |axis: u32| if corner >> axis & 1 == 0 { -9.0 } else { 9.0 };
            mesh.positions.push(Point3::new(side(0), side(1), side(2)));
        }
        // For each side two triangles that face inside.
        for [a, b, c, d] in [
            [0, 1, 3, 2],
            [4, 6, 7, 5],
            [0, 4, 5, 1],
            [2, 3, 7, 6],
            [0, 2, 6, 4],
            [1, 5, 7, 3],
        ] {
            mesh.triangles.push([a, b, c].map(|corner| first + corner));
            mesh.triangles.push([a, c, d].map(|corner| first + corner));
        }
        // Without area, and with an index that is not valid.
        mesh.triangles.push([0, 0, 1]);
        mesh.triangles.push([0, 1, 1 << 20]);
        mesh
    }

    #[test]
    fn samples_see_what_rays_hit() {
        let mesh = scene();
        let rays = RayScene::new(&mesh);
        let world_from_camera =
            Isometry3::new(Vector3::new(0.2, -0.1, 0.3), Vector3::new(0.4, 1.0, -0.3));
        let camera = linecarve_lines::camera::Camera::pinhole(50.0, 55.0, 40.3, 29.1).unwrap();
        let view = View::from_keyframe(&camera, 80, 60, world_from_camera, Vector3::z());
        let origin = Point3::from(world_from_camera.translation.vector);
        for back_faces in [BackFaces::Tinted, BackFaces::Hidden] {
            let mesh = (mesh.positions.as_slice(), mesh.triangles.as_slice());
            let hits = first_hits(mesh, (&view, 2), back_faces, |seen| *seen, &|| {});
            let grid = SampleGrid::new(&view, 2);
            let mut triangles = std::collections::BTreeSet::new();
            for (index, hit) in hits.iter().enumerate() {
                let (x, y) = (grid.x[index % 160], grid.y[index / 160]);
                let direction = world_from_camera.rotation * Vector3::new(x, y, 1.0);
                let is_drawn = |_, front| front || back_faces != BackFaces::Hidden;
                let expected = rays.cast_where(&origin, &direction, f64::MAX, is_drawn);
                let (hit, expected) = (hit.expect("the box is closed"), expected.unwrap());
                assert_eq!(hit.triangle, expected.triangle, "{index}");
                assert_eq!(hit.is_front_face, expected.is_front_face);
                assert!((hit.depth - expected.distance).abs() < 1e-9 * expected.distance);
                triangles.insert(hit.triangle);
            }
            assert!(triangles.len() > 20, "{}", triangles.len());
        }
    }

    #[test]
    fn nothing_is_seen_of_an_empty_mesh() {
        let up = Vector3::y();
        let view = View::look_at(
            &Point3::origin(),
            &Point3::new(0.0, 0.0, 1.0),
            &up,
            (4, 3),
            1.0,
        );
        let hits = first_hits(
            (&[], &[]),
            (&view.unwrap(), 1),
            BackFaces::Tinted,
            |seen| *seen,
            &|| {},
        );
        assert_eq!(hits, [None; 12]);
    }
}
