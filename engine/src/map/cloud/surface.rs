//! The surface between the points of a dense cloud.
//!
//! Where nothing was measured, carving leaves triangles between points that are far from each other: across what is hidden behind an outline,
//! and where a cloud ends. Such a triangle is wider than a few
//! pixels and than the points lie apart, and views see it from the side or from behind.

use linecarve_carving::internals::{RankedSurface, assemble};
use linecarve_carving::{
    Carver, ExportOptions, IndexedMesh, Triangle, TriangleRole, VertexId, VertexOrigin,
};
use linecarve_mesh::TriangleMesh;
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::JoinedPoint;
use crate::map::surface::{DEFAULT_COLOR, FittedVertex, VertexSource, color_of, fitted_positions};

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
    /// Where its views begin; they end where those of the next point begin.
    views: u32,
    color: [u8; 4],
}

/// A colour, if there is one, as files hold it.
pub(crate) fn color_to_bytes(color: Option<[u8; 3]>) -> [u8; 4] {
    color.map_or([0; 4], |[r, g, b]| [r, g, b, 1])
}

/// What [`color_to_bytes`] wrote.
pub(crate) fn color_from_bytes([r, g, b, has_color]: [u8; 4]) -> Option<[u8; 3]> {
    (has_color != 0).then_some([r, g, b])
}

/// The halves of eight bytes.
pub(crate) fn halves([a, b, c, d, e, f, g, h]: [u8; 8]) -> [[u8; 4]; 2] {
    [[a, b, c, d], [e, f, g, h]]
}

/// What is known of a point, as files hold it.
struct Record {
    key: [u64; 3],
    bound: f64,
    reach: f64,
    color: [u8; 4],
    views: Vec<u32>,
}

impl Record {
    /// Without a pixel size, triangles at a point reach as far as they like.
    fn of(point: &JoinedPoint) -> Self {
        Self {
            key: key(&point.position),
            bound: match point.is_dense {
                true => BOUND_SIGMAS * point.sigma.unwrap_or(0.0),
                false => 0.0,
            },
            reach: point.reach.unwrap_or(f64::INFINITY),
            color: color_to_bytes(point.color),
            views: point.rays.iter().map(|[view, _]| *view).collect(),
        }
    }

    fn put(&self, out: &mut Vec<u8>) {
        let [x, y, z] = self.key;
        let (bound, reach) = (self.bound.to_bits(), self.reach.to_bits());
        for word in [x, y, z, bound, reach] {
            out.extend(word.to_le_bytes());
        }
        out.extend((self.views.len() as u32).to_le_bytes());
        out.extend(self.color);
        out.extend(self.views.iter().flat_map(|view| view.to_le_bytes()));
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        let mut word = || {
            let (word, rest) = bytes.split_first_chunk::<8>()?;
            *bytes = rest;
            Some(u64::from_le_bytes(*word))
        };
        let key = [word()?, word()?, word()?];
        let (bound, reach) = (f64::from_bits(word()?), f64::from_bits(word()?));
        let [count, color] = halves(word()?.to_le_bytes());
        let count = u32::from_le_bytes(count) as usize;
        let (views, rest) = bytes.split_at_checked(count.checked_mul(4)?)?;
        *bytes = rest;
        let view = |bytes: &[u8]| u32::from_le_bytes(bytes.try_into().unwrap_or_default());
        Some(Self {
            key,
            bound,
            reach,
            color,
            views: views.chunks_exact(4).map(view).collect(),
        })
    }
}

/// Appends what is known of a point.
pub(crate) fn append_record(point: &JoinedPoint, out: &mut Vec<u8>) {
    Record::of(point).put(out);
}

