//! Sample points of a triangle, compared with dense depth.

use std::cmp::Ordering;

use linecarve_carving::TrianglePart;
use nalgebra::{Point3, Vector3};

use super::parts::best_part;
use super::{FacetEvidence, SAMPLE_COUNT, SUBDIVISIONS};
use crate::map::surface_points::KeyframeSurface;

/// Least cosine between the normal of a triangle and the direction to a camera that measured it. Where a surface ends, triangles
/// connect it with what lies behind; cameras see their free side at a grazing angle or not at all. Tuned on two indoor sequences with
/// sensor depth and a rendered room.
const LEAST_COSINE: f64 = 0.1;

/// Sample points of a triangle, compared with dense depth.
pub(super) struct Samples {
    points: [Point3<f64>; SAMPLE_COUNT as usize],
    /// Normal towards free space; zero for a triangle without area.
    normal: Vector3<f64>,
    area: f64,
    /// Which corner of the triangle the samples begin with.
    first: usize,
}

impl Samples {
    /// The samples do not depend on which corner comes first, so not on the numbers of vertices.
    pub(super) fn of(mut corners: [Point3<f64>; 3]) -> Self {
        let order = |a: &Point3<f64>, b: &Point3<f64>| {
            let mut pairs = a.iter().zip(b.iter());
            pairs
                .find_map(|(a, b)| Some(a.total_cmp(b)).filter(|order| order.is_ne()))
                .unwrap_or(Ordering::Equal)
        };
        let first = (0..3).min_by(|a, b| order(&corners[*a], &corners[*b]));
        let first = first.unwrap_or(0);
        corners.rotate_left(first);
        let share = |index: u32| (f64::from(index) + 1.0 / 3.0) / f64::from(SUBDIVISIONS);
        let mut points = [Point3::origin(); SAMPLE_COUNT as usize];
        let pairs = (0..SUBDIVISIONS).flat_map(|i| (0..SUBDIVISIONS - i).map(move |j| (i, j)));
        for (point, (i, j)) in points.iter_mut().zip(pairs) {
            *point = corners[2]
                + share(i) * (corners[0] - corners[2])
                + share(j) * (corners[1] - corners[2]);
        }
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        Self {
            points,
            normal: normal.try_normalize(0.0).unwrap_or_default(),
            area: 0.5 * normal.norm(),
            first,
        }
    }

    /// The part of the triangle along which a surface was measured, if it has at least that area.
    pub(super) fn measured_part(
        &self,
        evidence: &FacetEvidence,
        least_area: f64,
    ) -> Option<TrianglePart> {
        let (part, gain) = best_part(evidence)?;
        let measured = f64::from(gain) / f64::from(SAMPLE_COUNT) * self.area;
        (measured >= least_area).then(|| part.rotated((3 - self.first) % 3))
    }

    /// The points.
    #[cfg(test)]
    pub(super) fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Adds the evidence of one view.
    pub(super) fn compare(&self, dense_view: &KeyframeSurface<'_>, evidence: &mut FacetEvidence) {
        evidence.is_observed = true;
        let to_camera = dense_view.center() - self.points[0];
        let faces_camera = self.normal.dot(&to_camera) >= LEAST_COSINE * to_camera.norm();
        for (sample, point) in self.points.iter().enumerate() {
            let bit = 1 << sample;
            if evidence.agreed & bit != 0 {
                continue;
            }
            match dense_view.compare_depth(point) {
                Some(Ordering::Equal) if faces_camera => evidence.agreed |= bit,
                Some(Ordering::Less) => evidence.contradicted |= bit,
                // Occluded by the measured surface, or seen from the side or from behind.
                Some(Ordering::Greater | Ordering::Equal) | None => {}
            }
        }
    }
}
