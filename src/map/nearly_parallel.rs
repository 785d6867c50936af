//! What runs beside something that the map has, and tells nothing new.

use linecarve_carving::{Carver, ViewId};
use nalgebra::{Point3, Vector3};

/// Whether a place lies nearer than `reach` to a stretch between two others.
pub(super) fn is_near_segment(
    place: &Point3<f64>,
    [from, to]: [&Point3<f64>; 2],
    reach: f64,
) -> bool {
    let along = to - from;
    let share = (place - from).dot(&along) / along.norm_squared();
    let nearest = from + share.clamp(0.0, 1.0) * along;
    (place - nearest).norm_squared() < reach * reach
}

/// Two stretches from one point run the same way when they part by less than this (20 degrees).
const LEAST_COSINE: f64 = 0.94;

/// Which views have triangles to stretches between landmarks.
///
/// Keyframes end and divide one segment at places of their own, so that the same pair of landmarks seldom comes again. A stretch
/// is known from a place where, at both of its ends, a view beside that place has a triangle to a stretch the same way.
#[derive(Debug, Default)]
pub(super) struct SegmentViews {
    /// Tangent of the angle that the cameras keep, as seen from an end.
    least_tangent: f64,
    /// Of each landmark: the views with a triangle that ends there, and the direction of its stretch from there.
    at: Vec<Vec<(ViewId, Vector3<f64>)>>,
}

impl SegmentViews {
    /// None yet; of cameras less than this angle beside each other only the first gets one. 0 for all.
    pub(super) fn new(least_angle_deg: f64) -> Self {
        Self {
            least_tangent: least_angle_deg.to_radians().tan(),
            at: Vec::new(),
        }
    }

    /// Notes the triangle of a view to the stretch between two landmarks, unless one beside it is known. Whether it tells something new.
    ///
    /// # Complexity
    /// The triangles that end in the two landmarks.
    pub(super) fn note(
        &mut self,
        carver: &Carver,
        view: ViewId,
        center: &Point3<f64>,
        ends: [(u32, Point3<f64>); 2],
    ) -> bool {
        let [(_, a), (_, b)] = ends;
        let Some(along) = (b - a).try_normalize(0.0) else {
            return true;
        };
        let ways = [along, -along];
        let is_known = ends.iter().zip(&ways).all(|((landmark, end), way)| {
            let reach = self.least_tangent * (end - center).norm();
            let known = self.at.get(*landmark as usize);
            known.into_iter().flatten().any(|(view, known)| {
                known.dot(way) > LEAST_COSINE
                    && carver
                        .view(*view)
                        .is_some_and(|other| is_near_segment(center, [end, &other], reach))
            })
        });
        if is_known {
            return false;
        }
        for ((landmark, _), way) in ends.into_iter().zip(ways) {
            let needed = landmark as usize + 1;
            self.at.resize_with(needed.max(self.at.len()), Vec::new);
            self.at[landmark as usize].push((view, way));
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A landmark with its place.
    type End = (u32, [f64; 3]);

    /// Whether each of some triangles, by its centre and its ends, is noted.
    fn noted(least_angle_deg: f64, triangles: &[([f64; 3], [End; 2])]) -> Vec<bool> {
        let mut carver = Carver::default();
        let mut known = SegmentViews::new(least_angle_deg);
        let note = |(center, ends): &([f64; 3], [End; 2])| {
            let center = Point3::from(*center);
            let mut transaction = carver.transaction();
            let view = transaction.add_view(center).unwrap();
            transaction.commit().unwrap();
            let ends = ends.map(|(landmark, place)| (landmark, Point3::from(place)));
            known.note(&carver, view, &center, ends)
        };
        triangles.iter().map(note).collect()
    }

    /// Two metres before the origin.
    const A: End = (0, [-1.0, 0.0, 2.0]);
    const B: End = (1, [1.0, 0.0, 2.0]);
    const C: End = (7, [2.0, 0.02, 2.0]);

    #[test]
    fn a_camera_beside_one_with_a_triangle_gets_none() {
        // Fifteen degrees at some 2.2 m are 0.6 m.
        let beside = noted(
            15.0,
            &[
                ([0.0; 3], [A, B]),
                ([0.3, 0.0, 0.0], [A, B]),
                ([0.3, 0.0, 0.0], [B, A]),
                ([0.0, 1.0, 0.0], [A, B]),
            ],
        );
        assert_eq!(beside, [true, false, false, true]);
    }

    #[test]
    fn stretches_that_together_cover_another_do() {
        // From A by B to C; then the whole, which begins and ends as they do.
        let whole = noted(
            15.0,
            &[
                ([0.0; 3], [A, B]),
                ([0.0; 3], [B, C]),
                ([0.1, 0.0, 0.0], [A, C]),
            ],
        );
        assert_eq!(whole, [true, true, false]);
        // Across at an end, and away from one, is another stretch.
        let across = (1, [-1.0, 1.0, 2.0]);
        let other = noted(
            15.0,
            &[
                ([0.0; 3], [A, B]),
                ([0.0; 3], [A, across]),
                ([0.0; 3], [B, C]),
            ],
        );
        assert_eq!(other, [true; 3]);
    }

    #[test]
    fn every_one_at_no_angle_and_at_one_place() {
        assert_eq!(
            noted(0.0, &[([0.0; 3], [A, B]), ([0.0; 3], [A, B])]),
            [true; 2]
        );
        let twice = [([0.0; 3], [A, (3, A.1)]), ([0.0; 3], [A, (3, A.1)])];
        assert_eq!(noted(15.0, &twice), [true; 2]);
    }
}
