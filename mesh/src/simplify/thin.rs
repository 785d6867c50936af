//! Thins a mesh where it is flat, by edge collapses with quadrics.
//!
//! Faster than [`simplify`](super::simplify), which measures each step: here a vertex may lie as far as the tolerance, as a root mean square, from the
//! planes of the triangles that it stands for.
//!
//! # Reference
//! M. Garland and P. Heckbert, *Surface simplification using quadric error metrics*, SIGGRAPH 1997.
//!
//! *Differs from the paper*: errors are means over area, so that the tolerance is a length; boundaries have quadrics and a tolerance of their own.

use nalgebra::{Point3, Vector3};

use super::live::doubled_area;
use super::quadric::Quadric;
use crate::TriangleMesh;
use crate::edge_uses::for_each_edge;

/// How far [`thin`] may go.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ThinOptions {
    /// Root mean square distance of a vertex from the planes that it stands for, in units of the mesh.
    pub tolerance: f64,
    /// The same for boundary edges, across them within the surface.
    pub boundary_tolerance: f64,
    /// Longest edge of a new triangle.
    pub longest_edge: f64,
}

/// Least cosine between the normals of a triangle before and after a collapse.
const LEAST_COSINE: f64 = 0.5;
/// Least quality of a new triangle: 1 for an equilateral one, 0 for one without area.
const LEAST_QUALITY: f64 = 0.1;

/// Collapses edges of a mesh as long as errors are within the tolerances, in rounds: those with the smallest errors first, and each vertex once
/// in a round, so that triangles grow alike in all directions. Components, holes and handles stay. Edges with more than two triangles are not touched,
/// and those that two triangles have in the same direction may stay. Vertices keep their order and take the colour of the nearer end of each
/// collapsed edge.
///
/// # Complexity
/// Linear in the triangles, where few meet at a vertex; rounds shrink by a share.
pub fn thin(mesh: &mut TriangleMesh, options: &ThinOptions) {
    let mut state = Thinning::new(mesh, options);
    let mut is_used = vec![false; state.positions.len()];
    let mut bound = FIRST_BOUND;
    loop {
        let edges = state.edges();
        is_used.fill(false);
        let mut collapsed = 0;
        for &corner in &edges {
            let [a, b] = state.edge(corner);
            if is_used[a as usize] || is_used[b as usize] || state.is_beyond(corner, bound) {
                continue;
            }
            let (position, error) = state.collapsed(a, b);
            if error <= bound {
                if state.collapse(a, b, &position) {
                    is_used[a as usize] = true;
                    collapsed += 1;
                }
            } else {
                state.note_error(corner, error);
            }
        }
        if bound >= 1.0 && LAST_ROUND * collapsed <= edges.len() {
            break;
        }
        bound = (BOUND_GROWTH * bound).min(1.0);
    }
    state.finish(mesh);
}

/// Largest error of the first round, and its growth from round to round up to 1: the squared tolerance.
const FIRST_BOUND: f64 = 1.0 / 256.0;
const BOUND_GROWTH: f64 = 4.0;
/// The last round collapses no more than one edge in so many.
const LAST_ROUND: usize = 200;

/// Weighted squared distances from planes, and the sum of the weights.
#[derive(Debug, Clone, Copy)]
struct Planes {
    quadric: Quadric,
    weight: f64,
}

impl Planes {
    const NONE: Self = Self {
        quadric: Quadric::ZERO,
        weight: 0.0,
    };

    fn add_plane(&mut self, point: &Point3<f64>, normal: &Vector3<f64>, weight: f64) {
        self.quadric.add_plane(&point.coords, normal, weight);
        self.weight += weight;
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            quadric: self.quadric.plus(&other.quadric),
            weight: self.weight + other.weight,
        }
    }

    /// Mean squared distances over a squared tolerance; 0 without a plane.
    fn relative_to(&self, tolerance: f64) -> Quadric {
        match self.weight > 0.0 {
            true => self
                .quadric
                .scaled(1.0 / (self.weight * tolerance * tolerance)),
            false => Quadric::ZERO,
        }
    }
}

const NONE: u32 = u32::MAX;

/// The corners of triangles at each vertex, as linked lists. A corner has the number of its triangle times three plus its own.
struct CornerLists {
    first: Vec<u32>,
    last: Vec<u32>,
    next: Vec<u32>,
}

