//! Separates the sheets of a surface that meet at a vertex or an edge only, and leaves out small pieces.

use nalgebra::Point3;
use rustc_hash::FxHashMap;

fn find(parent: &mut [u32], mut at: u32) -> u32 {
    while parent[at as usize] != at {
        parent[at as usize] = parent[parent[at as usize] as usize];
        at = parent[at as usize];
    }
    at
}

fn join(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parent, a), find(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

/// Triangles that share an edge with exactly one other stay connected along it. Each vertex is copied for each of its fans. Components of
/// fewer than `least` triangles are left out.
pub(super) fn separate(
    positions: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
    least: usize,
) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
    // Union of the corners of triangles across manifold edges.
    let mut uses: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
    for (index, corners) in triangles.iter().enumerate() {
        for k in 0..3 {
            let (a, b) = (corners[k], corners[(k + 1) % 3]);
            uses.push(([a.min(b), a.max(b)], (3 * index + k) as u32));
        }
    }
    uses.sort_unstable();
    let mut corner_fan: Vec<u32> = (0..3 * triangles.len() as u32).collect();
    let mut piece: Vec<u32> = (0..triangles.len() as u32).collect();
    for shared in uses.chunk_by(|a, b| a.0 == b.0) {
        let [(_, a), (_, b)] = shared else { continue };
        let ends = |half: u32| {
            let (t, k) = (half / 3, half % 3);
            [(triangles[t as usize][k as usize], 3 * t + k), (triangles[t as usize][(k as usize + 1) % 3], 3 * t + (k + 1) % 3)]
        };
        let (ea, eb) = (ends(*a), ends(*b));
        // Opposite directions only: the same direction would turn the surface over.
        if ea[0].0 != eb[1].0 {
            continue;
        }
        join(&mut corner_fan, ea[0].1, eb[1].1);
        join(&mut corner_fan, ea[1].1, eb[0].1);
        join(&mut piece, a / 3, b / 3);
    }
    let mut size = vec![0usize; triangles.len()];
    for t in 0..triangles.len() as u32 {
        size[find(&mut piece, t) as usize] += 1;
    }
    let mut number: FxHashMap<u32, u32> = FxHashMap::default();
    let (mut kept, mut placed) = (Vec::new(), Vec::new());
    for (t, corners) in triangles.iter().enumerate() {
        if size[find(&mut piece, t as u32) as usize] < least {
            continue;
        }
        let triangle = std::array::from_fn(|k| {
            let fan = find(&mut corner_fan, (3 * t + k) as u32);
            *number.entry(fan).or_insert_with(|| {
                placed.push(positions[corners[k] as usize]);
                placed.len() as u32 - 1
            })
        });
        kept.push(triangle);
    }
    (placed, kept)
}
