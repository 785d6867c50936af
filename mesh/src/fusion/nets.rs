//! Surface nets: vertices in the cubes that a surface crosses, a quadrilateral around each edge of the grid that it crosses.

use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashMap;

use super::blocks::Nearby;
use super::field::Field;
use super::grid::Corner;

/// The eight corners of a cube. Bit `axis` of a number says on which side a corner is.
const CORNERS: usize = 8;

/// The vertices of a cube with more than one: those of its connected groups of corners behind the surface, by the lowest corner of each.
struct CubeVertices {
    /// Lowest corner of the group of each corner.
    group: [u8; CORNERS],
    /// Vertex of each group.
    vertex: [u32; CORNERS],
}

const NONE: u32 = u32::MAX;
/// Marks the number of a cube's [`CubeVertices`].
const SEVERAL: u32 = 1 << 31;

/// The vertices so far.
#[derive(Default)]
struct Vertices {
    positions: Vec<Point3<f64>>,
    /// Those at the rim, by their positions.
    at_rim: FxHashMap<[u64; 3], u32>,
}

impl Vertices {
    /// The vertex at the mean of crossings. Where depth ends, a cube has one or two, which are also those of a cube beside it: the two share the
    /// vertex, so that no triangle is without area.
    fn place(&mut self, crossings: &Crossings) -> u32 {
        let position = Point3::from(crossings.sum / f64::from(crossings.count));
        let next = self.positions.len() as u32;
        if crossings.count < 3 {
            let key = [position.x, position.y, position.z].map(f64::to_bits);
            let known = *self.at_rim.entry(key).or_insert(next);
            if known != next {
                return known;
            }
        }
        self.positions.push(position);
        next
    }
}

/// Crossings around a group of corners.
#[derive(Clone, Copy)]
struct Crossings {
    sum: Vector3<f64>,
    count: u32,
}

/// Positions and triangles of the surface where the distance is zero, with normals to where it is positive.
pub(super) fn extract(field: &Field) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let nets = Nets::new(field);
    let mut triangles = Vec::new();
    let mut distances = field.distances.iter();
    for block in field.corners.blocks() {
        let corners = Nearby::after(block, &field.corners);
        let cubes = Nearby::before(block, &field.cubes);
        for (corner, &distance) in block.corners().zip(&mut distances) {
            if distance.is_nan() {
                continue;
            }
            for axis in 0..3 {
                let other = field.distance(&corners, corner.next(axis));
                let Some(crossing) = crossing(distance, other) else {
                    continue;
                };
                if let Some(ring) = nets.ring(&cubes, corner, axis, crossing.is_first_behind) {
                    triangles.extend(nets.halves(ring));
                }
            }
        }
    }
    (nets.positions, triangles)
}

/// The vertices of all cubes.
struct Nets {
    positions: Vec<Point3<f64>>,
    /// The vertex of each cube, or [`SEVERAL`] and the place of its vertices among `several`.
    vertex_of: Vec<u32>,
    several: Vec<CubeVertices>,
}

impl Nets {
    fn new(field: &Field) -> Self {
        let mut vertices = Vertices::default();
        let mut vertex_of = Vec::with_capacity(field.cubes.len());
        let mut several: Vec<CubeVertices> = Vec::new();
        for block in field.cubes.blocks() {
            let corners = Nearby::after(block, &field.corners);
            for cube in block.corners() {
                let found = place_vertices(field, &corners, cube, &mut vertices);
                vertex_of.push(found.map_or(NONE, |found| {
                    let mut used = found.vertex.into_iter().filter(|vertex| *vertex != NONE);
                    match (used.next(), used.next()) {
                        (Some(vertex), None) => vertex,
                        _ => {
                            several.push(found);
                            SEVERAL | (several.len() - 1) as u32
                        }
                    }
                }));
            }
        }
        Self {
            positions: vertices.positions,
            vertex_of,
            several,
        }
    }

