//! The surface between the points of a dense cloud.
//!
//! Where nothing was measured, carving leaves triangles between points that are far from each other: across what is hidden behind an outline,
//! and where a cloud ends. Such a triangle is wider than a few
//! pixels and than the points lie apart, and views see it from the side or from behind.

use linecarve_carving::internals::{RankedSurface, assemble};
use linecarve_carving::{ExportOptions, TriangleRole, VertexId, VertexOrigin};
use linecarve_mesh::TriangleMesh;
use nalgebra::Point3;
use rustc_hash::FxHashMap;
use xxhash_rust::xxh3::xxh3_64;

use super::JoinedPoint;
use crate::map::surface::{FittedVertex, VertexSource, fitted_positions};

/// Least cosine between the normal of a wide triangle and the direction to a view that sees one of its corners: 70 degrees. Views graze what
/// spans a hidden part of the scene. Tuned on the kitchen of 7-Scenes.
const LEAST_COSINE: f64 = 0.35;
/// Longest edge of any triangle, in lengths from which on it has to be seen face on. Dense clouds have gaps where surfaces have no texture, and
/// end. Tuned on the same.
const LARGEST_REACHES: f64 = 10.0;
/// How far a vertex may move where the surface is smoothed, in its standard deviations.
const BOUND_SIGMAS: f64 = 2.0;

/// What is known of the points of a cloud, by position.
#[derive(Debug, Clone, Default)]
pub(crate) struct CloudSurface {
    index: FxHashMap<[u64; 3], u32>,
    points: Vec<Known>,
    views: Vec<u32>,
    centers: Vec<Point3<f64>>,
}

#[derive(Debug, Clone, Copy)]
struct Known {
    /// How far the vertex may move.
    bound: f64,
    reach: f64,
    /// Where its views begin and end.
    views: [u32; 2],
}

fn key(position: &Point3<f64>) -> [u64; 3] {
    // Zero has one sign.
    <[f64; 3]>::from(position.coords).map(|x| (x + 0.0).to_bits())
}

