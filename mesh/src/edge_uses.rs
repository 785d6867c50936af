//! Which triangles use each edge.

/// The edges of all triangles, the smaller vertex first, each with the corner where a triangle's begins: the number of the triangle times three,
/// plus that of the corner. Ascending, so that the uses of an edge follow each other.
///
/// # Complexity
/// O(n log n) in the triangles.
pub(crate) fn edge_uses(triangles: &[[u32; 3]]) -> Vec<([u32; 2], u32)> {
    let mut uses: Vec<([u32; 2], u32)> = (0..)
        .zip(triangles)
        .flat_map(|(number, &[a, b, c])| {
            let edges = [[a, b], [b, c], [c, a]].into_iter().zip(3 * number..);
            edges.map(|([a, b], corner)| ([a.min(b), a.max(b)], corner))
        })
        .collect();
    uses.sort_unstable();
    uses
}
