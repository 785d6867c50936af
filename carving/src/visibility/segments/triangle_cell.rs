//! Whether a triangle meets a cell, decided exactly on plain points.
//!
//! In the plane of the triangle the cell is a convex polygon, whose corners are the cell's own corners in the plane and
//! the points where edges of the cell pierce it. Two convex polygons are apart when, and only when, a line along an edge of
//! one of them separates them. A line along an edge of the polygon belongs to a facet of the cell, a line along an edge of the
//! triangle to two of its corners, so each test is the sign of an orientation: no point is ever computed. Most signs come from
//! numbers computed once for each corner ([`sides`]).

mod sides;

use crate::predicates::orient3d;
use crate::tetrahedralization::Tetrahedralization;

use sides::FacetPlane;
pub(super) use sides::{RelativePoint, Triangle};

const FACET: [[usize; 3]; 4] = Tetrahedralization::FACET;

/// What a closed triangle and a closed cell have in common.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Contact {
    /// Nothing.
    Apart,
    /// At most a part of the boundary of the cell. Also reported for some cells that are apart but near.
    Touches,
    /// A part of the triangle lies in the open interior.
    Meets,
}

/// How a triangle lies relative to a cell or a hull facet.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) struct Relation {
    pub(super) contact: Contact,
    /// No special position that might touch, except corners shared by the ends of the triangle and the cell.
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

/// The signs that occur on one line of separation.
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
    relative: [&'a RelativePoint; N],
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
    fn new(
        triangle: &'a Triangle<'a>,
        corners: [&'a [f64; 3]; N],
        relative: [&'a RelativePoint; N],
    ) -> Self {
        let [_, a, b] = triangle.corners;
        let mut is_generic = true;
        let mut above = [0.0; N];
        for k in 0..N {
            above[k] = relative[k].above;
            // An end of the triangle lies in its plane: no special position.
            is_generic &= above[k] != 0.0 || corners[k] == a || corners[k] == b;
        }
        Self {
            triangle,
            corners,
            relative,
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
    fn edge_sides(&mut self, i: usize) -> Sides {
        let mut sides = Sides::default();
        for k in 0..N {
            if self.above[k] == 0.0 {
                let Some(side) = self.corner_side(i, k) else {
                    continue;
                };
                sides.add(side);
            } else if self.above[k] > 0.0 {
                for l in 0..N {
                    if self.above[l] < 0.0 {
                        let high = (self.corners[k], self.relative[k]);
                        let side =
                            self.triangle
                                .pierced(i, high, (self.corners[l], self.relative[l]));
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

    /// The side of that line on which corner `k`, which is in the plane, lies; `None` when all corners are in the plane.
    fn corner_side(&mut self, i: usize, k: usize) -> Option<f64> {
        let apex = self.above.iter().position(|above| *above != 0.0)?;
        let (u, v) = (self.triangle.corners[i], self.triangle.corners[(i + 1) % 3]);
        let t = self.corners[k];
        if t == u || t == v {
            return Some(0.0);
        }
        let side = self
            .triangle
            .edge_side(i, self.relative[k])
            .unwrap_or_else(|| {
                // The orientation of u, v, t seen from a corner off the plane.
                let turn = orient3d(u, v, t, self.corners[apex]);
                if self.above[apex] > 0.0 { turn } else { -turn }
            });
        self.is_generic &= side != 0.0;
        Some(side)
    }

    /// Whether the triangle may touch the facet with these corners: neither its plane nor a line along one of its edges
    /// separates them.
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

    /// Tests the plane and the three edges of the triangle. `None` when one of them separates the two. Otherwise the contact,
    /// and whether the segment may cross the section: not when all of it lies strictly on the side of the triangle.
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
            let sides = self.edge_sides(edge);
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
    let relative = cell.map(|corner| triangle.relative(corner));
    relate_prepared_cell(triangle, cell, relative.each_ref())
}

/// The same with the [relative coordinates](Triangle::relative) of the corners.
pub(super) fn relate_prepared_cell(
    triangle: &Triangle<'_>,
    cell: [&[f64; 3]; 4],
    relative: [&RelativePoint; 4],
) -> Relation {
    let mut section = Section::new(triangle, cell, relative);
    let Some((mut contact, is_at_segment)) = section.contact() else {
        return APART;
    };
    let mut is_generic = section.is_generic;
    let touched = FACET.map(|facet| section.may_touch(facet));
    if is_generic && section.is_pierced() {
        // The triangle extends to both sides of an edge of the cell, so it meets the interior, wherever its corners lie.
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

/// Whether the triangle may enter the hull through the facet of a ghost cell: its centre is strictly outside, and neither its
/// plane nor its edges separate it from the facet.
pub(super) fn relate_ghost(triangle: &Triangle<'_>, facet: [&[f64; 3]; 3]) -> Relation {
    let [p, q, r] = facet;
    let outside = orient3d(p, q, r, triangle.corners[0]);
    if outside < 0.0 {
        return APART;
    }
    let relative = facet.map(|corner| triangle.relative(corner));
    let mut section = Section::new(triangle, facet, relative.each_ref());
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
