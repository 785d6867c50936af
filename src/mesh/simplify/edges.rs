//! Which triangles meet along which edges.

/// The other triangle along each edge of each triangle.
pub(super) struct Neighbors {
    /// For edge k of triangle t, from its corner k to the next, at 3 t + k.
    across: Vec<Option<u32>>,
}

impl Neighbors {
    /// Of triangles over some vertices. Two triangles are neighbours when they alone share an edge and run through it in
    /// opposite directions.
    pub(super) fn new(triangles: &[[u32; 3]]) -> Self {
        let mut uses: Vec<(u32, u32, u32)> = (0..3 * triangles.len() as u32)
            .map(|edge| {
                let (from, to) = ends(triangles, edge);
                (from.min(to), from.max(to), edge)
            })
            .collect();
        uses.sort_unstable();
        let mut across = vec![None; uses.len()];
        for group in uses.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)) {
            if let [(_, _, a), (_, _, b)] = *group
                && ends(triangles, a) != ends(triangles, b)
            {
                across[a as usize] = Some(b / 3);
                across[b as usize] = Some(a / 3);
            }
        }
        Self { across }
    }

    /// The triangle across an edge.
    pub(super) fn across(&self, edge: u32) -> Option<u32> {
        self.across[edge as usize]
    }
}

/// From which vertex to which an edge runs in its triangle.
pub(super) fn ends(triangles: &[[u32; 3]], edge: u32) -> (u32, u32) {
    let corners = triangles[edge as usize / 3];
    let k = edge as usize % 3;
    (corners[k], corners[(k + 1) % 3])
}