    /// The vertices of the four cubes around the edge of the grid from a corner along an axis, which the surface crosses: anticlockwise seen from
    /// where the distance is positive. `None` when one is missing. `cubes` are those near the corner.
    fn ring(
        &self,
        cubes: &Nearby<'_>,
        corner: Corner,
        axis: usize,
        is_first_behind: bool,
    ) -> Option<[u32; 4]> {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let left = corner.previous(u);
        let around = [corner, left, left.previous(v), corner.previous(v)];
        // The number of the edge's first corner in each of them.
        let first = [0, 1 << u, 1 << u | 1 << v, 1 << v];
        let mut ring = [NONE; 4];
        for k in 0..4 {
            let vertex = self.vertex_of[cubes.number(around[k])?];
            ring[k] = match vertex {
                NONE => return None,
                vertex if vertex & SEVERAL == 0 => vertex,
                several_at => {
                    let found = &self.several[(several_at & !SEVERAL) as usize];
                    let behind = first[k] | usize::from(!is_first_behind) << axis;
                    found.vertex[found.group[behind] as usize]
                }
            };
        }
        if !is_first_behind {
            ring.reverse();
        }
        (!ring.contains(&NONE)).then_some(ring)
    }

    /// The triangles of a quadrilateral, parted along its shorter diagonal.
    fn halves(&self, [a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
        let length = |p: u32, q: u32| {
            (self.positions[p as usize] - self.positions[q as usize]).norm_squared()
        };
        match length(a, c) <= length(b, d) {
            true => [[a, b, c], [a, c, d]],
            false => [[a, b, d], [b, c, d]],
        }
    }
}

/// Where the distance changes its sign along an edge of the grid.
struct Crossing {
    /// Share of the edge before it.
    share: f64,
    /// Whether the first end lies behind the surface.
    is_first_behind: bool,
}

/// The crossing between two distances; `None` when there is none, or one is unknown.
fn crossing(first: f32, second: f32) -> Option<Crossing> {
    let is_known = !(first.is_nan() || second.is_nan());
    (is_known && (first < 0.0) != (second < 0.0)).then(|| Crossing {
        share: f64::from(first) / (f64::from(first) - f64::from(second)),
        is_first_behind: first < 0.0,
    })
}

/// Places the vertices of a cube: the mean of the crossings around each group of corners behind the surface. `None` without one.
fn place_vertices(
    field: &Field,
    near: &Nearby<'_>,
    cube: Corner,
    vertices: &mut Vertices,
) -> Option<CubeVertices> {
    let mut corners = [cube; CORNERS];
    for number in 1..CORNERS {
        let axis = number.ilog2() as usize;
        corners[number] = corners[number ^ 1 << axis].next(axis);
    }
    let distances = corners.map(|corner| field.distance(near, corner));
    let is_behind = distances.map(|distance| distance < 0.0);
    let is_before = distances.map(|distance| distance >= 0.0);
    if !is_behind.contains(&true) || !is_before.contains(&true) {
        return None;
    }
    let mut group: [u8; CORNERS] = std::array::from_fn(|number| number as u8);
    loop {
        let before = group;
        for number in 0..CORNERS {
            for axis in 0..3 {
                let other = number ^ 1 << axis;
                if is_behind[number] && is_behind[other] {
                    group[number] = group[number].min(group[other]);
                }
            }
        }
        if group == before {
            break;
        }
    }
    let mut crossings = [Crossings {
        sum: Vector3::zeros(),
        count: 0,
    }; CORNERS];
    for (number, axis) in (0..CORNERS).flat_map(|number| (0..3).map(move |axis| (number, axis))) {
        let other = number ^ 1 << axis;
        if other < number {
            continue;
        }
        if let Some(crossing) = crossing(distances[number], distances[other]) {
            let mut at = corners[number].position(field.side);
            at[axis] += crossing.share * field.side;
            let behind = if crossing.is_first_behind {
                number
            } else {
                other
            };
            let around = &mut crossings[group[behind] as usize];
            around.sum += at.coords;
            around.count += 1;
        }
    }
    let mut vertex = [NONE; CORNERS];
    for (vertex, around) in vertex.iter_mut().zip(&crossings) {
        if around.count > 0 {
            *vertex = vertices.place(around);
        }
    }
    Some(CubeVertices { group, vertex })
}
