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
}

const APART: Relation = Relation {
    contact: Contact::Apart,
    is_generic: true,
    is_coplanar: false,
};

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
}

impl<'a, const N: usize> Section<'a, N> {
    fn new(triangle: [&'a [f64; 3]; 3], corners: [&'a [f64; 3]; N]) -> Self {
        let [center, a, b] = triangle;
        let mut is_generic = true;
        let above = corners.map(|corner| {
            if corner == a || corner == b {
                return 0.0;
            }
            let side = orient3d(center, a, b, corner);
            is_generic &= side != 0.0;
            side
        });
        Self {
            triangle,
            corners,
            above,
            is_generic,
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
                    sides.add(side);
                }
            }
        }
        sides
    }

    /// Tests the plane and the three edges of the triangle. `None` when one of them parts the two.
    fn contact(&mut self) -> Option<Contact> {
        let mut sides = Sides::default();
        for side in self.above {
            sides.add(side);
        }
        let pierced = sides.positive && sides.negative;
        if !sides.zero && !pierced {
            return None;
        }
        let mut meets = pierced;
        for edge in 0..3 {
            let sides = self.beyond_edge(edge);
            if sides.negative && !sides.zero && !sides.positive {
                return None;
            }
            meets &= sides.positive;
        }
        Some(if meets {
            Contact::Meets
        } else {
            Contact::Touches
        })
    }
}

/// How the closed triangle of `center`, `a` and `b`, which are not on one line, and a positively oriented cell meet.
pub(super) fn relate_cell(triangle: [&[f64; 3]; 3], cell: [&[f64; 3]; 4]) -> Relation {
    let mut section = Section::new(triangle, cell);
    let Some(mut contact) = section.contact() else {
        return APART;
    };
    let mut is_generic = section.is_generic;
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
    let mut section = Section::new(triangle, facet);
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