impl CornerLists {
    fn new(vertices: usize, triangles: &[[u32; 3]]) -> Self {
        let mut lists = Self {
            first: vec![NONE; vertices],
            last: vec![NONE; vertices],
            next: vec![NONE; 3 * triangles.len()],
        };
        for (corner, vertex) in (0..).zip(triangles.as_flattened()) {
            lists.append(*vertex, corner, corner);
        }
        lists
    }

    /// Appends a list of corners to that of a vertex.
    fn append(&mut self, vertex: u32, first: u32, last: u32) {
        let vertex = vertex as usize;
        match self.first[vertex] {
            NONE => self.first[vertex] = first,
            _ => self.next[self.last[vertex] as usize] = first,
        }
        self.last[vertex] = last;
    }

    /// The corners at a vertex.
    fn get(&self, vertex: u32) -> impl Iterator<Item = u32> + '_ {
        let corner = |corner: u32| (corner != NONE).then_some(corner);
        let first = corner(self.first[vertex as usize]);
        std::iter::successors(first, move |at| corner(self.next[*at as usize]))
    }
}

/// A mesh that is being thinned, centred at zero for the accuracy of the quadrics.
struct Thinning {
    options: ThinOptions,
    shift: Vector3<f64>,
    positions: Vec<Point3<f64>>,
    colors: Option<Vec<[u8; 3]>>,
    triangles: Vec<[u32; 3]>,
    is_removed: Vec<bool>,
    /// The error of the edge from each corner, rounded down; 0 where it is not known.
    errors: Vec<f32>,
    at_vertex: CornerLists,
    surface: Vec<Planes>,
    /// Planes across the boundary, and which a vertex has; [`NONE`] inside.
    boundaries: Vec<Planes>,
    boundary_of: Vec<u32>,
    is_fixed: Vec<bool>,
    /// What [`common_neighbours`](Self::common_neighbours) last said of each vertex, and the largest number so far.
    marks: Vec<u64>,
    last_mark: u64,
}

impl Thinning {
    /// Takes the mesh, which is empty until [`finish`](Self::finish).
    fn new(mesh: &mut TriangleMesh, options: &ThinOptions) -> Self {
        let mesh = std::mem::take(mesh);
        let count = mesh.positions.len();
        let shift = mesh
            .positions
            .first()
            .map_or(Vector3::zeros(), |first| first.coords);
        let positions: Vec<Point3<f64>> = mesh.positions.into_iter().map(|p| p - shift).collect();
        let at_vertex = CornerLists::new(count, &mesh.triangles);
        let mut boundaries: Vec<Planes> = Vec::new();
        let mut boundary_of = vec![NONE; count];
        let mut is_fixed = vec![false; count];
        for_each_edge(&mesh.triangles, count, |ends, uses| {
            let ends = ends.map(|end| end as usize);
            if let &[corner] = uses {
                let corners = mesh.triangles[corner as usize / 3].map(|it| positions[it as usize]);
                let along = positions[ends[1]] - positions[ends[0]];
                let across = doubled_area(&corners).cross(&along).try_normalize(0.0);
                if let Some(across) = across {
                    for end in ends {
                        if boundary_of[end] == NONE {
                            boundary_of[end] = boundaries.len() as u32;
                            boundaries.push(Planes::NONE);
                        }
                        let planes = &mut boundaries[boundary_of[end] as usize];
                        planes.add_plane(&positions[ends[0]], &across, along.norm());
                    }
                }
            } else if uses.len() > 2 {
                for end in ends {
                    is_fixed[end] = true;
                }
            }
        });
        let mut surface = vec![Planes::NONE; count];
        for triangle in &mesh.triangles {
            let corners = triangle.map(|corner| positions[corner as usize]);
            let area = doubled_area(&corners);
            let weight = area.norm();
            for corner in triangle {
                if weight > 0.0 {
                    surface[*corner as usize].add_plane(&corners[0], &(area / weight), weight);
                }
            }
        }
        Self {
            options: *options,
            shift,
            positions,
            colors: mesh.colors,
            is_removed: vec![false; mesh.triangles.len()],
            errors: vec![0.0; 3 * mesh.triangles.len()],
            triangles: mesh.triangles,
            at_vertex,
            surface,
            boundaries,
            boundary_of,
            is_fixed,
            marks: vec![0; count],
            last_mark: 0,
        }
    }