impl CloudSurface {
    /// `centers` are those of the views.
    pub(crate) fn of<'a>(
        points: impl Iterator<Item = &'a JoinedPoint>,
        centers: Vec<Point3<f64>>,
    ) -> Self {
        let mut surface = Self::new(centers);
        points.for_each(|point| surface.add(point));
        surface
    }

    /// No points yet.
    pub(crate) fn new(centers: Vec<Point3<f64>>) -> Self {
        Self {
            centers,
            ..Self::default()
        }
    }

    /// Adds a point. Of points at one position the last counts.
    pub(crate) fn add(&mut self, point: &JoinedPoint) {
        let Some(reach) = point.reach else {
            return;
        };
        let bound = match point.is_dense {
            true => BOUND_SIGMAS * point.sigma.unwrap_or(0.0),
            false => 0.0,
        };
        let start = self.views.len() as u32;
        self.views.extend(point.rays.iter().map(|[view, _]| *view));
        let views = [start, self.views.len() as u32];
        self.index
            .insert(key(&point.position), self.points.len() as u32);
        self.points.push(Known {
            bound,
            reach,
            views,
        });
    }

    /// As a file holds it; a digest of all is at the end.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut keys = vec![[0; 3]; self.points.len()];
        for (key, index) in &self.index {
            keys[*index as usize] = *key;
        }
        let counts = [self.points.len(), self.views.len(), self.centers.len()];
        let mut bytes = Vec::new();
        counts
            .iter()
            .for_each(|count| bytes.extend((*count as u64).to_le_bytes()));
        for (key, point) in keys.iter().zip(&self.points) {
            key.iter().for_each(|bits| bytes.extend(bits.to_le_bytes()));
            bytes.extend(point.bound.to_le_bytes());
            bytes.extend(point.reach.to_le_bytes());
            point
                .views
                .iter()
                .for_each(|at| bytes.extend(at.to_le_bytes()));
        }
        self.views
            .iter()
            .for_each(|view| bytes.extend(view.to_le_bytes()));
        let coordinates = self.centers.iter().flat_map(|center| center.iter());
        coordinates.for_each(|x| bytes.extend(x.to_le_bytes()));
        let digest = xxh3_64(&bytes);
        bytes.extend(digest.to_le_bytes());
        bytes
    }

    /// What [`to_bytes`](Self::to_bytes) wrote; `None` where the file is damaged.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (bytes, digest) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
        if xxh3_64(bytes).to_le_bytes() != *digest {
            return None;
        }
        let mut words = bytes
            .chunks_exact(8)
            .map(|word| word.try_into().unwrap_or_default());
        let mut next = || words.next().map(u64::from_le_bytes);
        let [points, views, centers] = [next()?, next()?, next()?].map(|count| count as usize);
        let mut surface = Self::default();
        for number in 0..points {
            let key = [next()?, next()?, next()?];
            let (bound, reach) = (f64::from_bits(next()?), f64::from_bits(next()?));
            let ends = next()?;
            let ends = [ends as u32, (ends >> 32) as u32];
            if ends[0] > ends[1] || ends[1] as usize > views {
                return None;
            }
            // Points at one position: the last counts.
            surface.index.insert(key, number as u32);
            surface.points.push(Known {
                bound,
                reach,
                views: ends,
            });
        }
        let rest = bytes.get(24 + 48 * points..)?;
        let (seen, rest) = rest.split_at_checked(4 * views)?;
        let view = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap_or_default());
        surface.views = seen.chunks_exact(4).map(view).collect();
        let coordinate = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().unwrap_or_default());
        let coordinates: Vec<f64> = rest.chunks_exact(8).map(coordinate).collect();
        let center = |c: &[f64]| Point3::new(c[0], c[1], c[2]);
        surface.centers = coordinates.chunks_exact(3).map(center).collect();
        let is_known = |view: &u32| (*view as usize) < centers;
        (surface.centers.len() == centers && surface.views.iter().all(is_known)).then_some(surface)
    }

    /// The exported surface, of all triangles that were carved from the points.
    pub(crate) fn surface_of(
        &self,
        ranked: &RankedSurface,
        export: &ExportOptions,
    ) -> TriangleMesh {
        let corner = |rank: u32| Point3::from(ranked.positions[rank as usize]);
        let role = |ranks: &[u32; 3]| {
            let corners = ranks.map(corner);
            let [p, q, r] = corners;
            let edges = [q - p, r - q, p - r].map(|edge| edge.norm_squared());
            let is_short = |longest: f64| edges.iter().all(|edge| *edge <= longest * longest);
            match export.longest_edge.is_none_or(is_short) && self.supports(corners) {
                true => TriangleRole::Exported,
                false => TriangleRole::Counted,
            }
        };
        let roles: Vec<TriangleRole> = ranked.triangles.iter().map(role).collect();
        let (mesh, origins) = assemble(ranked, &roles, export);
        let of_rank =
            |origin: VertexOrigin<u32>| origin.map(|rank| VertexId::from_index(rank as usize));
        let origins: Vec<VertexOrigin<VertexId>> = origins.into_iter().map(of_rank).collect();
        let vertices = CloudVertices {
            surface: self,
            position: |vertex: VertexId| corner(vertex.index() as u32),
        };
        let positions = fitted_positions(&mesh.vertices, &mesh.triangles, &origins, &vertices);
        TriangleMesh {
            positions,
            triangles: mesh.triangles,
            colors: None,
        }
    }

    fn known(&self, position: &Point3<f64>) -> Option<&Known> {
        let index = self.index.get(&key(position))?;
        self.points.get(*index as usize)
    }

    /// Whether points and views support a triangle, whose normal points to free space. True where nothing is known of a corner.
    pub(crate) fn supports(&self, corners: [Point3<f64>; 3]) -> bool {
        let known = corners.map(|corner| self.known(&corner));
        let [Some(a), Some(b), Some(c)] = known else {
            return true;
        };
        let reach = a.reach.max(b.reach).max(c.reach);
        let [p, q, r] = corners;
        let edges = [q - p, r - q, p - r].map(|edge| edge.norm_squared());
        let longest = edges.into_iter().fold(0.0, f64::max).sqrt();
        if longest <= reach {
            return true;
        }
        if longest > LARGEST_REACHES * reach {
            return false;
        }
        let normal = (q - p).cross(&(r - p));
        let middle = p + (q - p + (r - p)) / 3.0;
        let faces = |view: &u32| {
            let towards = self.centers[*view as usize] - middle;
            towards.dot(&normal) >= LEAST_COSINE * towards.norm() * normal.norm()
        };
        [a, b, c].iter().any(|corner| {
            let [start, end] = corner.views.map(|at| at as usize);
            self.views[start..end].iter().any(faces)
        })
    }

    /// A vertex at a position, as far as it may move.
    pub(in crate::map) fn fit(&self, position: Point3<f64>) -> FittedVertex {
        FittedVertex {
            position,
            bound: self.known(&position).map_or(0.0, |known| known.bound),
            views: 0,
        }
    }
}

/// The vertices of a surface, whose positions the function gives.
pub(in crate::map) struct CloudVertices<'a, F> {
    pub(in crate::map) surface: &'a CloudSurface,
    pub(in crate::map) position: F,
}

impl<F: Fn(VertexId) -> Point3<f64> + Sync> VertexSource for CloudVertices<'_, F> {
    fn fit(&self, vertex: VertexId) -> FittedVertex {
        self.surface.fit((self.position)(vertex))
    }
}
