//! Differences between successive surfaces.

use nalgebra::Point3;
use rustc_hash::FxHashMap;
use serde::Serialize;

use linecarve_mesh::TriangleMesh;

/// The difference between two surfaces.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SurfaceChange {
    /// Id of the first new vertex; ids are never reused.
    pub first_vertex: u64,
    /// Positions of the new vertices, in the frame of the poses.
    pub vertices: Vec<[f64; 3]>,
    /// New triangles by vertex ids, the smallest first, counter-clockwise seen from free space.
    pub added: Vec<[u64; 3]>,
    /// Removed triangles.
    pub removed: Vec<[u64; 3]>,
}

/// Assigns ids to the vertices of a changing surface, and finds its added and removed triangles.
///
/// Vertices are identified by position and keep their id while a triangle uses them. Vertices at the same position, as
/// manifold repair creates them, share an id.
///
/// # Complexity
/// Linear in the size of the surface at each update.
#[derive(Debug, Default)]
pub struct SurfaceDiff {
    numbers: FxHashMap<[u64; 3], u64>,
    next: u64,
    /// Sorted.
    triangles: Vec<[u64; 3]>,
}

/// The bits of a position; 0 and -0 are equal.
fn key(position: &Point3<f64>) -> [u64; 3] {
    [position.x, position.y, position.z].map(|c| (c + 0.0).to_bits())
}

/// The lexicographically smallest rotation of a triangle.
fn rotated<T: Ord + Copy>([a, b, c]: [T; 3]) -> [T; 3] {
    [a, b, c].min([b, c, a]).min([c, a, b])
}

impl SurfaceDiff {
    /// Difference from the previous surface to this one.
    pub fn update(&mut self, surface: &TriangleMesh) -> SurfaceChange {
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

/// Multiset difference of sorted lists.
fn difference(these: &[[u64; 3]], those: &[[u64; 3]], difference: &mut Vec<[u64; 3]>) {
    let mut those = those.iter().peekable();
    for this in these {
        while those.next_if(|that| *that < this).is_some() {}
        if those.next_if(|that| *that == this).is_none() {
            difference.push(*this);
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
        /// Applying all changes gives the surface.
        #[test]
        fn changes_add_up_to_the_surface(
            steps in prop::collection::vec(
                (prop::collection::vec(prop::array::uniform3(0_u32..8), 0..12), 0_u8..3), 1..6),
        ) {
            let mut diff = SurfaceDiff::default();
            let (mut positions, mut triangles): (Vec<[f64; 3]>, Vec<[u64; 3]>) = (vec![], vec![]);
            for (faces, shift) in steps {
                let surface = mesh(&faces, f64::from(shift));
                let change = diff.update(&surface);
                prop_assert_eq!(change.first_vertex, positions.len() as u64);
                positions.extend(&change.vertices);
                for gone in &change.removed {
                    let at = triangles.iter().position(|t| t == gone);
                    prop_assert!(at.is_some());
                    triangles.swap_remove(at.unwrap());
                }
                triangles.extend(&change.added);
                let positions_of = |t: &[u64; 3]| t.map(|v| positions[v as usize].map(f64::to_bits));
                let mut have: Vec<_> = triangles.iter().map(|t| rotated(positions_of(t))).collect();
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
    fn equal_surfaces_have_no_difference() {
        let mut diff = SurfaceDiff::default();
        let first = diff.update(&mesh(&[[0, 1, 2], [2, 1, 3]], 0.0));
        assert_eq!((first.vertices.len(), first.added.len()), (4, 2));
        let again = diff.update(&mesh(&[[3, 2, 1], [1, 2, 0]], 0.0));
        assert_eq!(
            again,
            SurfaceChange {
                first_vertex: 4,
                ..SurfaceChange::default()
            }
        );
    }
}
