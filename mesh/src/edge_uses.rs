//! Which triangles use each edge.

/// An edge, the smaller vertex first, and the corner where it begins: the number of the triangle times three, plus that of the corner.
pub(crate) type EdgeUse = ([u32; 2], u32);

/// The edges of all triangles. Ascending, so that the uses of an edge follow each other.
///
/// # Complexity
/// O(n log n) in the triangles.
pub(crate) fn edge_uses(triangles: &[[u32; 3]]) -> Vec<EdgeUse> {
    let mut uses: Vec<EdgeUse> = Vec::with_capacity(3 * triangles.len());
    uses.extend(unsorted(triangles));
    uses.sort_unstable();
    uses
}

fn unsorted(triangles: &[[u32; 3]]) -> impl Iterator<Item = EdgeUse> {
    (0..).zip(triangles).flat_map(|(number, &[a, b, c])| {
        let edges = [[a, b], [b, c], [c, a]].into_iter().zip(3 * number..);
        edges.map(|([a, b], corner)| ([a.min(b), a.max(b)], corner))
    })
}

/// Most uses that [`for_each_edge`] holds at once, where no vertex has more.
const HELD_USES: usize = 1 << 18;

/// Visits the [uses](edge_uses) of one edge after the other, ascending, in less memory.
///
/// # Complexity
/// Linear in the triangles where few of them meet at a vertex, and one pass over them for each 2^18 uses.
pub(crate) fn for_each_edge(
    triangles: &[[u32; 3]],
    vertices: usize,
    mut visit: impl FnMut(&[EdgeUse]),
) {
    let passes = (3 * triangles.len()).div_ceil(HELD_USES).max(1);
    let step = vertices.div_ceil(passes).max(1) as u32;
    let mut found: Vec<EdgeUse> = Vec::new();
    let mut uses: Vec<EdgeUse> = Vec::new();
    // Where the next use of each smaller vertex goes to; in the end, where those of the next one begin.
    let mut places: Vec<u32> = Vec::new();
    for first in (0..vertices as u32).step_by(step as usize) {
        let place = |([smaller, _], _): &EdgeUse| (smaller - first) as usize;
        found.clear();
        let is_next = |([smaller, _], _): &EdgeUse| smaller.wrapping_sub(first) < step;
        found.extend(unsorted(triangles).filter(is_next));
        places.clear();
        places.resize(step as usize, 0);
        for at in &found {
            places[place(at)] += 1;
        }
        let mut before = 0;
        for count in &mut places {
            before += std::mem::replace(count, before);
        }
        uses.clear();
        uses.resize(found.len(), ([0; 2], 0));
        for at in &found {
            let next = &mut places[place(at)];
            uses[*next as usize] = *at;
            *next += 1;
        }
        let mut start = 0;
        for end in places.iter().map(|end| *end as usize) {
            let own = &mut uses[start..end];
            own.sort_unstable();
            own.chunk_by(|a, b| a.0 == b.0).for_each(&mut visit);
            start = end;
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
        let expected = edge_uses(&triangles);
        let mut found = Vec::new();
        for_each_edge(&triangles, 1 << 16, |uses| {
            assert!(uses.iter().all(|(ends, _)| *ends == uses[0].0));
            found.extend_from_slice(uses);
        });
        assert_eq!(found, expected);
        for_each_edge(&[], 0, |_| panic!("there is no edge"));
    }
}
