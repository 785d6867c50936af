//! Search for the known line that an edge follows.

use nalgebra::Point3;
use rstar::{AABB, RTree, RTreeObject};

/// Maximum angle between an edge and the line that it follows (15 degrees).
const ALONG_COSINE: f64 = 0.966;

/// Known lines in a spatial index.
pub(super) struct KnownLines {
    tree: RTree<Line>,
    reach: f64,
}

struct Line([Point3<f64>; 2]);

impl RTreeObject for Line {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        let [a, b] = self.0;
        AABB::from_corners(a.coords.into(), b.coords.into())
    }
}

impl KnownLines {
    /// Indexes lines by their ends, leaving out those that are not finite. `reach` is the maximum distance of an
    /// edge from its line.
    pub(super) fn new(lines: &[[Point3<f64>; 2]], reach: f64) -> Self {
        let is_finite = |p: &Point3<f64>| p.coords.iter().all(|v| v.is_finite());
        let finite = lines.iter().filter(|line| line.iter().all(is_finite));
        Self {
            tree: RTree::bulk_load(finite.map(|line| Line(*line)).collect()),
            reach,
        }
    }

    /// Whether both ends of an edge lie within reach of one line of about its direction.
    pub(super) fn run_along(&self, p: &Point3<f64>, q: &Point3<f64>) -> bool {
        let reach = self.reach;
        let around = |p: &Point3<f64>, by: f64| -> [f64; 3] { p.coords.map(|v| v + by).into() };
        let near = AABB::from_corners(around(&p.inf(q), -reach), around(&p.sup(q), reach));
        let mut candidates = self.tree.locate_in_envelope_intersecting(near);
        candidates.any(|Line([a, b])| {
            let (edge, line) = (q - p, b - a);
            edge.dot(&line).abs() >= ALONG_COSINE * edge.norm() * line.norm()
                && [p, q]
                    .iter()
                    .all(|end| squared_to_segment(end, a, b) <= reach * reach)
        })
    }
}

/// Squared distance of a point from a segment.
pub(crate) fn squared_to_segment(point: &Point3<f64>, a: &Point3<f64>, b: &Point3<f64>) -> f64 {
    let along = b - a;
    let length = along.norm_squared();
    let t = if length > 0.0 {
        ((point - a).dot(&along) / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (point - (a + along * t)).norm_squared()
}
