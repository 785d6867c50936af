//! Whether a triangle meets a cell, decided exactly on plain points.
//!
//! In the plane of the triangle the cell is a convex polygon, whose corners are the cell's own corners in the plane and
//! the points where edges of the cell pierce it. Two convex polygons are apart when, and only when, a line along an edge of
//! one of them parts them. A line along an edge of the polygon belongs to a facet of the cell, a line along an edge of the
//! triangle to two of its corners, so each test is the sign of an orientation: no point is ever computed.

use crate::predicates::orient3d;
use crate::tetrahedralization::Tetrahedralization;

const FACET: [[usize; 3]; 4] = Tetrahedralization::FACET;

/// What a closed triangle and a closed cell have in common.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Contact {
    /// Nothing.
    Apart,
    /// At most something on the boundary of the cell. May be reported of cells that are apart but near.
    Touches,
    /// A part of the triangle lies in the open interior.
    Meets,
}

/// How a triangle lies relative to a cell or a hull facet.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Relation {
    pub(super) contact: Contact,
    /// Nothing is in a special position that might touch, but for corners that the triangle's ends share with the cell.
    pub(super) is_generic: bool,
    /// Whether three corners of the cell lie in the plane of the triangle.
    pub(super) is_coplanar: bool,
    /// Whether the segment opposite the triangle's centre may run through the cell.
    pub(super) is_at_segment: bool,
    /// Facets of the cell, by the corners opposite them, that the triangle may touch.
    pub(super) touched: [bool; 4],
}

const APART: Relation = Relation {
    contact: Contact::Apart,
    is_generic: true,
    is_coplanar: false,
    is_at_segment: false,
    touched: [false; 4],
};

/// The edge of the triangle opposite its centre.
const SEGMENT: usize = 1;

/// Orders of signs on one line of separation.
#[derive(Default)]
struct Sides {
    negative: bool,
    zero: bool,
    positive: bool,
}

impl Sides {
    fn add(&mut self, side: f64) {
        self.negative |= side < 0.0;
        self.zero |= side == 0.0;
        self.positive |= side > 0.0;
    }
}

