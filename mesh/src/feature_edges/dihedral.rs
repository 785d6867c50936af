//! The dihedral angle at an edge, measured between normals: 0 where the surface is flat.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;

/// Edges with more triangles are always creases; their angles are not evaluated.
const MAX_SIDES: usize = 16;

/// A triangle at an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    /// Twice its area along its normal.
    pub(super) doubled_area: Vector3<f64>,
    /// Whether its orientation runs along the edge from the first end to the second.
    pub(super) is_forward: bool,
}

impl Side {
    /// The normal of the triangle with a consistent orientation relative to the edge.
    fn across(&self) -> Vector3<f64> {
        if self.is_forward {
            self.doubled_area
        } else {
            -self.doubled_area
        }
    }
}

/// The angle between the normals of the triangles at an edge of the given length, in radians. It is 0 where the
/// triangles are too thin to have a normal, or stand out of each other's plane by less than `min_height`.
///
/// Where more than two triangles meet, each continues in the oppositely oriented one at the smallest angle, and the
/// largest of these angles counts.
///
/// Triangles that are too thin are removed from `sides`.
pub(super) fn dihedral_angle(sides: &mut Vec<Side>, length: f64, min_height: f64) -> f64 {
    // Normals of thinner triangles are noise. Also false for NaN.
    sides.retain(|side| side.doubled_area.norm() > min_height * length);
    if sides.len() > MAX_SIDES {
        return std::f64::consts::PI;
    }
    let is_pair = sides.len() == 2;
    let mut largest = 0.0_f64;
    for (index, side) in sides.iter().enumerate() {
        let others = sides.iter().enumerate().filter(|(other, goes_on)| {
            *other != index && (is_pair || goes_on.is_forward != side.is_forward)
        });
        let least = others
            .map(|(_, other)| between(side, other, length, min_height))
            .min_by(f64::total_cmp);
        largest = largest.max(least.unwrap_or(0.0));
    }
    largest
}

fn between(side: &Side, other: &Side, length: f64, min_height: f64) -> f64 {
    let (a, b) = (side.across(), -other.across());
    let angle = a.cross(&b).norm().atan2(a.dot(&b));
    // Height of either triangle above the plane of the other.
    let height = a.norm().min(b.norm()) / length;
    if height * angle.min(FRAC_PI_2).sin() < min_height {
        0.0
    } else {
        angle
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A triangle of height 1 beside an edge of length 1 along z, at an angle around it.
    fn side(angle_deg: f64, is_forward: bool) -> Side {
        let (sine, cosine) = angle_deg.to_radians().sin_cos();
        let across = Vector3::z().cross(&Vector3::new(cosine, sine, 0.0));
        Side {
            doubled_area: if is_forward { across } else { -across },
            is_forward,
        }
    }

    fn degrees(sides: &[Side]) -> f64 {
        dihedral_angle(&mut sides.to_vec(), 1.0, 0.001).to_degrees()
    }

    #[test]
    fn two_sides_turn_as_they_stand_whatever_their_orientation() {
        for (angle, expected) in [(180.0, 0.0), (160.0, 20.0), (270.0, 90.0), (1.0, 179.0)] {
            for is_forward in [true, false] {
                let found = degrees(&[side(0.0, true), side(angle, is_forward)]);
                assert!((found - expected).abs() < 1e-9, "{angle}: {found}");
            }
        }
    }

    #[test]
    fn where_two_solids_touch_in_an_edge_both_turn() {
        // Two boxes, edge to edge: their sides lie in two planes that cross, and belong to four walls.
        let boxes = [(180.0, true), (270.0, false), (0.0, true), (90.0, false)];
        assert!((degrees(&boxes.map(|(a, f)| side(a, f))) - 90.0).abs() < 1e-9);
        // The same sides as two sheets that cross do not turn.
        let sheets = [(180.0, true), (270.0, true), (0.0, false), (90.0, false)];
        assert!(degrees(&sheets.map(|(a, f)| side(a, f))) < 1e-9);
    }

    #[test]
    fn thin_triangles_and_small_steps_say_nothing() {
        let thin = Side {
            doubled_area: side(90.0, false).doubled_area * 1e-4,
            is_forward: false,
        };
        assert_eq!(degrees(&[side(0.0, true), thin]), 0.0);
        assert_eq!(degrees(&[side(0.0, true), side(180.03, false)]), 0.0);
        assert_eq!(degrees(&[side(0.0, true)]), 0.0);
        assert_eq!(degrees(&[]), 0.0);
        let broken = Side {
            doubled_area: Vector3::new(f64::NAN, 0.0, 0.0),
            is_forward: false,
        };
        assert_eq!(degrees(&[side(0.0, true), broken]), 0.0);
    }

    #[test]
    fn a_book_of_many_pages_is_an_edge_at_once() {
        let pages: Vec<Side> = (0..100_000)
            .map(|page| side(f64::from(page) * 0.0036, page % 2 == 0))
            .collect();
        assert!((degrees(&pages) - 180.0).abs() < 1e-9);
    }
}
