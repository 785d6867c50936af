//! Which cells a line segment crosses or touches, exact.
//!
//! The interior of a tetrahedron is where four linear functions, one per facet, are positive. Along the segment from
//! the target (t = 0) to the centre (t = 1) each is linear in t, so its signs at both ends say whether it is entered,
//! left, or neither, and the segment meets the interior when every entry comes before every exit. The order of
//! the line's crossings with two facet planes is the side on which it passes the edge that the two facets share.

use crate::predicates::orient3d;
use crate::tetrahedralization::Tetrahedralization;

const FACET: [[usize; 3]; 4] = Tetrahedralization::FACET;

/// Shared edge `(k, l)` of the facets opposite corners `i` and `j`, such that `(i, j, k, l)` is an even permutation.
const EDGE: [[[usize; 2]; 4]; 4] = [
    [[0, 0], [2, 3], [3, 1], [1, 2]],
    [[3, 2], [0, 0], [0, 3], [2, 0]],
    [[1, 3], [3, 0], [0, 0], [0, 1]],
    [[2, 1], [0, 2], [1, 0], [0, 0]],
];

/// A segment relative to one cell: signs at both ends of the four facet functions.
struct SegmentInCell<'a> {
    center: &'a [f64; 3],
    target: &'a [f64; 3],
    cell: [&'a [f64; 3]; 4],
    at_target: [f64; 4],
    at_center: [f64; 4],
}

impl<'a> SegmentInCell<'a> {
    fn new(center: &'a [f64; 3], target: &'a [f64; 3], cell: [&'a [f64; 3]; 4]) -> Self {
        let at = |end: &[f64; 3]| {
            FACET.map(|facet| {
                let [a, b, c] = facet.map(|k| cell[k]);
                // A corner is in the plane; the exact predicate has the same sign but is slow.
                if a == end || b == end || c == end {
                    0.0
                } else {
                    orient3d(a, b, c, end)
                }
            })
        };
        Self {
            center,
            target,
            cell,
            at_target: at(target),
            at_center: at(center),
        }
    }

    /// Sign of facet function `j` where the line, on its way from target to centre, crosses plane `i` inwards;
    /// negated where it crosses it outwards.
    fn order(&self, i: usize, j: usize) -> f64 {
        let [k, l] = EDGE[i][j].map(|k| self.cell[k]);
        -orient3d(self.target, self.center, k, l)
    }

    /// Whether the open segment meets the open interior.
    fn meets_interior(&self) -> bool {
        let hidden = (0..4).any(|i| self.at_target[i] <= 0.0 && self.at_center[i] <= 0.0);
        let enters = |i: usize| self.at_target[i] <= 0.0;
        let leaves = |j: usize| self.at_center[j] <= 0.0;
        !hidden
            && (0..4).filter(|&i| enters(i)).all(|i| {
                (0..4)
                    .filter(|&j| leaves(j))
                    .all(|j| self.order(i, j) > 0.0)
            })
    }

    /// Whether a part of the segment that is more than a point lies in the closed cell.
    fn overlaps(&self) -> bool {
        let flat = |i: usize| self.at_target[i] == 0.0 && self.at_center[i] == 0.0;
        let hidden =
            (0..4).any(|i| self.at_target[i] <= 0.0 && self.at_center[i] <= 0.0 && !flat(i));
        let enters = |i: usize| self.at_target[i] < 0.0;
        let leaves = |j: usize| self.at_center[j] < 0.0;
        !hidden
            && (0..4).filter(|&i| enters(i)).all(|i| {
                (0..4)
                    .filter(|&j| leaves(j))
                    .all(|j| self.order(i, j) > 0.0)
            })
    }

    /// Whether the closed segment meets the closed cell.
    fn touches(&self) -> bool {
        let hidden = (0..4).any(|i| self.at_target[i] < 0.0 && self.at_center[i] < 0.0);
        let enters = |i: usize| self.at_target[i] < 0.0;
        let leaves = |j: usize| self.at_center[j] < 0.0;
        !hidden
            && (0..4).filter(|&i| enters(i)).all(|i| {
                (0..4)
                    .filter(|&j| leaves(j))
                    .all(|j| self.order(i, j) >= 0.0)
            })
    }
}

/// Whether the open segment between `center` and `target` meets the open interior of a positively oriented cell.
pub fn crosses_cell(center: &[f64; 3], target: &[f64; 3], cell: [&[f64; 3]; 4]) -> bool {
    SegmentInCell::new(center, target, cell).meets_interior()
}

/// Whether `center` is strictly outside the hull facet (`orient3d(facet, center) > 0`) and the closed segment to
/// `target`, which is not strictly outside, meets the closed facet.
pub fn crosses_ghost(center: &[f64; 3], target: &[f64; 3], facet: [&[f64; 3]; 3]) -> bool {
    let [a, b, c] = facet;
    if orient3d(a, b, c, center) <= 0.0 {
        return false;
    }
    if facet.contains(&target) {
        return true;
    }
    // From centre to target the line pierces the plane from the side on which the facet turns counter-clockwise.
    let inside = |a, b| orient3d(target, center, a, b) >= 0.0;
    inside(a, b) && inside(b, c) && inside(c, a)
}

/// Where a ray leaves a cell on its way from its target to its centre.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Exit {
    /// Through the open interior of the facet opposite this corner.
    Through(usize),
    /// It does not: the closed cell holds the centre.
    AtCenter,
    /// Through an edge or a vertex; or the cell is a ghost.
    Elsewhere,
}

/// Where a ray leaves a positively oriented cell that it crosses.
pub(super) fn exit(center: &[f64; 3], target: &[f64; 3], cell: [&[f64; 3]; 4]) -> Exit {
    let segment = SegmentInCell::new(center, target, cell);
    if segment.at_center.iter().all(|&side| side >= 0.0) {
        return Exit::AtCenter;
    }
    let is_pierced = |i: usize| {
        let opposite_sides = segment.at_center[i] < 0.0 && segment.at_target[i] > 0.0;
        opposite_sides && (0..4).all(|j| j == i || segment.order(i, j) < 0.0)
    };
    (0..4)
        .find(|&i| is_pierced(i))
        .map_or(Exit::Elsewhere, Exit::Through)
}

/// What a closed segment and a closed cell have in common.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Relation {
    /// Nothing.
    Apart,
    /// One point, on the boundary.
    Touches,
    /// A part of the segment that runs inside a facet or along an edge.
    RunsInBoundary {
        /// Whether it runs in the closed facet opposite each corner.
        facets: [bool; 4],
    },
    /// A part of the segment in the open interior.
    Crosses,
}

/// How the closed segment and a positively oriented closed cell meet.
pub(super) fn relate(center: &[f64; 3], target: &[f64; 3], cell: [&[f64; 3]; 4]) -> Relation {
    let segment = SegmentInCell::new(center, target, cell);
    if !segment.touches() {
        Relation::Apart
    } else if segment.meets_interior() {
        Relation::Crosses
    } else if segment.overlaps() {
        // The segment is in the plane of such a facet, which has nothing but the facet in common with the cell.
        let is_flat = |i: usize| segment.at_target[i] == 0.0 && segment.at_center[i] == 0.0;
        let facets = [is_flat(0), is_flat(1), is_flat(2), is_flat(3)];
        Relation::RunsInBoundary { facets }
    } else {
        Relation::Touches
    }
}

#[cfg(test)]
mod tests;
