//! A mesh whose vertices have distinct positions, with what lies across each edge.

use linecarve_mesh::{TriangleMesh, for_each_edge};
use nalgebra::{Point3, Vector3};

/// Triangles between distinct positions.
pub(crate) struct Surface {
    pub(crate) positions: Vec<Point3<f64>>,
    pub(crate) colors: Option<Vec<[u8; 3]>>,
    pub(crate) triangles: Vec<[u32; 3]>,
    /// For each triangle the triangle across the edge from corner `k` to the next; `None` at boundaries, where more than two triangles
    /// meet, and where the two have opposite orientations.
    pub(crate) across: Vec<[Option<u32>; 3]>,
    /// Unit normals.
    pub(crate) normals: Vec<Vector3<f64>>,
    pub(crate) areas: Vec<f64>,
    /// Median length of edges.
    pub(crate) edge_length: f64,
    starts: Vec<u32>,
    at_vertex: Vec<u32>,
}

impl Surface {
    /// Joins vertices at equal positions and leaves out triangles without an area.
    ///
    /// # Complexity
    /// O(n log n).
    pub(crate) fn new(mesh: &TriangleMesh) -> Self {
        let at = |vertex: u32| mesh.positions[vertex as usize].coords.map(|it| it + 0.0);
        let compare = |a: &u32, b: &u32| {
            let (a, b) = (at(*a), at(*b));
            let by_axis = [0, 1, 2].map(|axis| a[axis].total_cmp(&b[axis]));
            by_axis[0].then(by_axis[1]).then(by_axis[2])
        };
        let mut order: Vec<u32> = (0..mesh.positions.len() as u32).collect();
        order.sort_by(compare);
        let mut of_vertex = vec![0_u32; order.len()];
        let mut positions = Vec::new();
        let mut colors = mesh.colors.as_ref().map(|_| Vec::new());
        for group in order.chunk_by(|a, b| compare(a, b).is_eq()) {
            group
                .iter()
                .for_each(|vertex| of_vertex[*vertex as usize] = positions.len() as u32);
            positions.push(Point3::from(at(group[0])));
            if let (Some(colors), Some(all)) = (&mut colors, &mesh.colors) {
                colors.push(all[group[0] as usize]);
            }
        }
        let triangles = mesh.triangles.iter();
        let triangles = triangles.map(|triangle| triangle.map(|corner| of_vertex[corner as usize]));
        let triangles = triangles.filter(|[a, b, c]| a != b && b != c && c != a);
        Self::of(positions, colors, triangles.collect())
    }

    fn of(
        positions: Vec<Point3<f64>>,
        colors: Option<Vec<[u8; 3]>>,
        mut triangles: Vec<[u32; 3]>,
    ) -> Self {
        let scaled = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
            (b - a).cross(&(c - a))
        };
        triangles.retain(|triangle| scaled(triangle).norm() > 0.0);
        let areas = triangles.iter().map(|it| 0.5 * scaled(it).norm()).collect();
        let normals = triangles.iter().map(|it| scaled(it).normalize()).collect();
        let mut across = vec![[None; 3]; triangles.len()];
        let mut lengths = Vec::new();
        for_each_edge(&triangles, positions.len(), |[a, b], uses| {
            lengths.push((positions[b as usize] - positions[a as usize]).norm());
            let from = |corner: u32| triangles[corner as usize / 3][corner as usize % 3];
            if let [one, other] = *uses
                && from(one) != from(other)
            {
                across[one as usize / 3][one as usize % 3] = Some(other / 3);
                across[other as usize / 3][other as usize % 3] = Some(one / 3);
            }
        });
        let edge_length =
            linecarve_lines::upper_median(&mut lengths, f64::total_cmp).unwrap_or(0.0);
        let mut starts = vec![0_u32; positions.len() + 1];
        for corner in triangles.iter().flatten() {
            starts[*corner as usize + 1] += 1;
        }
        for vertex in 0..positions.len() {
            starts[vertex + 1] += starts[vertex];
        }
        let mut next = starts.clone();
        let mut at_vertex = vec![0; 3 * triangles.len()];
        for (triangle, corners) in (0..).zip(&triangles) {
            for corner in corners {
                at_vertex[next[*corner as usize] as usize] = triangle;
                next[*corner as usize] += 1;
            }
        }
        Self {
            positions,
            colors,
            triangles,
            across,
            normals,
            areas,
            edge_length,
            starts,
            at_vertex,
        }
    }

    /// The triangles at a vertex, ascending.
    pub(crate) fn triangles_at(&self, vertex: u32) -> &[u32] {
        let [start, end] = [0, 1].map(|next| self.starts[vertex as usize + next] as usize);
        &self.at_vertex[start..end]
    }

    /// The positions of a triangle's corners.
    pub(crate) fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|corner| self.positions[corner as usize])
    }

    /// The triangles across the edges of one.
    pub(crate) fn neighbours(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        self.across[triangle as usize].iter().flatten().copied()
    }
}
