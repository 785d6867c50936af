//! Changes of the surface as replies report them.

use nalgebra::Point3;
use rustc_hash::{FxHashMap, FxHashSet};
use serde::Serialize;

use crate::map::SurfaceChange;

/// The difference between two surfaces.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct SurfaceDifference {
    /// Id of the first new vertex; ids are never reused.
    pub first_vertex: u64,
    /// Positions of the new vertices, in the frame of the poses.
    pub vertices: Vec<[f64; 3]>,
    /// New triangles by vertex ids, the smallest first, counter-clockwise seen from free space.
    pub added: Vec<[u64; 3]>,
    /// Removed triangles.
    pub removed: Vec<[u64; 3]>,
}

/// Marks a vertex of the map without id.
const NONE: u64 = u64::MAX;

/// Gives the vertices of a changing surface ids that are never reused, and reports its changes by them. A vertex that moves
/// gets a new id.
///
/// # Complexity
/// Linear in the change. When the map was made anew, linear in the surface.
#[derive(Debug, Default)]
pub struct SurfaceDiff {
    next: u64,
    /// Id and position of each vertex of the map's surface.
    vertices: Vec<(u64, Point3<f64>)>,
    triangles: FxHashSet<[u64; 3]>,
}

/// The bits of a position; 0 and -0 are equal.
fn key(position: &Point3<f64>) -> [u64; 3] {
    [position.x, position.y, position.z].map(|c| (c + 0.0).to_bits())
}

/// The rotation of a triangle with the smallest corner first.
fn smallest_first([a, b, c]: [u64; 3]) -> [u64; 3] {
    [a, b, c].min([b, c, a]).min([c, a, b])
}

impl SurfaceDiff {
    /// The difference that a change of the map's surface makes; `position` gives where its vertices are now.
    pub fn update(
        &mut self,
        change: &SurfaceChange,
        position: impl Fn(u32) -> Point3<f64>,
    ) -> SurfaceDifference {
        let mut difference = SurfaceDifference {
            first_vertex: self.next,
            ..SurfaceDifference::default()
        };
        let mut removed = FxHashSet::default();
        let mut known = FxHashMap::default();
        if change.is_anew {
            removed = std::mem::take(&mut self.triangles);
            known = self.forget();
        } else {
            for face in change.mesh.removed.iter().chain(&change.mesh.reshaped) {
                removed.insert(self.triangle(face));
            }
        }
        for &number in &change.mesh.freed {
            if let Some(vertex) = self.vertices.get_mut(number as usize) {
                vertex.0 = NONE;
            }
        }
        let capacity = change
            .mesh
            .placed
            .last()
            .map_or(0, |last| *last as usize + 1);
        if capacity > self.vertices.len() {
            self.vertices.resize(capacity, (NONE, Point3::origin()));
        }
        for &number in &change.mesh.placed {
            let position = position(number);
            let ids: Option<&mut Vec<u64>> = known.get_mut(&key(&position));
            let id = ids.and_then(Vec::pop).unwrap_or_else(|| {
                difference.vertices.push(position.into());
                self.next += 1;
                self.next - 1
            });
            self.vertices[number as usize] = (id, position);
        }
        for face in change.mesh.added.iter().chain(&change.mesh.reshaped) {
            let triangle = self.triangle(face);
            if !removed.remove(&triangle) {
                difference.added.push(triangle);
            }
            self.triangles.insert(triangle);
        }
        for triangle in &removed {
            self.triangles.remove(triangle);
        }
        difference.removed.extend(removed);
        difference.added.sort_unstable();
        difference.removed.sort_unstable();
        difference
    }

    /// Forgets the vertices of the map; returns their ids by position, the smallest last.
    fn forget(&mut self) -> FxHashMap<[u64; 3], Vec<u64>> {
        let mut vertices = std::mem::take(&mut self.vertices);
        vertices.sort_unstable_by_key(|(id, _)| std::cmp::Reverse(*id));
        let mut known: FxHashMap<[u64; 3], Vec<u64>> = FxHashMap::default();
        for (id, position) in vertices {
            if id != NONE {
                known.entry(key(&position)).or_default().push(id);
            }
        }
        known
    }

