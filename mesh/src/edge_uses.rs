//! Which triangles use each edge.

/// Calls `visit` with the smaller vertex of each edge of each triangle, the larger one, and the corner where it begins.
fn for_each_use(triangles: &[[u32; 3]], mut visit: impl FnMut(u32, u32, u32)) {
    for (corner, &[a, b, c]) in (0..).step_by(3).zip(triangles) {
        visit(a.min(b), a.max(b), corner);
        visit(b.min(c), b.max(c), corner + 1);
        visit(c.min(a), c.max(a), corner + 2);
    }
}

/// Most uses that [`for_each_edge`] holds at once, where no vertex has more.
const HELD_USES: usize = 1 << 20;

/// Visits the edges of triangles with vertices below `vertices`, ascending: the two ends, the smaller first, and the corners where triangles have the edge. A corner is the
/// number of its triangle times three plus its own; the edge leads to the next one.
///
/// # Complexity
/// Linear in the triangles where few of them meet at a vertex, and two passes over them for each 2^20 uses.
pub fn for_each_edge(
    triangles: &[[u32; 3]],
    vertices: usize,
    mut visit: impl FnMut([u32; 2], &[u32]),
) {
    let passes = (3 * triangles.len()).div_ceil(HELD_USES).max(1);
    let step = vertices.div_ceil(passes).max(1) as u32;
    // The larger vertex and the corner of each use, in one number.
    let mut uses: Vec<u64> = Vec::new();
    // Where the next use of each smaller vertex goes to; in the end, where those of the next one begin.
    let mut places: Vec<u32> = Vec::new();
    let mut corners: Vec<u32> = Vec::new();
    for first in (0..vertices as u32).step_by(step as usize) {
        places.clear();
        places.resize(step as usize, 0);
        for_each_use(triangles, |smaller, _, _| {
            if let Some(count) = places.get_mut(smaller.wrapping_sub(first) as usize) {
                *count += 1;
            }
        });
        let mut before = 0;
        for count in &mut places {
            before += std::mem::replace(count, before);
        }
        uses.clear();
        uses.resize(before as usize, 0);
        for_each_use(triangles, |smaller, larger, corner| {
            if let Some(next) = places.get_mut(smaller.wrapping_sub(first) as usize) {
                uses[*next as usize] = u64::from(larger) << 32 | u64::from(corner);
                *next += 1;
            }
        });
        let mut start = 0;
        for (smaller, end) in (first..).zip(&places) {
            let own = &mut uses[start..*end as usize];
            own.sort_unstable();
            for edge in own.chunk_by(|a, b| a >> 32 == b >> 32) {
                corners.clear();
                corners.extend(edge.iter().map(|it| *it as u32));
                visit([smaller, (edge[0] >> 32) as u32], &corners);
            }
            start = *end as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_visited_in_order() {
        // Enough triangles for several passes, with vertices in any order.
        let count = HELD_USES as u32;
        let vertex = |k: u32| k.wrapping_mul(2_654_435_761) >> 8 & 0xffff;
        let triangles: Vec<[u32; 3]> = (0..count)
            .map(|k| [vertex(k), vertex(k + 1), vertex(k + 7)])
            .collect();
        let mut expected = Vec::new();
        for_each_use(&triangles, |a, b, corner| expected.push(([a, b], corner)));
        expected.sort_unstable();
        let mut found = Vec::new();
        for_each_edge(&triangles, 1 << 16, |ends, corners| {
            found.extend(corners.iter().map(|corner| (ends, *corner)));
        });
        assert_eq!(found, expected);
        for_each_edge(&[], 0, |_, _| panic!("there is no edge"));
    }
}
