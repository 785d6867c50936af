//! Differences between a surface and the one before.

use nalgebra::Point3;
use rustc_hash::FxHashMap;
use serde::Serialize;

use linecarve_mesh::TriangleMesh;

/// What turns the surface before into the surface now.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SurfaceChange {
    /// Number of the first of the new vertices; numbers are never used twice.
    pub first_vertex: u64,
    /// Positions of new vertices, in the frame of the poses.
    pub vertices: Vec<[f64; 3]>,
    /// Triangles that are new, as numbers of vertices, the smallest first, counter-clockwise seen from free space.
    pub added: Vec<[u64; 3]>,
    /// Triangles that are gone.
    pub removed: Vec<[u64; 3]>,
}

/// Follows a surface: numbers its vertices, and finds which triangles came and went.
///
/// Vertices are told apart by position. A vertex keeps its number as long as a triangle has it; where a surface has several
/// vertices at one position, as the repair of pinched places makes them, they share a number.
///
/// # Complexity
/// Linear in the size of the surface for each step, without regard to what changed.
#[derive(Debug, Default)]
pub struct Follower {
    numbers: FxHashMap<[u64; 3], u64>,
    next: u64,
    /// Sorted.
    triangles: Vec<[u64; 3]>,
}

/// The bits of a position; 0 and -0 are the same place.
fn key(position: &Point3<f64>) -> [u64; 3] {
    [position.x, position.y, position.z].map(|c| (c + 0.0).to_bits())
}

/// A triangle in the least of its three rotations.
fn rotated<T: Ord + Copy>([a, b, c]: [T; 3]) -> [T; 3] {
    [a, b, c].min([b, c, a]).min([c, a, b])
}

impl Follower {
    /// Takes note of the surface now.
    pub fn step(&mut self, surface: &TriangleMesh) -> SurfaceChange {
        let mut change = SurfaceChange {
            first_vertex: self.next,
            ..SurfaceChange::default()
        };
        let mut numbers = FxHashMap::default();
        let mut triangles = Vec::with_capacity(surface.triangles.len());
        for triangle in &surface.triangles {
            triangles.push(rotated(triangle.map(|corner| {
                let position = &surface.positions[corner as usize];
                let key = key(position);
                *numbers.entry(key).or_insert_with(|| {
                    self.numbers.get(&key).copied().unwrap_or_else(|| {
                        change.vertices.push((*position).into());
                        self.next += 1;
                        self.next - 1
                    })
                })
            })));
        }
        triangles.sort_unstable();
        difference(&triangles, &self.triangles, &mut change.added);
        difference(&self.triangles, &triangles, &mut change.removed);
        self.numbers = numbers;
        self.triangles = triangles;
        change
    }
}

/// What the sorted list `these` holds more often than the sorted list `those`.
fn difference(these: &[[u64; 3]], those: &[[u64; 3]], rest: &mut Vec<[u64; 3]>) {
    let mut those = those.iter().peekable();
    for this in these {
        while those.next_if(|that| *that < this).is_some() {}
        if those.next_if(|that| *that == this).is_none() {
            rest.push(*this);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mesh(triangles: &[[u32; 3]], shift: f64) -> TriangleMesh {
        TriangleMesh {
            positions: (0..8)
                .map(|i| Point3::new(f64::from(i), 0.0, if i > 5 { shift } else { 0.0 }))
                .collect(),
            triangles: triangles.to_vec(),
            colors: None,
        }
    }

    proptest! {
        /// Whoever applies the changes has the surface.
        #[test]
        fn changes_add_up_to_the_surface(
            steps in prop::collection::vec(
                (prop::collection::vec(prop::array::uniform3(0_u32..8), 0..12), 0_u8..3), 1..6),
        ) {
            let mut follower = Follower::default();
            let (mut positions, mut triangles): (Vec<[f64; 3]>, Vec<[u64; 3]>) = (vec![], vec![]);
            for (faces, shift) in steps {
                let surface = mesh(&faces, f64::from(shift));
                let change = follower.step(&surface);
                prop_assert_eq!(change.first_vertex, positions.len() as u64);
                positions.extend(&change.vertices);
                for gone in &change.removed {
                    let at = triangles.iter().position(|t| t == gone);
                    prop_assert!(at.is_some());
                    triangles.swap_remove(at.unwrap());
                }
                triangles.extend(&change.added);
                let place = |t: &[u64; 3]| t.map(|v| positions[v as usize].map(f64::to_bits));
                let mut have: Vec<_> = triangles.iter().map(|t| rotated(place(t))).collect();
                let mut want: Vec<_> = faces
                    .iter()
                    .map(|t| rotated(t.map(|v| key(&surface.positions[v as usize]))))
                    .collect();
                have.sort_unstable();
                want.sort_unstable();
                prop_assert_eq!(have, want);
            }
        }
    }

    #[test]
    fn nothing_changes_where_nothing_does() {
        let mut follower = Follower::default();
        let first = follower.step(&mesh(&[[0, 1, 2], [2, 1, 3]], 0.0));
        assert_eq!((first.vertices.len(), first.added.len()), (4, 2));
        let again = follower.step(&mesh(&[[3, 2, 1], [1, 2, 0]], 0.0));
        assert_eq!(
            again,
            SurfaceChange {
                first_vertex: 4,
                ..SurfaceChange::default()
            }
        );
    }
}
