//! Whether a triangle meets a cell, decided exactly on plain points.
//!
//! In the plane of the triangle the cell is a convex polygon, whose corners are the cell's own corners in the plane and
//! the points where edges of the cell pierce it. Two convex polygons are apart when, and only when, a line along an edge of
//! one of them parts them. A line along an edge of the polygon belongs to a facet of the cell, a line along an edge of the
//! triangle to two of its corners, so each test is the sign of an orientation: no point is ever computed. Most signs come from
//! numbers that the triangle has for each corner once ([`sides`]).

mod sides;

use crate::predicates::orient3d;
use crate::tetrahedralization::Tetrahedralization;

use sides::FacetPlane;
pub(super) use sides::{Seen, Triangle};

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
    triangle: &'a Triangle<'a>,
    corners: [&'a [f64; 3]; N],
    seen: [&'a Seen; N],
    above: [f64; N],
    is_generic: bool,
    /// Edges of the cell that pierce the plane, as [`bit`]s.
    pierced: u16,
    /// Per edge of the triangle, those that do so strictly beyond it.
    beyond: [u16; 3],
}

/// A bit for the edge between two corners.
fn bit(k: usize, l: usize) -> u16 {
    1 << (4 * k.min(l) + k.max(l))
}

impl<'a, const N: usize> Section<'a, N> {
    fn new(triangle: &'a Triangle<'a>, corners: [&'a [f64; 3]; N], seen: [&'a Seen; N]) -> Self {
        let [_, a, b] = triangle.corners;
        let mut is_generic = true;
        let mut above = [0.0; N];
        for k in 0..N {
            above[k] = seen[k].above;
            // An end of the triangle in its plane is nothing special.
            is_generic &= above[k] != 0.0 || corners[k] == a || corners[k] == b;
        }
        Self {
            triangle,
            corners,
            seen,
            above,
            is_generic,
            pierced: 0,
            beyond: [0; 3],
        }
    }

    fn in_plane(&self) -> usize {
        self.above.iter().filter(|side| **side == 0.0).count()
    }

    /// On which sides of the line through corners `i` and `i + 1` of the triangle the section lies; positive is the side of
    /// the triangle.
    fn beyond_edge(&mut self, i: usize) -> Sides {
        let mut sides = Sides::default();
        for k in 0..N {
            if self.above[k] == 0.0 {
                let Some(side) = self.beside_edge(i, k) else {
                    continue;
                };
                sides.add(side);
            } else if self.above[k] > 0.0 {
                for l in 0..N {
                    if self.above[l] < 0.0 {
                        let high = (self.corners[k], self.seen[k]);
                        let side = self
                            .triangle
                            .pierced(i, high, (self.corners[l], self.seen[l]));
                        self.is_generic &= side != 0.0;
                        self.pierced |= bit(k, l);
                        if side < 0.0 {
                            self.beyond[i] |= bit(k, l);
                        }
                        sides.add(side);
                    }
                }
            }
        }
        sides
    }

    /// The side of that line on which corner `k` lies, which is in the plane; `None` when all are.
    fn beside_edge(&mut self, i: usize, k: usize) -> Option<f64> {
        let apex = self.above.iter().position(|above| *above != 0.0)?;
        let (u, v) = (self.triangle.corners[i], self.triangle.corners[(i + 1) % 3]);
        let t = self.corners[k];
        if t == u || t == v {
            return Some(0.0);
        }
        let side = self.triangle.beside(i, self.seen[k]).unwrap_or_else(|| {
            // The turn of u, v, t as seen from a corner off the plane.
            let turn = orient3d(u, v, t, self.corners[apex]);
            if self.above[apex] > 0.0 { turn } else { -turn }
        });
        self.is_generic &= side != 0.0;
        Some(side)
    }

    /// Whether the triangle may touch the facet with these corners: neither its plane nor a line along one of its edges parts
    /// them.
    fn may_touch(&self, facet: [usize; 3]) -> bool {
        if facet.iter().any(|&k| self.above[k] == 0.0) {
            return true;
        }
        let [p, q, r] = facet;
        let pierced = self.pierced & (bit(p, q) | bit(q, r) | bit(r, p));
        pierced != 0 && self.beyond.iter().all(|beyond| pierced & !beyond != 0)
    }

    /// Whether an edge of the cell pierces the triangle, of a section in general position.
    fn is_pierced(&self) -> bool {
        let [first, second, third] = self.beyond;
        self.pierced & !(first | second | third) != 0
    }

    /// Tests the plane and the three edges of the triangle. `None` when one of them parts the two. Otherwise also whether the
    /// segment may run through the section: not when all of it lies strictly on the triangle's side.
    fn contact(&mut self) -> Option<(Contact, bool)> {
        let mut sides = Sides::default();
        for side in self.above {
            sides.add(side);
        }
        let pierced = sides.positive && sides.negative;
        if !sides.zero && !pierced {
            return None;
        }
        let mut meets = pierced;
        let mut is_at_segment = true;
        for edge in 0..3 {
            let sides = self.beyond_edge(edge);
            if sides.negative && !sides.zero && !sides.positive {
                return None;
            }
            meets &= sides.positive;
            if edge == SEGMENT {
                is_at_segment = sides.zero || sides.negative || !sides.positive;
            }
        }
        let contact = if meets {
            Contact::Meets
        } else {
            Contact::Touches
        };
        Some((contact, is_at_segment))
    }
}

/// How a closed triangle, whose corners are not on one line, and a positively oriented cell meet.
pub(super) fn relate_cell(triangle: &Triangle<'_>, cell: [&[f64; 3]; 4]) -> Relation {
    let seen = cell.map(|corner| triangle.see(corner));
    relate_seen_cell(triangle, cell, seen.each_ref())
}

/// The same when the triangle has [seen](Triangle::see) the corners.
pub(super) fn relate_seen_cell(
    triangle: &Triangle<'_>,
    cell: [&[f64; 3]; 4],
    seen: [&Seen; 4],
) -> Relation {
    let mut section = Section::new(triangle, cell, seen);
    let Some((mut contact, is_at_segment)) = section.contact() else {
        return APART;
    };
    let mut is_generic = section.is_generic;
    let touched = FACET.map(|facet| section.may_touch(facet));
    if is_generic && section.is_pierced() {
        // The triangle goes on on both sides of an edge of the cell. Where a corner of it lies in the plane of a facet besides, the
        // interior on either side is met or not regardless.
        return Relation {
            contact: Contact::Meets,
            is_generic,
            is_coplanar: false,
            is_at_segment,
            touched,
        };
    }
    for facet in FACET {
        let [p, q, r] = facet.map(|k| cell[k]);
        let plane = FacetPlane::new([p, q, r]);
        let mut sides = Sides::default();
        for (k, corner) in triangle.corners.into_iter().enumerate() {
            if corner == p || corner == q || corner == r {
                is_generic &= k != 0;
                sides.add(0.0);
            } else {
                let side = plane.side(corner);
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
        is_at_segment,
        touched,
    }
}

/// Whether the triangle may enter the hull through the facet of a ghost cell: its centre is strictly outside, and plane and
/// edges of the triangle do not part it from the facet.
pub(super) fn relate_ghost(triangle: &Triangle<'_>, facet: [&[f64; 3]; 3]) -> Relation {
    let [p, q, r] = facet;
    let outside = orient3d(p, q, r, triangle.corners[0]);
    if outside < 0.0 {
        return APART;
    }
    let seen = facet.map(|corner| triangle.see(corner));
    let mut section = Section::new(triangle, facet, seen.each_ref());
    if section.contact().is_none() {
        return APART;
    }
    Relation {
        contact: if outside > 0.0 {
            Contact::Touches
        } else {
            Contact::Apart
        },
        is_generic: section.is_generic && outside != 0.0,
        is_coplanar: section.in_plane() >= 3,
        ..APART
    }
}

/// Whether the closed triangle of `center`, `a` and `b` meets the open interior of a positively oriented cell. A triangle
/// without area meets nothing.
pub fn triangle_meets_cell(triangle: [&[f64; 3]; 3], cell: [&[f64; 3]; 4]) -> bool {
    let [center, a, b] = triangle;
    !crate::predicates::are_collinear(center, a, b)
        && relate_cell(&Triangle::new(triangle), cell).contact == Contact::Meets
}

#[cfg(test)]
mod tests;
