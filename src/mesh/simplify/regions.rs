//! Regions that are nearly plane.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::edges::Neighbors;

/// A plane through a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plane {
    pub(super) point: Point3<f64>,
    /// Unit length, towards the side that sees the triangles counter-clockwise.
    pub(super) normal: Vector3<f64>,
}

impl Plane {
    pub(super) fn distance(&self, point: &Point3<f64>) -> f64 {
        (point - self.point).dot(&self.normal).abs()
    }

    /// Two directions that with the normal make a right-handed frame.
    pub(super) fn axes(&self) -> [Vector3<f64>; 2] {
        let least = self.normal.iamin();
        let mut other = Vector3::zeros();
        other[least] = 1.0;
        let first = self.normal.cross(&other).normalize();
        [first, self.normal.cross(&first)]
    }
}

/// Every triangle's region, and the regions' planes.
pub(super) struct Regions {
    /// By triangle.
    pub(super) of: Vec<u32>,
    pub(super) planes: Vec<Plane>,
    /// Triangles of each region, ascending.
    pub(super) members: Vec<Vec<u32>>,
}

/// Planes are fitted to a region so often at most; each grows it by a factor, until it ends.
const MOST_ROUNDS: usize = 32;

/// A mesh to be parted into regions.
pub(super) struct Grower<'a> {
    pub(super) positions: &'a [Point3<f64>],
    pub(super) triangles: &'a [[u32; 3]],
    pub(super) neighbors: &'a Neighbors,
    /// How far each triangle may be from the plane of its region.
    pub(super) reach_of: &'a [f64],
    /// Of the angle between a triangle and its region.
    pub(super) least_cosine: f64,
}

impl Grower<'_> {
    /// Grows regions from the largest triangles on: first within the plane of the seed, then anew within the plane that fits
    /// what was found, as long as that finds more. Every triangle ends up in one, if need be by itself.
    pub(super) fn grow(&self) -> Regions {
        let mut seeds: Vec<(f64, u32)> = (0..self.triangles.len() as u32)
            .map(|t| (self.cross(t).norm(), t))
            .collect();
        seeds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let mut regions = Regions {
            of: vec![u32::MAX; self.triangles.len()],
            planes: Vec::new(),
            members: Vec::new(),
        };
        // Which growth visited a triangle last: stamps spare clearing.
        let mut visited = vec![0_u32; self.triangles.len()];
        let mut stamp = 0;
        for (doubled_area, seed) in seeds {
            if regions.of[seed as usize] != u32::MAX {
                continue;
            }
            let (mut plane, mut members) = (
                Plane {
                    point: self.positions[self.triangles[seed as usize][0] as usize],
                    normal: Vector3::z(),
                },
                vec![seed],
            );
            if doubled_area > 0.0 {
                plane.normal = self.cross(seed) / doubled_area;
                // The plane of one triangle is soon off by more than the reach; that of what it has found leads further.
                let mut next = plane;
                for _ in 0..MOST_ROUNDS {
                    stamp += 1;
                    let found = self.flood(seed, &next, &regions.of, &mut visited, stamp);
                    if found.len() <= members.len() {
                        break;
                    }
                    (plane, members) = (next, found);
                    match self.fit(&members, &plane.normal) {
                        Some(better) if self.belongs(seed, &better) => next = better,
                        _ => break,
                    }
                }
            }
            members.sort_unstable();
            let name = regions.planes.len() as u32;
            for member in &members {
                regions.of[*member as usize] = name;
            }
            regions.planes.push(plane);
            regions.members.push(members);
        }
        regions
    }

    fn corners(&self, triangle: u32) -> [Point3<f64>; 3] {
        self.triangles[triangle as usize].map(|corner| self.positions[corner as usize])
    }

    /// Twice the area along the normal.
    fn cross(&self, triangle: u32) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        (b - a).cross(&(c - a))
    }

    fn belongs(&self, triangle: u32, plane: &Plane) -> bool {
        let [a, b, c] = self.corners(triangle);
        let reach = self.reach_of[triangle as usize];
        if [a, b, c].iter().any(|p| plane.distance(p) > reach) {
            return false;
        }
        let cross = self.cross(triangle);
        let facing = cross.dot(&plane.normal);
        let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
        let height = cross.norm() / longest;
        if height <= 2.0 * reach {
            facing > 0.0
        } else {
            facing >= self.least_cosine * cross.norm()
        }
    }

    fn flood(
        &self,
        seed: u32,
        plane: &Plane,
        region_of: &[u32],
        visited: &mut [u32],
        stamp: u32,
    ) -> Vec<u32> {
        let mut found = vec![seed];
        visited[seed as usize] = stamp;
        let mut next = 0;
        while let Some(&triangle) = found.get(next) {
            next += 1;
            for edge in 3 * triangle..3 * triangle + 3 {
                if let Some(other) = self.neighbors.across(edge)
                    && visited[other as usize] != stamp
                    && region_of[other as usize] == u32::MAX
                {
                    visited[other as usize] = stamp;
                    if self.belongs(other, plane) {
                        found.push(other);
                    }
                }
            }
        }
        found
    }

    /// The plane that fits triangles best, each point of them weighing the same.
    fn fit(&self, members: &[u32], facing: &Vector3<f64>) -> Option<Plane> {
        let mut weight = 0.0;
        let mut sum = Vector3::zeros();
        for &member in members {
            let area = self.cross(member).norm();
            let [a, b, c] = self.corners(member);
            weight += area;
            sum += (a.coords + b.coords + c.coords) * (area / 3.0);
        }
        if weight <= 0.0 {
            return None;
        }
        let mean = sum / weight;
        let mut spread = Matrix3::zeros();
        for &member in members {
            let area = self.cross(member).norm();
            let corners = self.corners(member).map(|p| p.coords - mean);
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            // Second moment of a triangle: its corners count 1/12 each, its centroid 9/12.
            let mut moment = middle * middle.transpose() * 9.0;
            for corner in corners {
                moment += corner * corner.transpose();
            }
            spread += moment * (area / 12.0);
        }
        let eigen = SymmetricEigen::new(spread);
        let normal = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imin())
            .into_owned();
        let normal = if normal.dot(facing) < 0.0 {
            -normal
        } else {
            normal
        };
        normal.iter().all(|v| v.is_finite()).then_some(Plane {
            point: Point3::from(mean),
            normal,
        })
    }
}