    /// The corners where edges begin, ascending; of some edges both.
    fn edges(&self) -> Vec<u32> {
        let corners = (0..3 * self.triangles.len() as u32).zip(self.triangles.as_flattened());
        let left = corners.filter(|(corner, _)| !self.is_removed[*corner as usize / 3]);
        // Two triangles have an edge in opposite directions, except at boundaries.
        left.filter(|(corner, a)| {
            let b = self.next(*corner);
            **a < b || (self.is_on_boundary(**a) && self.is_on_boundary(b))
        })
        .map(|(corner, _)| corner)
        .collect()
    }

    /// The vertex at the next corner of a triangle.
    fn next(&self, corner: u32) -> u32 {
        let (number, own) = (corner as usize / 3, corner as usize % 3);
        self.triangles[number][(own + 1) % 3]
    }

    /// The ends of the edge that begins at a corner, the smaller first.
    fn edge(&self, corner: u32) -> [u32; 2] {
        let (a, b) = (
            self.triangles.as_flattened()[corner as usize],
            self.next(corner),
        );
        [a.min(b), a.max(b)]
    }

    /// Whether the edge from a corner is gone, or known to have a larger error.
    fn is_beyond(&self, corner: u32, bound: f64) -> bool {
        let corner = corner as usize;
        self.is_removed[corner / 3] || f64::from(self.errors[corner]) > bound
    }

    /// Notes the error of the edge from a corner, which stays as it is as long as the ends do.
    fn note_error(&mut self, corner: u32, error: f64) {
        self.errors[corner as usize] = (error as f32).next_down();
    }

    /// Forgets the errors of the edges of the triangles at a vertex.
    fn forget_errors(&mut self, vertex: u32) {
        for corner in self.at_vertex.get(vertex) {
            let first = corner as usize / 3 * 3;
            self.errors[first..first + 3].fill(0.0);
        }
    }

