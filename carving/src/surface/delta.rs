//! The change of the surface by one update.

use crate::tetrahedralization::VertexId;

/// Corners of a surface triangle, counter-clockwise seen from free space, the smallest id first.
pub type Triangle = [VertexId; 3];

/// The change of a surface by one update; its size and cost follow the change, not the size of the surface.
///
/// To follow the surface: delete `removed`, update the positions of `moved`, insert `added`. A vertex id that is not a
/// corner of the surface any more may be given to another vertex later.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct SurfaceDelta {
    /// Triangles that are new, in lexicographic order.
    pub added: Vec<Triangle>,
    /// Triangles that are gone, in lexicographic order; none of them is among the added.
    pub removed: Vec<Triangle>,
    /// Vertices whose id existed before at another position, in increasing order.
    pub moved: Vec<VertexId>,
    /// With [`Hull::Drop`](super::Hull::Drop), corners of hull facets that came or went, in increasing order. At a border
    /// there, triangles may have become neighbours or ceased to be, though none of them changed.
    pub border: Vec<VertexId>,
}

impl SurfaceDelta {
    /// Whether nothing changed.
    pub fn is_empty(&self) -> bool {
        self.added.is_empty() && self.removed.is_empty() && self.moved.is_empty()
    }

    /// Sorts both lists of triangles and drops what was removed and added again.
    pub(super) fn normalize(&mut self) {
        self.added.sort_unstable();
        self.removed.sort_unstable();
        let (mut i, mut j) = (0, 0);
        let (mut keep_i, mut keep_j) = (0, 0);
        while i < self.added.len() || j < self.removed.len() {
            let order = match (self.added.get(i), self.removed.get(j)) {
                (Some(a), Some(r)) => a.cmp(r),
                (Some(_), None) => std::cmp::Ordering::Less,
                _ => std::cmp::Ordering::Greater,
            };
            match order {
                std::cmp::Ordering::Less => {
                    self.added[keep_i] = self.added[i];
                    (keep_i, i) = (keep_i + 1, i + 1);
                }
                std::cmp::Ordering::Greater => {
                    self.removed[keep_j] = self.removed[j];
                    (keep_j, j) = (keep_j + 1, j + 1);
                }
                std::cmp::Ordering::Equal => {
                    (i, j) = (i + 1, j + 1);
                }
            }
        }
        self.added.truncate(keep_i);
        self.removed.truncate(keep_j);
    }
}

/// The same triangle with the smallest corner first.
pub fn rotate_smallest_first<T: Copy + Ord>([a, b, c]: [T; 3]) -> [T; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_and_comes_back_is_no_change() {
        let t = |a, b, c| [a, b, c].map(VertexId::from_index);
        let mut delta = SurfaceDelta {
            added: vec![t(3, 4, 5), t(0, 1, 2), t(0, 2, 1), t(1, 2, 3)],
            removed: vec![t(1, 2, 3), t(0, 1, 2), t(0, 1, 9)],
            ..SurfaceDelta::default()
        };
        delta.normalize();
        assert_eq!(delta.added, [t(0, 2, 1), t(3, 4, 5)]);
        assert_eq!(delta.removed, [t(0, 1, 9)]);
    }

    #[test]
    fn rotation_keeps_the_winding() {
        for t in [[1, 2, 3], [2, 3, 1], [3, 1, 2]] {
            assert_eq!(rotate_smallest_first(t), [1, 2, 3]);
        }
        assert_eq!(rotate_smallest_first([3, 2, 1]), [1, 3, 2]);
    }
}