/// Appends the centres of the views.
pub(crate) fn append_centers(centers: &[Point3<f64>], out: &mut Vec<u8>) {
    let coordinates = centers.iter().flat_map(|center| center.iter());
    out.extend(coordinates.flat_map(|x| x.to_le_bytes()));
    out.extend((centers.len() as u64).to_le_bytes());
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
        let mut surface = Self {
            centers,
            ..Self::default()
        };
        points.for_each(|point| surface.add_point(point));
        surface
    }

    /// Adds a point. Of points at one position the last counts.
    pub(crate) fn add_point(&mut self, point: &JoinedPoint) {
        self.add(Record::of(point));
    }

    fn add(&mut self, record: Record) {
        let views = self.views.len() as u32;
        self.views.extend(record.views);
        self.index.insert(record.key, self.points.len() as u32);
        self.points.push(Known {
            bound: record.bound,
            reach: record.reach,
            views,
            color: record.color,
        });
    }

    /// Views of a point, by its number.
    fn views_of(&self, index: u32) -> &[u32] {
        let start = self.points[index as usize].views as usize;
        let next = self.points.get(index as usize + 1);
        let end = next.map_or(self.views.len(), |next| next.views as usize);
        &self.views[start..end]
    }

    /// Triangles at all points may reach as far as they like.
    pub(crate) fn support_all(&mut self) {
        for point in &mut self.points {
            point.reach = f64::INFINITY;
        }
    }

    /// What [`append_record`] and then [`append_centers`] wrote; `None` where it is damaged.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (bytes, count) = bytes.split_last_chunk::<8>()?;
        let length = usize::try_from(u64::from_le_bytes(*count))
            .ok()?
            .checked_mul(24)?;
        let (mut bytes, centers) = bytes.split_at_checked(bytes.len().checked_sub(length)?)?;
        let coordinate = |bytes: &[u8]| f64::from_le_bytes(bytes.try_into().unwrap_or_default());
        let coordinates: Vec<f64> = centers.chunks_exact(8).map(coordinate).collect();
        let center = |c: &[f64]| Point3::new(c[0], c[1], c[2]);
        let mut surface = Self {
            centers: coordinates.chunks_exact(3).map(center).collect(),
            ..Self::default()
        };
        while !bytes.is_empty() {
            let record = Record::take(&mut bytes)?;
            let is_known = |view: &u32| (*view as usize) < surface.centers.len();
            if !record.views.iter().all(is_known) {
                return None;
            }
            surface.add(record);
        }
        Some(surface)
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
        self.finished(mesh, &origins, |vertex: VertexId| {
            corner(vertex.index() as u32)
        })
    }

    /// The exported surface of a carver with the points of the cloud.
    pub(crate) fn mesh_of(&self, carver: &Carver, export: &ExportOptions) -> TriangleMesh {
        let position = |vertex: VertexId| carver.tetrahedra().position(vertex);
        let role = |triangle: &Triangle| {
            let longest = export.longest_edge;
            let is_short = longest.is_none_or(|longest| carver.has_edges_within(triangle, longest));
            match is_short && self.supports(triangle.map(position)) {
                true => TriangleRole::Exported,
                false => TriangleRole::Counted,
            }
        };
        // Triangles with long edges count for the size of their component.
        let mut all = *export;
        all.longest_edge = None;
        let (mesh, origins) = carver.mesh_where(&all, role);
        self.finished(mesh, &origins, position)
    }

    /// Centres of the views.
    pub(crate) fn centers(&self) -> &[Point3<f64>] {
        &self.centers
    }

    /// Smooths and colours an exported surface.
    fn finished(
        &self,
        mesh: IndexedMesh,
        origins: &[VertexOrigin<VertexId>],
        position: impl Fn(VertexId) -> Point3<f64> + Sync,
    ) -> TriangleMesh {
        let vertices = CloudVertices {
            surface: self,
            position,
        };
        let positions = fitted_positions(&mesh.vertices, &mesh.triangles, origins, &vertices);
        TriangleMesh {
            positions,
            triangles: mesh.triangles,
            colors: self.colors(origins, &vertices.position),
        }
    }

    /// Colours of vertices; `None` when no point has one.
    pub(crate) fn colors(
        &self,
        origins: &[VertexOrigin<VertexId>],
        position: impl Fn(VertexId) -> Point3<f64>,
    ) -> Option<Vec<[u8; 3]>> {
        let color = |vertex| self.color(&position(vertex));
        let colors = origins.iter().map(|origin| color_of(*origin, color));
        let colors: Vec<Option<[u8; 3]>> = colors.collect();
        let has_any = colors.iter().any(Option::is_some);
        let color = |color: Option<[u8; 3]>| color.unwrap_or(DEFAULT_COLOR);
        has_any.then(|| colors.into_iter().map(color).collect())
    }

    /// Colour of the point at a position.
    fn color(&self, position: &Point3<f64>) -> Option<[u8; 3]> {
        color_from_bytes(self.known(position)?.1.color)
    }

    /// The number of the point at a position, and what is known of it.
    fn known(&self, position: &Point3<f64>) -> Option<(u32, &Known)> {
        let index = *self.index.get(&key(position))?;
        Some((index, self.points.get(index as usize)?))
    }

    /// Whether points and views support a triangle, whose normal points to free space. True where nothing is known of a corner.
    pub(crate) fn supports(&self, corners: [Point3<f64>; 3]) -> bool {
        let known = corners.map(|corner| self.known(&corner));
        let [Some(a), Some(b), Some(c)] = known else {
            return true;
        };
        let reach = a.1.reach.max(b.1.reach).max(c.1.reach);
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
        let mut corners = [a, b, c].into_iter();
        corners.any(|(corner, _)| self.views_of(corner).iter().any(faces))
    }

    /// A vertex at a position, as far as it may move.
    pub(in crate::map) fn fit(&self, position: Point3<f64>) -> FittedVertex {
        FittedVertex {
            position,
            bound: self.known(&position).map_or(0.0, |(_, known)| known.bound),
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

    fn color(&self, vertex: VertexId) -> Option<[u8; 3]> {
        self.surface.color(&(self.position)(vertex))
    }
}