    /// The removal of everything.
    pub fn clear(&mut self) -> SurfaceDifference {
        self.vertices.clear();
        let mut removed: Vec<[u64; 3]> = self.triangles.drain().collect();
        removed.sort_unstable();
        SurfaceDifference {
            first_vertex: self.next,
            removed,
            ..SurfaceDifference::default()
        }
    }

    /// A face by the ids of its vertices.
    fn triangle(&self, face: &[u32; 3]) -> [u64; 3] {
        smallest_first(face.map(|number| self.vertices[number as usize].0))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::TestSurface;

    fn positions(shift: u8) -> Vec<Point3<f64>> {
        let shifted = |i: u8| if i > 5 { f64::from(shift) } else { 0.0 };
        (0..8)
            .map(|i| Point3::new(f64::from(i), 0.0, shifted(i)))
            .collect()
    }

    /// What a client holds.
    #[derive(Default)]
    struct Client {
        positions: Vec<[f64; 3]>,
        triangles: Vec<[u64; 3]>,
    }

    impl Client {
        fn apply(&mut self, difference: &SurfaceDifference) {
            assert_eq!(difference.first_vertex, self.positions.len() as u64);
            self.positions.extend(&difference.vertices);
            for gone in &difference.removed {
                let at = self.triangles.iter().position(|it| it == gone);
                self.triangles.swap_remove(at.unwrap());
            }
            self.triangles.extend(&difference.added);
        }

        /// The triangles by positions, sorted.
        fn surface(&self) -> Vec<[[u64; 3]; 3]> {
            let corner = |id: u64| self.positions[id as usize].map(f64::to_bits);
            let triangles = self.triangles.iter();
            let mut surface: Vec<_> = triangles.map(|t| rotated(t.map(corner))).collect();
            surface.sort_unstable();
            surface
        }
    }

    fn rotated<T: Ord + Copy>([a, b, c]: [T; 3]) -> [T; 3] {
        [a, b, c].min([b, c, a]).min([c, a, b])
    }

    fn face() -> impl Strategy<Value = [u32; 3]> {
        let three = prop::sample::subsequence((0..8).collect::<Vec<u32>>(), 3).prop_shuffle();
        three.prop_map(|corners| [corners[0], corners[1], corners[2]])
    }

    proptest! {
        /// Applying all changes gives the surface, also when the map was made anew.
        #[test]
        fn changes_add_up_to_the_surface(
            steps in prop::collection::vec(
                (prop::collection::vec(face(), 0..12), 0_u8..3, 0_u8..4), 1..8),
        ) {
            let mut diff = SurfaceDiff::default();
            let mut client = Client::default();
            let mut surface = TestSurface::default();
            for (faces, shift, anew) in steps {
                if anew == 0 {
                    surface = TestSurface::default();
                }
                let change = surface.change_to(&faces, &positions(shift));
                let difference = diff.update(&change, |number| surface.position(number));
                client.apply(&difference);
                let mut expected: Vec<_> = surface
                    .faces()
                    .map(|face| rotated(face.map(|number| key(&surface.position(number)))))
                    .collect();
                expected.sort_unstable();
                prop_assert_eq!(client.surface(), expected);
            }
            client.apply(&diff.clear());
            prop_assert!(client.triangles.is_empty());
        }
    }

    #[test]
    fn an_equal_surface_of_a_new_map_makes_no_difference() {
        let faces = [[0, 1, 2], [2, 1, 7]];
        let mut diff = SurfaceDiff::default();
        let mut surface = TestSurface::default();
        let change = surface.change_to(&faces, &positions(1));
        let first = diff.update(&change, |number| surface.position(number));
        assert_eq!((first.vertices.len(), first.added.len()), (4, 2));
        let mut again = TestSurface::default();
        let change = again.change_to(&faces, &positions(1));
        assert!(change.is_anew);
        assert_eq!(
            diff.update(&change, |number| again.position(number)),
            SurfaceDifference {
                first_vertex: 4,
                ..SurfaceDifference::default()
            }
        );
    }
}
