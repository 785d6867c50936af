//! Intersection of a ray with a triangle and with a box.

use nalgebra::{Point3, Vector3};

/// A ray with precomputed values for the triangle and box tests.
///
/// # Reference
/// S. Woop, C. Benthin, I. Wald, *Watertight Ray/Triangle Intersection*, JCGT 2(1), 2013. *Differs from the paper*: in
/// double precision throughout, without its fall-back to a wider type, and both sides of a triangle are hit.
pub(super) struct PreparedRay {
    origin: Point3<f64>,
    inverse_direction: Vector3<f64>,
    /// The dominant axis of the direction, and the other two in an order that keeps the handedness.
    axes: [usize; 3],
    shear: Vector3<f64>,
}

/// Intersection of a ray with a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TriangleHit {
    pub(super) distance: f64,
    pub(super) barycentric: [f64; 3],
    /// Whether the ray hits the side from which the corners are counter-clockwise.
    pub(super) is_front_face: bool,
}

impl PreparedRay {
    /// `None` when the direction is zero or anything is not finite.
    pub(super) fn new(origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<Self> {
        let finite = origin.iter().chain(direction.iter()).all(|v| v.is_finite());
        let z = direction.iamax();
        if !finite || direction[z] == 0.0 {
            return None;
        }
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if direction[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        Some(Self {
            origin: *origin,
            inverse_direction: direction.map(|v| 1.0 / v),
            axes: [x, y, z],
            shear: Vector3::new(
                direction[x] / direction[z],
                direction[y] / direction[z],
                1.0 / direction[z],
            ),
        })
    }

    /// The distance, in lengths of the direction, at which the ray enters the box; `None` when it misses the box
    /// or enters it beyond `max`.
    pub(super) fn enters_box(
        &self,
        low: &Vector3<f64>,
        high: &Vector3<f64>,
        max: f64,
    ) -> Option<f64> {
        let (mut near, mut far) = (0.0_f64, max);
        for axis in 0..3 {
            let first = (low[axis] - self.origin[axis]) * self.inverse_direction[axis];
            let second = (high[axis] - self.origin[axis]) * self.inverse_direction[axis];
            let (entry, exit) = if first < second {
                (first, second)
            } else {
                (second, first)
            };
            // A ray in the plane of a face gives 0 * infinity. Comparisons with NaN are false, which keeps the box;
            // `min` and `max` of the library cost several instructions more.
            near = if entry > near { entry } else { near };
            far = if exit < far { exit } else { far };
        }
        // Margin for three roundings on either side: the ray enters and leaves a flat box at the same
        // distance.
        (near <= far * (1.0 + 4.0 * f64::EPSILON)).then_some(near)
    }

    /// The hit at a distance of 0 to `max` lengths of the direction, inclusive.
    pub(super) fn hits_triangle(
        &self,
        corners: [&Point3<f64>; 3],
        max: f64,
    ) -> Option<TriangleHit> {
        let [x, y, z] = self.axes;
        let sheared = corners.map(|corner| {
            let offset = corner - self.origin;
            [
                offset[x] - self.shear.x * offset[z],
                offset[y] - self.shear.y * offset[z],
                self.shear.z * offset[z],
            ]
        });
        let [a, b, c] = sheared;
        // The neighbour across an edge computes the same two products, so that signs agree and no ray slips
        // through.
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let area = u + v + w;
        if area == 0.0 {
            return None;
        }
        let barycentric = [u / area, v / area, w / area];
        let distance = barycentric[0] * a[2] + barycentric[1] * b[2] + barycentric[2] * c[2];
        (distance >= 0.0 && distance <= max).then_some(TriangleHit {
            distance,
            barycentric,
            is_front_face: area > 0.0,
        })
    }
}