/// Corners of a cell or facet relative to the plane of a triangle.
struct Section<'a, const N: usize> {
    triangle: [&'a [f64; 3]; 3],
    corners: [&'a [f64; 3]; N],
    above: [f64; N],
    is_generic: bool,
    /// Per edge of the triangle, the edges of the cell that pierce the plane strictly beyond it, as [`bit`]s.
    beyond: [u16; 3],
}

/// A bit for the edge between two corners.
fn bit(k: usize, l: usize) -> u16 {
    1 << (4 * k.min(l) + k.max(l))
}

impl<'a, const N: usize> Section<'a, N> {
    /// Of corners on these sides of the plane; those of a corner that is an end of the triangle are not asked for.
    fn new(
        triangle: [&'a [f64; 3]; 3],
        corners: [&'a [f64; 3]; N],
        mut side: impl FnMut(usize) -> f64,
    ) -> Self {
        let [_, a, b] = triangle;
        let mut is_generic = true;
        let above = std::array::from_fn(|k| {
            if corners[k] == a || corners[k] == b {
                return 0.0;
            }
            let side = side(k);
            is_generic &= side != 0.0;
            side
        });
        Self {
            triangle,
            corners,
            above,
            is_generic,
            beyond: [0; 3],
        }
    }

    fn in_plane(&self) -> usize {
        self.above.iter().filter(|side| **side == 0.0).count()
    }

    /// On which sides of the line through corners `i` and `i + 1` of the triangle the section lies; positive is the side of
    /// the triangle.
    fn beyond_edge(&mut self, i: usize) -> Sides {
        let (u, v) = (self.triangle[i], self.triangle[(i + 1) % 3]);
        let mut sides = Sides::default();
        let apex = (0..N).find(|&k| self.above[k] != 0.0);
        for k in 0..N {
            let t = self.corners[k];
            if self.above[k] == 0.0 {
                // The turn of u, v, t as seen from a corner off the plane.
                let Some(apex) = apex else { continue };
                if t == u || t == v {
                    sides.add(0.0);
                    continue;
                }
                let turn = orient3d(u, v, t, self.corners[apex]);
                let side = if self.above[apex] > 0.0 { turn } else { -turn };
                self.is_generic &= side != 0.0;
                sides.add(side);
            } else if self.above[k] > 0.0 {
                for l in (0..N).filter(|&l| self.above[l] < 0.0) {
                    let side = orient3d(self.corners[l], t, u, v);
                    self.is_generic &= side != 0.0;
                    if side < 0.0 {
                        self.beyond[i] |= bit(k, l);
                    }
                    sides.add(side);
                }
            }
        }
        sides
    }

    /// Whether the triangle may touch the facet with these corners: neither its plane nor a line along one of its edges parts
    /// them.
    fn may_touch(&self, facet: [usize; 3]) -> bool {
        if facet.iter().any(|&k| self.above[k] == 0.0) {
            return true;
        }
        let [p, q, r] = facet;
        let pierced = [(p, q), (q, r), (r, p)]
            .into_iter()
            .filter(|&(k, l)| (self.above[k] > 0.0) != (self.above[l] > 0.0))
            .fold(0, |bits, (k, l)| bits | bit(k, l));
        pierced != 0 && self.beyond.iter().all(|beyond| pierced & !beyond != 0)
    }

    /// Tests the plane and the three edges of the triangle. `None` when one of them parts the two. Otherwise also whether the
    /// section lies strictly on the triangle's side of each edge.
    fn contact(&mut self) -> Option<(Contact, [bool; 3])> {
        let mut sides = Sides::default();
        for side in self.above {
            sides.add(side);
        }
        let pierced = sides.positive && sides.negative;
        if !sides.zero && !pierced {
            return None;
        }
        let mut meets = pierced;
        let mut within = [false; 3];
        for (edge, within) in within.iter_mut().enumerate() {
            let sides = self.beyond_edge(edge);
            if sides.negative && !sides.zero && !sides.positive {
                return None;
            }
            meets &= sides.positive;
            *within = sides.positive && !sides.zero && !sides.negative;
        }
        let contact = if meets {
            Contact::Meets
        } else {
            Contact::Touches
        };
        Some((contact, within))
    }
}

/// How the closed triangle of `center`, `a` and `b`, which are not on one line, and a positively oriented cell meet.
pub(super) fn relate_cell(triangle: [&[f64; 3]; 3], cell: [&[f64; 3]; 4]) -> Relation {
    relate_cell_beside(triangle, cell, side_of(triangle, cell))
}

/// On which side of a triangle's plane each corner lies.
fn side_of<const N: usize>(
    [center, a, b]: [&[f64; 3]; 3],
    corners: [&[f64; 3]; N],
) -> impl Fn(usize) -> f64 {
    move |k| orient3d(center, a, b, corners[k])
}

/// The same when the sides of the plane on which the corners lie are known: each that of `orient3d(center, a, b, corner)`.
pub(super) fn relate_cell_beside(
    triangle: [&[f64; 3]; 3],
    cell: [&[f64; 3]; 4],
    side: impl FnMut(usize) -> f64,
) -> Relation {
    let mut section = Section::new(triangle, cell, side);
    let Some((mut contact, within)) = section.contact() else {
        return APART;
    };
    let mut is_generic = section.is_generic;
    let touched = FACET.map(|facet| section.may_touch(facet));
    if is_generic && within == [true; 3] && section.in_plane() == 0 {
        // The section is in the interior of the triangle: nothing of the triangle's boundary is near the cell.
        return Relation {
            contact,
            is_generic,
            is_coplanar: false,
            is_at_segment: false,
            touched,
        };
    }
    for facet in FACET {
        let [p, q, r] = facet.map(|k| cell[k]);
        let mut sides = Sides::default();
        for corner in triangle {
            if corner == p || corner == q || corner == r {
                is_generic &= corner != triangle[0];
                sides.add(0.0);
            } else {
                let side = orient3d(p, q, r, corner);
                is_generic &= side != 0.0;
                sides.add(side);
            }
        }
        if sides.negative && !sides.zero && !sides.positive {
            return APART;
        }
        if !sides.positive {
            contact = Contact::Touches;
        }
    }
    Relation {
        contact,
        is_generic,
        is_coplanar: section.in_plane() >= 3,
        is_at_segment: !within[SEGMENT],
        touched,
    }
}

/// Whether the triangle may enter the hull through the facet of a ghost cell: its centre is strictly outside, and plane and
/// edges of the triangle do not part it from the facet.
pub(super) fn relate_ghost(triangle: [&[f64; 3]; 3], facet: [&[f64; 3]; 3]) -> Relation {
    let [p, q, r] = facet;
    let outside = orient3d(p, q, r, triangle[0]);
    if outside < 0.0 {
        return APART;
    }
    let mut section = Section::new(triangle, facet, side_of(triangle, facet));
    if section.contact().is_none() {
        return APART;
    }
    Relation {
        is_at_segment: false,
        touched: [false; 4],
        contact: if outside > 0.0 {
            Contact::Touches
        } else {
            Contact::Apart
        },
        is_generic: section.is_generic && outside != 0.0,
        is_coplanar: section.in_plane() >= 3,
    }
}

/// Whether the closed triangle of `center`, `a` and `b` meets the open interior of a positively oriented cell. A triangle
/// without area meets nothing.
pub fn triangle_meets_cell(triangle: [&[f64; 3]; 3], cell: [&[f64; 3]; 4]) -> bool {
    let [center, a, b] = triangle;
    !crate::predicates::are_collinear(center, a, b)
        && relate_cell(triangle, cell).contact == Contact::Meets
}

#[cfg(test)]
mod tests;
