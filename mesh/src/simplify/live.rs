//! A mesh during edge collapses, with the triangles around each vertex.

use nalgebra::{Point3, Vector3};

/// Marks a removed triangle.
const GONE: [u32; 3] = [u32::MAX; 3];

/// Positions, triangles, and the triangles around each vertex. Indices stay valid; removed elements leave gaps.
pub(super) struct LiveMesh {
    pub(super) positions: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    around: Vec<Vec<u32>>,
    /// Whether each vertex lies on a boundary.
    on_boundary: Vec<bool>,
}

impl LiveMesh {
    pub(super) fn new(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> Self {
        let mut around = vec![Vec::new(); positions.len()];
        for (index, triangle) in triangles.iter().enumerate() {
            for (k, &corner) in triangle.iter().enumerate() {
                // A triangle may refer to a vertex twice.
                if !triangle[..k].contains(&corner) {
                    around[corner as usize].push(index as u32);
                }
            }
        }
        let mut mesh = Self {
            positions: positions.to_vec(),
            triangles: triangles.to_vec(),
            on_boundary: vec![false; positions.len()],
            around,
        };
        for triangle in triangles {
            for k in 0..3 {
                let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
                if mesh.is_boundary_edge(a, b) {
                    mesh.on_boundary[a as usize] = true;
                    mesh.on_boundary[b as usize] = true;
                }
            }
        }
        mesh
    }

    /// Triangles around a vertex.
    pub(super) fn around(&self, vertex: u32) -> &[u32] {
        &self.around[vertex as usize]
    }

    /// Corners of a triangle that has not been removed.
    pub(super) fn corners(&self, triangle: u32) -> [u32; 3] {
        self.triangles[triangle as usize]
    }

    /// Positions of its corners.
    pub(super) fn points(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.corners(triangle).map(|c| self.positions[c as usize])
    }

    /// All remaining triangles, in order.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [u32; 3]> + '_ {
        self.numbered_triangles().map(|(_, corners)| corners)
    }

    /// All remaining triangles with their numbers, in order.
    pub(super) fn numbered_triangles(&self) -> impl Iterator<Item = (u32, [u32; 3])> + '_ {
        let numbered = (0..).zip(self.triangles.iter().copied());
        numbered.filter(|(_, corners)| *corners != GONE)
    }

    /// Whether a triangle remains here as in `other`, at the same place.
    pub(super) fn is_same(&self, other: &Self, triangle: u32) -> bool {
        let (here, there) = (self.corners(triangle), other.corners(triangle));
        let mut corners = here.iter().zip(there);
        here == there
            && (here == GONE
                || corners.all(|(a, b)| self.positions[*a as usize] == other.positions[b as usize]))
    }

    /// Vertices that share a triangle with a vertex, ascending, into `found`.
    pub(super) fn neighbors(&self, vertex: u32, found: &mut Vec<u32>) {
        found.clear();
        for &triangle in self.around(vertex) {
            found.extend(self.corners(triangle).iter().filter(|c| **c != vertex));
        }
        found.sort_unstable();
        found.dedup();
    }

    /// Triangles at an edge.
    pub(super) fn with_edge(&self, a: u32, b: u32) -> impl Iterator<Item = u32> + '_ {
        let around = self.around(a).iter().copied();
        around.filter(move |t| self.corners(*t).contains(&b))
    }

    /// Whether an edge has exactly one triangle.
    pub(super) fn is_boundary_edge(&self, a: u32, b: u32) -> bool {
        self.with_edge(a, b).count() == 1
    }

    /// Whether a vertex lies on a boundary.
    pub(super) fn is_on_boundary(&self, vertex: u32) -> bool {
        self.on_boundary[vertex as usize]
    }

    /// Merges `gone` into `kept` at a new position and removes the triangles between them.
    pub(super) fn collapse(&mut self, kept: u32, gone: u32, position: Point3<f64>) {
        self.positions[kept as usize] = position;
        self.on_boundary[kept as usize] |= self.on_boundary[gone as usize];
        let moving = std::mem::take(&mut self.around[gone as usize]);
        for triangle in moving {
            let corners = self.triangles[triangle as usize];
            if corners.contains(&kept) {
                for corner in corners.into_iter().filter(|c| *c != gone) {
                    self.around[corner as usize].retain(|t| *t != triangle);
                }
                self.triangles[triangle as usize] = GONE;
            } else {
                self.triangles[triangle as usize] =
                    corners.map(|c| if c == gone { kept } else { c });
                self.around[kept as usize].push(triangle);
            }
        }
    }

    /// Whether the triangles around a vertex form one consistently oriented disk, or half disk at a boundary.
    pub(super) fn is_regular(&self, vertex: u32) -> bool {
        let mut steps: Vec<(u32, u32)> = Vec::with_capacity(self.around(vertex).len());
        for &triangle in self.around(vertex) {
            let corners = self.corners(triangle);
            let Some(k) = corners.iter().position(|c| *c == vertex) else {
                return false;
            };
            let (next, last) = (corners[(k + 1) % 3], corners[(k + 2) % 3]);
            if next == last || next == vertex || last == vertex {
                return false;
            }
            steps.push((next, last));
        }
        let Some(&first) = steps.first() else {
            return false;
        };
        let count = |of: fn(&(u32, u32)) -> u32, vertex| {
            steps.iter().filter(|step| of(step) == vertex).count()
        };
        if steps
            .iter()
            .any(|step| count(|s| s.0, step.0) > 1 || count(|s| s.1, step.1) > 1)
        {
            return false;
        }
        // Walks from the start of the half disk, or from any edge of a full disk.
        let start = steps.iter().find(|step| count(|s| s.1, step.0) == 0);
        let (mut at, mut walked) = (start.copied().unwrap_or(first), 1);
        while let Some(&next) = steps.iter().find(|step| step.0 == at.1) {
            if walked == steps.len() {
                break;
            }
            at = next;
            walked += 1;
        }
        walked == steps.len()
    }
}

/// Twice the area of a triangle along its normal.
pub(super) fn doubled_area([a, b, c]: &[Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a))
}

/// Its least height.
pub(super) fn height(corners: &[Point3<f64>; 3]) -> f64 {
    let [a, b, c] = corners;
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    if longest > 0.0 {
        doubled_area(corners).norm() / longest
    } else {
        0.0
    }
}
