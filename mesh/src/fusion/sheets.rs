//! Separates sheets of a surface that meet at a vertex or an edge only, and leaves out small pieces.

use nalgebra::Point3;

use crate::disjoint_sets::DisjointSets;
use crate::edge_uses::for_each_edge;

const NONE: u32 = u32::MAX;

/// Vertices and triangles with a copy of each vertex for each of its fans. Triangles belong together where exactly two share an edge in
/// opposite directions. Pieces with fewer than `least` triangles and triangles that use a vertex twice are left out.
pub(super) fn separate(
    positions: Vec<Point3<f64>>,
    mut triangles: Vec<[u32; 3]>,
    least: usize,
) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    let vertex = |corner: u32| triangles[corner as usize / 3][corner as usize % 3];
    let next = |corner: u32| corner - corner % 3 + (corner + 1) % 3;
    let mut fans = DisjointSets::new(3 * triangles.len());
    let mut pieces = DisjointSets::new(triangles.len());
    for_each_edge(&triangles, positions.len(), |_, shared| {
        let &[a, b] = shared else {
            return;
        };
        if vertex(a) == vertex(next(b)) {
            fans.join(a, next(b));
            fans.join(next(a), b);
            pieces.join(a / 3, b / 3);
        }
    });
    let mut sizes = vec![0_u32; triangles.len()];
    for number in 0..triangles.len() as u32 {
        sizes[pieces.find(number) as usize] += 1;
    }
    let mut copy_of = vec![NONE; 3 * triangles.len()];
    let (mut copies, mut kept) = (Vec::new(), Vec::new());
    for (number, triangle) in (0..).zip(&triangles) {
        if (sizes[pieces.find(number) as usize] as usize) < least {
            continue;
        }
        let mut corners = [0; 3];
        for (k, corner) in (3 * number..).take(3).enumerate() {
            let copy = &mut copy_of[fans.find(corner) as usize];
            if *copy == NONE {
                *copy = copies.len() as u32;
                copies.push(positions[triangle[k] as usize]);
            }
            corners[k] = *copy;
        }
        kept.push(corners);
    }
    copies.shrink_to_fit();
    kept.shrink_to_fit();
    (copies, kept)
}
