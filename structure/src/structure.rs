//! Planes and polygons of a surface.

use linecarve_mesh::TriangleMesh;
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use crate::kind::Kind;
use crate::measures::{Angle, Distance, Edge};

/// How a structure is found.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct StructureOptions {
    /// About up in the frame of the mesh.
    pub up: Vector3<f64>,
    /// Polygons at most: the largest ones.
    pub most_polygons: usize,
}

impl Default for StructureOptions {
    /// Up is against y, as in the frame of a camera that is held level; 500 polygons.
    fn default() -> Self {
        Self {
            up: -Vector3::y(),
            most_polygons: 500,
        }
    }
}

/// A plane of a structure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StructurePlane {
    /// Its name in files: its number and its kind.
    pub name: String,
    /// What it seems to be.
    pub kind: Kind,
    /// Number of its polygons.
    pub polygons: usize,
    /// Unit normal, towards free space.
    pub normal: Vector3<f64>,
    /// `normal · x` of positions on the plane.
    pub offset: f64,
    /// Where it was measured: the mean of its vertices, on the plane.
    pub center: Point3<f64>,
    /// Area of its polygons.
    pub area: f64,
    /// Its extent: width along a level direction, and height across it.
    pub size: [f64; 2],
    /// Root mean square distance of the vertices of the mesh to it.
    pub rms: f64,
    /// Standard deviation of its offset at the centre.
    pub sigma: f64,
    /// Whether its normal is one of the main directions.
    #[serde(rename = "aligned")]
    pub is_aligned: bool,
    /// Mean sRGB colour of its vertices, when the mesh has colours.
    #[serde(skip)]
    pub color: Option<[u8; 3]>,
}

/// A polygon with holes in a plane.
#[derive(Debug, Clone, PartialEq)]
pub struct Polygon {
    /// Number of its plane.
    pub plane: u32,
    /// The outer ring, counter-clockwise seen from free space, and the rings of holes, clockwise: numbers of vertices. Polygons that
    /// meet have the same vertices along their common border.
    pub rings: Vec<Vec<u32>>,
    /// Its triangles, without further vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl Polygon {
    /// Sides of all rings, the polygon to the left.
    pub(crate) fn sides(&self) -> impl Iterator<Item = [u32; 2]> + '_ {
        self.rings.iter().flat_map(|it| sides(it))
    }
}

/// The sides of a ring.
pub(crate) fn sides<T: Copy>(ring: &[T]) -> impl Iterator<Item = [T; 2]> + '_ {
    let next = ring.iter().cycle().skip(1);
    ring.iter().zip(next).map(|(a, b)| [*a, *b])
}

/// Planes and polygons of a surface, and the triangles that lie on none.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Vertices, in the frame of the mesh.
    pub positions: Vec<Point3<f64>>,
    /// sRGB colours of vertices, when the mesh has colours.
    pub colors: Option<Vec<[u8; 3]>>,
    /// Planes, by descending area.
    pub planes: Vec<StructurePlane>,
    /// Polygons, by plane.
    pub polygons: Vec<Polygon>,
    /// Triangles that lie on no plane.
    pub rest: Vec<[u32; 3]>,
    /// Distances between parallel planes.
    pub distances: Vec<Distance>,
    /// Where planes meet.
    pub edges: Vec<Edge>,
    /// Angles between other planes.
    pub angles: Vec<Angle>,
    /// Three main directions at right angles, the third one up, when planes have them.
    pub main_directions: Option<[Vector3<f64>; 3]>,
    /// Up: the main direction, or what the options say.
    pub up: Vector3<f64>,
    /// Standard deviation of the mesh across its flat parts.
    pub noise: f64,
    /// How far vertices of the mesh may have moved to where planes meet.
    pub tolerance: f64,
    /// Area of the mesh.
    pub mesh_area: f64,
}

impl Structure {
    /// Polygons and rest as triangles.
    pub fn mesh(&self) -> TriangleMesh {
        let polygons = self.polygons.iter().flat_map(|it| &it.triangles);
        TriangleMesh {
            positions: self.positions.clone(),
            triangles: polygons.chain(&self.rest).copied().collect(),
            colors: None,
        }
    }

    /// About `count` positions on the polygons, spread evenly by area, always the same.
    pub fn samples(&self, count: usize) -> Vec<Point3<f64>> {
        let step = self.planes.iter().map(|it| it.area).sum::<f64>() / count.max(1) as f64;
        let mut found = Vec::new();
        let mut left = 0.5 * step;
        for triangle in self.polygons.iter().flat_map(|it| &it.triangles) {
            let [a, b, c] = triangle.map(|corner| self.positions[corner as usize]);
            left += self.area_of(std::slice::from_ref(triangle));
            while left >= step && step > 0.0 {
                left -= step;
                // The additive sequence of M. Roberts (2018) for two dimensions.
                let index = found.len() as f64;
                let [s, t] =
                    [0.754_877_666_246_693, 0.569_840_290_998_053].map(|it| (index * it).fract());
                let [s, t] = if s + t > 1.0 {
                    [1.0 - s, 1.0 - t]
                } else {
                    [s, t]
                };
                found.push(a + s * (b - a) + t * (c - a));
            }
        }
        found
    }

    /// Area of triangles.
    pub fn area_of(&self, triangles: &[[u32; 3]]) -> f64 {
        let areas = triangles.iter().map(|it| {
            let [a, b, c] = it.map(|corner| self.positions[corner as usize]);
            0.5 * (b - a).cross(&(c - a)).norm()
        });
        areas.sum()
    }
}
