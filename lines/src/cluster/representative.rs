//! The representative segment of a cluster.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// A straight segment in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WorldSegment {
    /// The two ends, in units of the poses.
    pub ends: [Point3<f64>; 2],
}

impl WorldSegment {
    /// A segment, `None` when its ends are not finite or coincide.
    pub fn new(ends: [Point3<f64>; 2]) -> Option<Self> {
        let segment = Self { ends };
        let length = segment.length();
        (length.is_finite() && length > 0.0).then_some(segment)
    }

    /// Length in units of the poses.
    pub fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    /// Unit vector from the first end to the second.
    pub fn direction(&self) -> Vector3<f64> {
        (self.ends[1] - self.ends[0]) / self.length()
    }

    /// Distance of a point from the infinite line.
    pub(super) fn offset(&self, point: &Point3<f64>) -> f64 {
        (point - self.ends[0]).cross(&self.direction()).norm()
    }

    /// The distance measure of the paper for one point: path length from end to end via the point, minus the length of the segment.
    pub(super) fn detour(&self, point: &Point3<f64>) -> f64 {
        (point - self.ends[0]).norm() + (point - self.ends[1]).norm() - self.length()
    }
}

/// Running sums over the ends of all members, relative to a nearby origin.
#[derive(Debug, Clone, Copy)]
pub(super) struct EndMoments {
    origin: Point3<f64>,
    count: f64,
    sum: Vector3<f64>,
    outer: Matrix3<f64>,
    /// The ends with the smallest and largest projection onto the representative.
    extremes: [Point3<f64>; 2],
}

impl EndMoments {
    pub(super) fn new(segment: &WorldSegment) -> Self {
        let mut moments = Self {
            origin: segment.ends[0],
            count: 0.0,
            sum: Vector3::zeros(),
            outer: Matrix3::zeros(),
            extremes: segment.ends,
        };
        for end in &segment.ends {
            moments.add(end);
        }
        moments
    }

    fn add(&mut self, point: &Point3<f64>) {
        let d = point - self.origin;
        self.count += 1.0;
        self.sum += d;
        self.outer += d * d.transpose();
    }

    /// Adds a member's ends and returns the new representative.
    pub(super) fn extend(
        &mut self,
        segment: &WorldSegment,
        current: &WorldSegment,
    ) -> WorldSegment {
        for end in &segment.ends {
            self.add(end);
        }
        self.represent(current, &segment.ends)
    }

    /// Adds the members of another cluster and returns the new representative.
    pub(super) fn merge(&mut self, other: &Self, current: &WorldSegment) -> WorldSegment {
        // Sum of (d + s)(d + s)' with s the shift between the origins.
        let shift = other.origin - self.origin;
        self.outer += other.outer
            + other.sum * shift.transpose()
            + shift * other.sum.transpose()
            + shift * shift.transpose() * other.count;
        self.sum += other.sum + shift * other.count;
        self.count += other.count;
        self.represent(current, &other.extremes)
    }

    /// The line of largest variance through the centroid, cut at the farthest projections.
    ///
    /// An approximation: only the previous extremes and the new ends are projected, not all members. After a change of direction another
    /// end may reach slightly farther.
    fn represent(&mut self, current: &WorldSegment, new_ends: &[Point3<f64>; 2]) -> WorldSegment {
        let mean = self.sum / self.count;
        let scatter = self.outer - self.sum * mean.transpose();
        let eigen = SymmetricEigen::new(scatter);
        let mut direction: Vector3<f64> =
            eigen.eigenvectors.column(eigen.eigenvalues.imax()).into();
        let before = current.direction();
        if direction.dot(&before) < 0.0 {
            direction = -direction;
        }
        // Crossing segments of equal spread have no common direction: keep the old one.
        if direction.iter().any(|c| !c.is_finite()) || direction.dot(&before) < 0.5 {
            direction = before;
        }
        let center = self.origin + mean;
        let position = |p: &Point3<f64>| (p - center).dot(&direction);
        let candidates = [self.extremes[0], self.extremes[1], new_ends[0], new_ends[1]];
        for candidate in candidates {
            if position(&candidate) < position(&self.extremes[0]) {
                self.extremes[0] = candidate;
            }
            if position(&candidate) > position(&self.extremes[1]) {
                self.extremes[1] = candidate;
            }
        }
        let ends = self
            .extremes
            .map(|extreme| center + direction * position(&extreme));
        WorldSegment::new(ends).unwrap_or(*current)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(a: [f64; 3], b: [f64; 3]) -> WorldSegment {
        WorldSegment::new([Point3::from(a), Point3::from(b)]).unwrap()
    }

    #[test]
    fn detour_and_offset() {
        let line = segment([0.0, 0.0, 0.0], [2.0, 0.0, 0.0]);
        assert_eq!(line.detour(&Point3::new(1.0, 0.0, 0.0)), 0.0);
        assert_eq!(line.detour(&Point3::new(2.5, 0.0, 0.0)), 1.0);
        assert_eq!(line.offset(&Point3::new(9.0, 3.0, 4.0)), 5.0);
        assert!(WorldSegment::new([Point3::origin(), Point3::origin()]).is_none());
        assert!(WorldSegment::new([Point3::origin(), Point3::new(f64::NAN, 0.0, 0.0)]).is_none());
    }

    #[test]
    fn merging_equals_extending() {
        let members = [
            segment([10.0, 0.0, 0.01], [11.0, 0.0, 0.0]),
            segment([10.5, 0.01, 0.0], [12.0, 0.0, 0.0]),
            segment([12.5, 0.0, -0.01], [11.5, -0.01, 0.0]),
        ];
        let mut extended = EndMoments::new(&members[0]);
        let line = extended.extend(&members[1], &members[0]);
        let line = extended.extend(&members[2], &line);
        let mut other = EndMoments::new(&members[1]);
        let other_line = other.extend(&members[2], &members[1]);
        let mut merged = EndMoments::new(&members[0]);
        let merged_line = merged.merge(&other, &members[0]);
        assert!(other_line.length() > 1.9);
        for (a, b) in line.ends.iter().zip(&merged_line.ends) {
            assert!((a - b).norm() < 1e-9, "{a} {b}");
        }
        assert!((line.ends[0].x - 10.0).abs() < 0.01 && (line.ends[1].x - 12.5).abs() < 0.01);
    }
}
