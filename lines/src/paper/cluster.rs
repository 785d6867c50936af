//! Clustering as published: each segment joins the first cluster that accepts it.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Settings of [`PaperClusterer`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PaperClusterOptions {
    /// lambda_alpha.
    pub maximum_angle_rad: f64,
    /// lambda_d, in units of the poses: 0.02 in maps whose median depth is about 1.
    pub maximum_distance: f64,
    /// lambda_C.
    pub minimum_size: usize,
}

impl PaperClusterOptions {
    /// The values of the paper in a map with the given length of its unit.
    pub fn with_unit(unit: f64) -> Self {
        Self {
            maximum_angle_rad: 10.0_f64.to_radians(),
            maximum_distance: 0.02 * unit,
            minimum_size: 3,
        }
    }
}

#[derive(Debug, Clone)]
struct Cluster {
    ends: Vec<Point3<f64>>,
    representative: [Point3<f64>; 2],
}

/// Clusters of segments in the order of their first segments.
///
/// A cluster accepts a segment within an angle (whichever way the two run) when one end of the segment has a small sum of distances
/// to the ends of the cluster's line, less the length of that line. The line of two and more segments has the direction of largest
/// spread of all their ends, goes through their centroid and reaches to the outermost projections.
///
/// # Complexity
/// O(n m) for n segments and m clusters, and O(k) for each insertion into a cluster of k segments.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section III-C.
#[derive(Debug, Clone)]
pub struct PaperClusterer {
    options: PaperClusterOptions,
    clusters: Vec<Cluster>,
    /// How many of them have the minimum size.
    large: usize,
}

impl PaperClusterer {
    /// Without segments yet.
    pub fn new(options: PaperClusterOptions) -> Self {
        Self {
            options,
            clusters: Vec::new(),
            large: 0,
        }
    }

    /// Adds a segment to the first cluster that accepts it, or begins a new one. Returns whether the segment has a direction; others are
    /// left out.
    pub fn insert(&mut self, ends: [Point3<f64>; 2]) -> bool {
        let least_cosine = self.options.maximum_angle_rad.cos();
        let Some(direction) = (ends[1] - ends[0]).try_normalize(0.0) else {
            return false;
        };
        let accepts = |cluster: &Cluster| {
            let [a, b] = cluster.representative;
            let (line, length) = (b - a, (b - a).norm());
            let excess = |end: &Point3<f64>| (end - a).norm() + (end - b).norm() - length;
            line.dot(&direction).abs() > least_cosine * length
                && excess(&ends[0]).min(excess(&ends[1])) < self.options.maximum_distance
        };
        match self.clusters.iter().position(accepts) {
            Some(index) => {
                let cluster = &mut self.clusters[index];
                cluster.ends.extend(ends);
                self.large += usize::from(cluster.ends.len() == 2 * self.options.minimum_size);
                if let Some(line) = line_of(&cluster.ends) {
                    cluster.representative = line;
                }
            }
            None => self.clusters.push(Cluster {
                ends: ends.to_vec(),
                representative: ends,
            }),
        }
        true
    }

    /// Number of clusters with enough segments. Constant time.
    pub fn line_count(&self) -> usize {
        self.large
    }

    /// Removes all clusters.
    pub fn clear(&mut self) {
        self.clusters.clear();
        self.large = 0;
    }

    /// The lines of the clusters with enough segments.
    pub fn lines(&self) -> impl Iterator<Item = [Point3<f64>; 2]> + '_ {
        self.clusters
            .iter()
            .filter(|cluster| cluster.ends.len() >= 2 * self.options.minimum_size)
            .map(|cluster| cluster.representative)
    }
}

/// The line of largest spread between the outermost projections; `None` when all points are the same.
pub fn line_of(points: &[Point3<f64>]) -> Option<[Point3<f64>; 2]> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords).sum();
    let center = Point3::from(sum / points.len().max(1) as f64);
    let mut spread = Matrix3::zeros();
    for point in points {
        let arm = point - center;
        spread += arm * arm.transpose();
    }
    let eigen = SymmetricEigen::new(spread);
    let largest = eigen.eigenvalues.imax();
    let direction: Vector3<f64> = eigen.eigenvectors.column(largest).into_owned();
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for point in points {
        let position = direction.dot(&(point - center));
        (low, high) = (low.min(position), high.max(position));
    }
    (high > low).then(|| [center + direction * low, center + direction * high])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clusterer() -> PaperClusterer {
        PaperClusterer::new(PaperClusterOptions::with_unit(1.0))
    }

    fn along_x(from: f64, to: f64, y: f64) -> [Point3<f64>; 2] {
        [Point3::new(from, y, 1.0), Point3::new(to, y, 1.0)]
    }

    #[test]
    fn three_segments_on_a_line_become_one_whichever_way_they_run() {
        let mut clusters = clusterer();
        clusters.insert(along_x(0.0, 1.0, 0.0));
        clusters.insert(along_x(1.2, 0.4, 0.001));
        assert_eq!(clusters.lines().count(), 0);
        clusters.insert(along_x(0.8, 1.5, -0.001));
        let lines: Vec<_> = clusters.lines().collect();
        assert_eq!(lines.len(), 1);
        assert!(((lines[0][1] - lines[0][0]).norm() - 1.5).abs() < 1e-3);
    }

    #[test]
    fn the_first_cluster_that_accepts_takes_a_segment() {
        let mut clusters = clusterer();
        // The third would fit the second better.
        for y in [0.0, 0.2, 0.11] {
            for _ in 0..3 {
                clusters.insert(along_x(0.0, 1.0, y));
            }
        }
        assert_eq!(clusters.lines().count(), 3);
        clusters.insert(along_x(0.5, 0.6, 0.06));
        let lines: Vec<_> = clusters.lines().collect();
        assert!(lines[0].iter().any(|end| end.y != 0.0), "{lines:?}");
        assert!(lines[2].iter().all(|end| (end.y - 0.11).abs() < 1e-9));
    }

    #[test]
    fn turned_and_distant_segments_stay_apart() {
        let mut clusters = clusterer();
        clusters.insert(along_x(0.0, 1.0, 0.0));
        clusters.insert(along_x(1.2, 2.0, 0.0));
        clusters.insert([Point3::new(0.5, 0.0, 1.0), Point3::new(0.5, 1.0, 1.0)]);
        clusters.insert([Point3::new(0.5, 0.0, 1.0); 2]);
        assert_eq!(clusters.clusters.len(), 3);
    }
}