    /// The triangles at a vertex with their numbers.
    fn around(&self, vertex: u32) -> impl Iterator<Item = (u32, [u32; 3])> + '_ {
        let numbers = self.at_vertex.get(vertex).map(|corner| corner / 3);
        numbers
            .filter(|number| !self.is_removed[*number as usize])
            .map(|number| (number, self.triangles[number as usize]))
    }

    /// How many vertices share an edge with both of two vertices.
    fn common_neighbours(&mut self, a: u32, b: u32) -> usize {
        let mut marks = std::mem::take(&mut self.marks);
        let (near_a, counted) = (self.last_mark + 1, self.last_mark + 2);
        for corner in self.around(a).flat_map(|(_, corners)| corners) {
            marks[corner as usize] = near_a;
        }
        marks[a as usize] = counted;
        marks[b as usize] = counted;
        let mut common = 0;
        for corner in self.around(b).flat_map(|(_, corners)| corners) {
            if marks[corner as usize] == near_a {
                marks[corner as usize] = counted;
                common += 1;
            }
        }
        self.marks = marks;
        self.last_mark = counted;
        common
    }

    fn is_on_boundary(&self, vertex: u32) -> bool {
        self.boundary_of[vertex as usize] != NONE
    }

    /// Planes across the boundary at a vertex.
    fn boundary(&self, vertex: usize) -> Planes {
        let planes = self.boundaries.get(self.boundary_of[vertex] as usize);
        planes.copied().unwrap_or(Planes::NONE)
    }

    /// Where the vertex of a collapsed edge would lie, and its error; infinite for edges that stay.
    fn collapsed(&self, a: u32, b: u32) -> (Point3<f64>, f64) {
        let ends = [a, b].map(|end| end as usize);
        if ends.iter().any(|end| self.is_fixed[*end]) {
            return (self.positions[ends[0]], f64::INFINITY);
        }
        let relative =
            |planes: [Planes; 2], tolerance: f64| planes[0].plus(&planes[1]).relative_to(tolerance);
        let surface = relative(ends.map(|end| self.surface[end]), self.options.tolerance);
        let boundary = ends.map(|end| self.boundary(end));
        let errors = surface.plus(&relative(boundary, self.options.boundary_tolerance));
        let middle = nalgebra::center(&self.positions[ends[0]], &self.positions[ends[1]]);
        let position = errors.minimizer(&middle.coords).unwrap_or(middle);
        (position, errors.at(&position.coords))
    }

    /// Collapses an edge into its first end, unless that would change the topology or turn a triangle over.
    fn collapse(&mut self, a: u32, b: u32, position: &Point3<f64>) -> bool {
        let shared = self
            .around(a)
            .filter(|(_, corners)| corners.contains(&b))
            .count();
        let common = self.common_neighbours(a, b);
        // Link condition: the ends have no other neighbours in common than those across the edge.
        if shared == 0 || common != shared {
            return false;
        }
        if self.is_on_boundary(a) && self.is_on_boundary(b) && shared != 1 {
            return false;
        }
        let is_valid = |vertex: u32, other: u32| {
            self.around(vertex)
                .filter(|(_, corners)| !corners.contains(&other))
                .all(|(_, corners)| self.may_move(corners, vertex, position))
        };
        if !is_valid(a, b) || !is_valid(b, a) {
            return false;
        }
        let mut at = self.at_vertex.first[b as usize];
        while at != NONE {
            let number = at as usize / 3;
            if self.triangles[number].contains(&a) {
                self.is_removed[number] = true;
            } else {
                self.triangles[number][at as usize % 3] = a;
            }
            at = self.at_vertex.next[at as usize];
        }
        let [head, tail] =
            [&self.at_vertex.first, &self.at_vertex.last].map(|list| list[b as usize]);
        self.at_vertex.append(a, head, tail);
        let (first, second) = (a as usize, b as usize);
        if let Some(colors) = &mut self.colors {
            let distance = |end: usize| (self.positions[end] - position).norm_squared();
            if distance(second) < distance(first) {
                colors[first] = colors[second];
            }
        }
        self.positions[first] = *position;
        self.surface[first] = self.surface[first].plus(&self.surface[second]);
        if self.is_on_boundary(a) || self.is_on_boundary(b) {
            let boundary = self.boundary(first).plus(&self.boundary(second));
            if !self.is_on_boundary(a) {
                self.boundary_of[first] = self.boundary_of[second];
            }
            self.boundaries[self.boundary_of[first] as usize] = boundary;
        }
        self.forget_errors(a);
        true
    }

    /// Whether a triangle keeps its side and some shape when one of its corners moves.
    fn may_move(&self, corners: [u32; 3], vertex: u32, position: &Point3<f64>) -> bool {
        let before = corners.map(|corner| self.positions[corner as usize]);
        let after: [Point3<f64>; 3] = std::array::from_fn(|k| match corners[k] == vertex {
            true => *position,
            false => before[k],
        });
        let squares = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (after[i] - after[j]).norm_squared());
        let longest = squares.into_iter().fold(0.0, f64::max);
        if longest > self.options.longest_edge.powi(2) {
            return false;
        }
        let (old, new) = (doubled_area(&before), doubled_area(&after));
        // 2 sqrt(3) makes it 1 for an equilateral triangle.
        let quality = |area: &Vector3<f64>, squares: [f64; 3]| {
            12.0_f64.sqrt() * area.norm() / squares.iter().sum::<f64>()
        };
        quality(&new, squares) >= LEAST_QUALITY
            && new.dot(&old) >= LEAST_COSINE * new.norm() * old.norm()
    }

    /// Writes the vertices and triangles that are left.
    fn finish(self, mesh: &mut TriangleMesh) {
        let mut number = vec![u32::MAX; self.positions.len()];
        let left = || {
            let triangles = self.triangles.iter().zip(&self.is_removed);
            triangles
                .filter(|(_, is_removed)| !**is_removed)
                .map(|(triangle, _)| *triangle)
        };
        for corner in left().flatten() {
            number[corner as usize] = 0;
        }
        let mut colors = Vec::new();
        for (vertex, number) in number
            .iter_mut()
            .enumerate()
            .filter(|(_, number)| **number == 0)
        {
            *number = mesh.positions.len() as u32;
            mesh.positions.push(self.positions[vertex] + self.shift);
            colors.extend(self.colors.as_ref().map(|colors| colors[vertex]));
        }
        mesh.colors = self.colors.as_ref().map(|_| colors);
        mesh.triangles = left()
            .map(|corners| corners.map(|corner| number[corner as usize]))
            .collect();
    }
}

#[cfg(test)]
mod tests;
