//! Redundant visibility: rays and visibility triangles that are nearly parallel to existing ones.

use linecarve_carving::{Carver, ViewId};
use nalgebra::{Point3, Vector3};

/// Whether a point is closer than `distance` to the segment between two others.
pub(super) fn is_near_segment(
    point: &Point3<f64>,
    [from, to]: [&Point3<f64>; 2],
    distance: f64,
) -> bool {
    let along = to - from;
    let share = (point - from).dot(&along) / along.norm_squared();
    let nearest = from + share.clamp(0.0, 1.0) * along;
    (point - nearest).norm_squared() < distance * distance
}

/// Sub-segments from a common end have the same direction when the cosine of their angle exceeds this (20 degrees).
const MIN_DIRECTION_COSINE: f64 = 0.94;

/// Views that have visibility triangles to sub-segments between landmarks.
///
/// Keyframes split a segment at different positions, so the same pair of landmarks seldom recurs. A sub-segment therefore counts
/// as observed from a camera when, at both of its ends, a nearby view has a visibility triangle in the same direction.
#[derive(Debug, Default)]
pub(super) struct SegmentViews {
    /// Tangent of the least angle between two cameras as seen from an end.
    least_tangent: f64,
    /// For each landmark: views with a visibility triangle that ends there, and the direction of its sub-segment.
    by_landmark: Vec<Vec<(ViewId, Vector3<f64>)>>,
}

impl SegmentViews {
    /// No views yet. Of cameras closer than this angle only the first gets a visibility triangle; with 0 all do.
    pub(super) fn new(least_angle_deg: f64) -> Self {
        Self {
            least_tangent: least_angle_deg.to_radians().tan(),
            by_landmark: Vec::new(),
        }
    }

    /// Inserts the visibility triangle of a view to the sub-segment between two landmarks, unless a nearly parallel one exists.
    /// Returns whether it was inserted.
    ///
    /// # Complexity
    /// Linear in the visibility triangles that end in the two landmarks.
    pub(super) fn insert_unless_known(
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
        let directions = [along, -along];
        let is_known = ends
            .iter()
            .zip(&directions)
            .all(|((landmark, end), direction)| {
                let distance = self.least_tangent * (end - center).norm();
                let known = self.by_landmark.get(*landmark as usize);
                known.into_iter().flatten().any(|(view, known)| {
                    known.dot(direction) > MIN_DIRECTION_COSINE
                        && carver
                            .view(*view)
                            .is_some_and(|other| is_near_segment(center, [end, &other], distance))
                })
            });
        if is_known {
            return false;
        }
        for ((landmark, _), direction) in ends.into_iter().zip(directions) {
            let needed = landmark as usize + 1;
            self.by_landmark
                .resize_with(needed.max(self.by_landmark.len()), Vec::new);
            self.by_landmark[landmark as usize].push((view, direction));
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A landmark and its position.
    type End = (u32, [f64; 3]);

    /// Whether each of these visibility triangles, given by camera centre and ends, is inserted.
    fn inserted(least_angle_deg: f64, triangles: &[([f64; 3], [End; 2])]) -> Vec<bool> {
        let mut carver = Carver::default();
        let mut known = SegmentViews::new(least_angle_deg);
        let insert = |(center, ends): &([f64; 3], [End; 2])| {
            let center = Point3::from(*center);
            let mut transaction = carver.transaction();
            let view = transaction.add_view(center).unwrap();
            transaction.commit().unwrap();
            let ends = ends.map(|(landmark, position)| (landmark, Point3::from(position)));
            known.insert_unless_known(&carver, view, &center, ends)
        };
        triangles.iter().map(insert).collect()
    }

    /// Two metres before the origin.
    const A: End = (0, [-1.0, 0.0, 2.0]);
    const B: End = (1, [1.0, 0.0, 2.0]);
    const C: End = (7, [2.0, 0.02, 2.0]);

    #[test]
    fn nearly_parallel_triangles_are_not_inserted() {
        // 15 degrees at 2.2 m are 0.6 m.
        let triangles = inserted(
            15.0,
            &[
                ([0.0; 3], [A, B]),
                ([0.3, 0.0, 0.0], [A, B]),
                ([0.3, 0.0, 0.0], [B, A]),
                ([0.0, 1.0, 0.0], [A, B]),
            ],
        );
        assert_eq!(triangles, [true, false, false, true]);
    }

    #[test]
    fn sub_segments_that_cover_another_make_it_known() {
        // A to B, B to C, then A to C.
        let covered = inserted(
            15.0,
            &[
                ([0.0; 3], [A, B]),
                ([0.0; 3], [B, C]),
                ([0.1, 0.0, 0.0], [A, C]),
            ],
        );
        assert_eq!(covered, [true, true, false]);
        // Perpendicular at one end, and in the opposite direction at another.
        let perpendicular = (1, [-1.0, 1.0, 2.0]);
        let others = inserted(
            15.0,
            &[
                ([0.0; 3], [A, B]),
                ([0.0; 3], [A, perpendicular]),
                ([0.0; 3], [B, C]),
            ],
        );
        assert_eq!(others, [true; 3]);
    }

    #[test]
    fn zero_angle_and_zero_length_insert_all() {
        assert_eq!(
            inserted(0.0, &[([0.0; 3], [A, B]), ([0.0; 3], [A, B])]),
            [true; 2]
        );
        let degenerate = [([0.0; 3], [A, (3, A.1)]), ([0.0; 3], [A, (3, A.1)])];
        assert_eq!(inserted(15.0, &degenerate), [true; 2]);
    }
}
