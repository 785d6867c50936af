//! How far a surface turns at an edge.

use std::f64::consts::FRAC_PI_2;

use nalgebra::Vector3;

/// Where more triangles meet at an edge than this, it is one without a look at their angles.
const MOST_SIDES: usize = 16;

/// A triangle beside an edge.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    /// Twice its area along its normal.
    pub(super) doubled_area: Vector3<f64>,
    /// Whether it runs through the edge from the first end to the second.
    pub(super) is_forward: bool,
}

impl Side {
    /// Square to the edge and to the way from it into the triangle, the same for either orientation.
    fn across(&self) -> Vector3<f64> {
        if self.is_forward {
            self.doubled_area
        } else {
            -self.doubled_area
        }
    }
}

/// How far the surface turns at an edge of a length between the triangles beside it, in radians: 0 where it goes on straight, and where
/// triangles are too thin to say, or stand out of each other's plane by less than a height.
///
/// Where more than two triangles meet, each goes on in the one that it turns to least of those that run through the edge the other way,
/// and the largest turn counts.
///
/// The sides that say nothing are taken out of the list.
pub(super) fn turn(sides: &mut Vec<Side>, length: f64, min_height: f64) -> f64 {
    // Thinner triangles turn for no reason. Also false for what is not a number.
    sides.retain(|side| side.doubled_area.norm() > min_height * length);
    if sides.len() > MOST_SIDES {
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
    let turn = a.cross(&b).norm().atan2(a.dot(&b));
    // How far either side stands out of the plane of the other.
    let height = a.norm().min(b.norm()) / length;
    if height * turn.min(FRAC_PI_2).sin() < min_height {
        0.0
    } else {
        turn
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
        turn(&mut sides.to_vec(), 1.0, 0.001).to_degrees()
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
