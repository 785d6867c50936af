//! Surface nets: a vertex in each cell that the surface crosses, a quadrilateral around each edge of the grid that it crosses.

use nalgebra::{Point3, Vector3};
use rustc_hash::FxHashMap;

use super::field::Field;
use super::{Corner, env, position};

/// The surface of a field.
pub(super) fn extract(field: &Field) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    let side = field.side;
    let steepest = env("LC_STEEP", 1.75) * side;
    let step = |corner: Corner, axis: usize, by: i32| {
        let mut next = corner;
        next[axis] += by;
        next
    };
    // Crossing of the edge from a corner along an axis.
    let crossing = |corner: Corner, axis: usize| -> Option<(f64, bool)> {
        let (a, b) = (field.at(corner)?, field.at(step(corner, axis, 1))?);
        let is_crossed = (a < 0.0) != (b < 0.0);
        (is_crossed && (a - b).abs() <= steepest).then(|| (a / (a - b), a < 0.0))
    };
    // Vertices: the mean of the crossings of a cell, for each connected part of its corners behind the surface.
    let mut vertex_of: FxHashMap<(Corner, u8), u32> = FxHashMap::default();
    let mut positions: Vec<Point3<f64>> = Vec::new();
    let mut parts_of: FxHashMap<Corner, [u8; 8]> = FxHashMap::default();
    for &cell in &field.cells {
        let corner = |bit: usize| [cell[0] + (bit & 1) as i32, cell[1] + (bit >> 1 & 1) as i32, cell[2] + (bit >> 2) as i32];
        let mut behind = [false; 8];
        let mut any = false;
        for bit in 0..8 {
            behind[bit] = field.at(corner(bit)).is_some_and(|distance| distance < 0.0);
            any |= behind[bit];
        }
        if !any {
            continue;
        }
        // Connected parts of the corners behind.
        let mut part: [u8; 8] = std::array::from_fn(|bit| bit as u8);
        for _ in 0..8 {
            for bit in 0..8 {
                for axis in 0..3 {
                    let other = bit ^ (1 << axis);
                    if behind[bit] && behind[other] {
                        part[bit] = part[bit].min(part[other]);
                    }
                }
            }
        }
        let mut sums = [(Vector3::zeros(), 0.0); 8];
        for bit in 0..8usize {
            for axis in 0..3 {
                if bit >> axis & 1 == 1 {
                    continue;
                }
                if let Some((share, is_first_behind)) = crossing(corner(bit), axis) {
                    let mut at = position(corner(bit), side);
                    at[axis] += share * side;
                    let owner = if is_first_behind { bit } else { bit | 1 << axis };
                    let sum = &mut sums[part[owner] as usize];
                    sum.0 += at.coords;
                    sum.1 += 1.0;
                }
            }
        }
        let mut has_vertex = false;
        for (number, (sum, count)) in sums.iter().enumerate() {
            if *count > 0.0 {
                vertex_of.insert((cell, number as u8), positions.len() as u32);
                positions.push(Point3::from(sum / *count));
                has_vertex = true;
            }
        }
        if has_vertex {
            parts_of.insert(cell, part);
        }
    }
    let mut triangles = Vec::new();
    for &corner in field.corners() {
        for axis in 0..3 {
            let Some((_, is_first_behind)) = crossing(corner, axis) else {
                continue;
            };
            let owner = if is_first_behind { corner } else { step(corner, axis, 1) };
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            // The four cells around the edge, anticlockwise seen from its end.
            let around = [[0, 0], [-1, 0], [-1, -1], [0, -1]].map(|[i, j]| step(step(corner, u, i), v, j));
            let vertex = |cell: Corner| {
                let part = parts_of.get(&cell)?;
                let bit = (0..3).fold(0, |bit, k| bit | ((owner[k] - cell[k]) as usize) << k);
                vertex_of.get(&(cell, part[bit])).copied()
            };
            let corners = around.map(vertex);
            let [Some(a), Some(b), Some(c), Some(d)] = corners else {
                continue;
            };
            // Normals point to where the distance is positive.
            let [a, b, c, d] = if is_first_behind { [a, b, c, d] } else { [d, c, b, a] };
            let length = |p: u32, q: u32| (positions[p as usize] - positions[q as usize]).norm_squared();
            let quad = if length(a, c) <= length(b, d) {
                [[a, b, c], [a, c, d]]
            } else {
                [[a, b, d], [b, c, d]]
            };
            triangles.extend(quad.into_iter().filter(|[p, q, r]| p != q && q != r && r != p));
        }
    }
    (positions, triangles)
}
