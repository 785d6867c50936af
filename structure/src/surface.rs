//! A mesh with one vertex at each position, and what lies across each edge.

use linecarve_mesh::{TriangleMesh, for_each_edge};
use nalgebra::{Point3, Vector3};

/// Distinct values, ascending.
pub(crate) fn unique<T: Ord>(values: impl IntoIterator<Item = T>) -> Vec<T> {
    let mut values: Vec<T> = values.into_iter().collect();
    values.sort_unstable();
    values.dedup();
    values
}

/// The place of a value among distinct ascending ones.
pub(crate) fn rank(values: &[u32], value: &u32) -> u32 {
    values.binary_search(value).unwrap_or(0) as u32
}

/// Triangles and their neighbours.
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
    /// Joins vertices at equal positions, and leaves out triangles without an area.
    ///
    /// # Complexity
    /// O(n log n).
    pub(crate) fn new(mesh: &TriangleMesh) -> Self {
        let (of_vertex, positions, colors) = joined(mesh);
        let (mut given, mut triangles, mut normals, mut areas) = (vec![], vec![], vec![], vec![]);
        for original in &mesh.triangles {
            let triangle = original.map(|corner| of_vertex[corner as usize]);
            let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
            let scaled: Vector3<f64> = (b - a).cross(&(c - a));
            if let Some(normal) = scaled.try_normalize(0.0) {
                given.push(*original);
                triangles.push(triangle);
                normals.push(normal);
                areas.push(0.5 * scaled.norm());
            }
        }
        let mut across = vec![[None; 3]; triangles.len()];
        let mut lengths = Vec::new();
        for_each_edge(&triangles, positions.len(), |[a, b], uses| {
            lengths.push((positions[b as usize] - positions[a as usize]).norm());
            for [one, other] in pairs(uses, &triangles, &given) {
                across[one as usize / 3][one as usize % 3] = Some(other / 3);
                across[other as usize / 3][other as usize % 3] = Some(one / 3);
            }
        });
        let edge_length =
            linecarve_lines::upper_median(&mut lengths, f64::total_cmp).unwrap_or(0.0);
        let (starts, at_vertex) = uses_of_vertices(&triangles, positions.len());
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

    /// Distinct corners of triangles, ascending.
    pub(crate) fn vertices_of(&self, triangles: &[u32]) -> Vec<u32> {
        unique(triangles.iter().flat_map(|it| self.triangles[*it as usize]))
    }

    /// The triangles across the edges of one.
    pub(crate) fn neighbours(&self, triangle: u32) -> impl Iterator<Item = u32> + '_ {
        self.across[triangle as usize].iter().flatten().copied()
    }
}

/// For each vertex the number of its position, and the distinct positions with their colours.
type Joined = (Vec<u32>, Vec<Point3<f64>>, Option<Vec<[u8; 3]>>);

fn joined(mesh: &TriangleMesh) -> Joined {
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
        let number = positions.len() as u32;
        group.iter().for_each(|it| of_vertex[*it as usize] = number);
        positions.push(Point3::from(at(group[0])));
        if let (Some(colors), Some(all)) = (&mut colors, &mesh.colors) {
            colors.push(all[group[0] as usize]);
        }
    }
    (of_vertex, positions, colors)
}

/// Which uses of an edge lie across from each other: two with the vertices of the file in common, in opposite directions. Two sheets that
/// touch along an edge have two vertices at each end of it, and stay apart. Then two that remain, as in files that list triangles one by one.
fn pairs(uses: &[u32], triangles: &[[u32; 3]], given: &[[u32; 3]]) -> Vec<[u32; 2]> {
    let ends = |of: &[[u32; 3]], use_: u32| {
        let triangle = of[use_ as usize / 3];
        [0, 1].map(|next| triangle[(use_ as usize + next) % 3])
    };
    let mut found = Vec::new();
    let mut left: Vec<u32> = Vec::new();
    let side = |use_: &u32| {
        let [a, b] = ends(given, *use_);
        [a.min(b), a.max(b)]
    };
    for original in unique(uses.iter().map(side)) {
        let own = uses.iter().copied().filter(|it| side(it) == original);
        match own.collect::<Vec<u32>>()[..] {
            [one] => left.push(one),
            [one, other] if ends(given, one) != ends(given, other) => found.push([one, other]),
            _ => (),
        }
    }
    if let [one, other] = left[..]
        && ends(triangles, one) != ends(triangles, other)
    {
        found.push([one, other]);
    }
    found
}

/// The triangles at each vertex: where those of a vertex begin, and all of them.
fn uses_of_vertices(triangles: &[[u32; 3]], vertices: usize) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; vertices + 1];
    for corner in triangles.iter().flatten() {
        starts[*corner as usize + 1] += 1;
    }
    for vertex in 0..vertices {
        starts[vertex + 1] += starts[vertex];
    }
    let mut next = starts.clone();
    let mut at_vertex = vec![0; 3 * triangles.len()];
    for (triangle, corners) in (0..).zip(triangles) {
        for corner in corners {
            at_vertex[next[*corner as usize] as usize] = triangle;
            next[*corner as usize] += 1;
        }
    }
    (starts, at_vertex)
}
