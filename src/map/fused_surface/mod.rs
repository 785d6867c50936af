//! The surface on which the depth of all keyframes agrees.
//!
//! Where an object ends in the image, or is thinner than its points lie apart, the carved surface recedes: rays of other keyframes pass
//! closely behind. Depth says where the surface is up to its outline. Around it, on a grid, the distance from the planes that keyframes measured
//! is averaged; the surface lies where the mean changes its sign.
//!
//! # Reference
//! The mean distance: B. Curless and M. Levoy, *A volumetric method for building complex models from range images*, SIGGRAPH 1996. The
//! vertices, one in each cell: S. Gibson, *Constrained elastic surface nets*, MICCAI 1998.
//!
//! *Differs from Curless and Levoy*: distances are those from planes, not along rays, each with its own deviation; a keyframe that looks
//! past a surface does not pull it back.

mod fans;
mod field;
mod nets;

use linecarve_mesh::TriangleMesh;
use nalgebra::Point3;

use super::surface_points::KeyframeSurface;
use field::Field;

pub(super) fn env(name: &str, default: f64) -> f64 {
    std::env::var(name)
        .ok()
        .and_then(|v| v.parse().ok())
        .unwrap_or(default)
}

/// The fused surface of `views` with cells of side `side`.
pub(super) fn fused_surface(views: &[KeyframeSurface<'_>], raw: &[RawView<'_>], side: f64) -> TriangleMesh {
    let start = std::time::Instant::now();
    if env("LC_DUMP", 0.0) > 0.0 {
        use std::io::Write;
        let mut out = std::io::BufWriter::new(std::fs::File::create("/tmp/m/points.bin").unwrap());
        for (index, view) in views.iter().enumerate() {
            for p in view.points() {
                for c in [index as f32, p.x as f32, p.y as f32, p.z as f32] { out.write_all(&c.to_le_bytes()).unwrap(); }
            }
        }
    }
    let field = Field::new(views, raw, side);
    eprintln!("field {:?}: {} corners", start.elapsed(), field.len());
    let (positions, triangles) = nets::extract(&field);
    eprintln!("nets {:?}: {} vertices {} triangles", start.elapsed(), positions.len(), triangles.len());
    let (positions, triangles) = fans::separate(positions, triangles, env("LC_COMPONENT", 60.0) as usize);
    eprintln!("fans {:?}: {} vertices {} triangles", start.elapsed(), positions.len(), triangles.len());
    TriangleMesh {
        positions,
        triangles,
        colors: None,
    }
}

/// A corner of the grid.
pub(super) type Corner = [i32; 3];

fn position(corner: Corner, side: f64) -> Point3<f64> {
    Point3::from(corner.map(|along| f64::from(along) * side))
}

pub(super) struct RawView<'a> {
    depth: &'a crate::front_end::RawDepth,
    world_from_depth: nalgebra::Isometry3<f64>,
    depth_from_world: nalgebra::Isometry3<f64>,
}

impl<'a> RawView<'a> {
    pub(super) fn new(depth: &'a crate::front_end::RawDepth, world_from_camera: &nalgebra::Isometry3<f64>) -> Self {
        let world_from_depth = world_from_camera * depth.color_from_depth;
        Self { depth, world_from_depth, depth_from_world: world_from_depth.inverse() }
    }

    pub(super) fn points(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        let far = env("LC_FAR", 4.0);
        let d = self.depth;
        (0..d.rows).flat_map(move |r| (0..d.columns).map(move |c| (c, r))).filter_map(move |(c, r)| {
            let z = f64::from(d.depths[r * d.columns + c]);
            (z > 0.0 && z < far).then(|| self.world_from_depth * Point3::new((c as f64 - d.center[0]) / d.focal[0] * z, (r as f64 - d.center[1]) / d.focal[1] * z, z))
        })
    }

    pub(super) fn distance(&self, point_in_world: &Point3<f64>) -> Option<(f64, f64)> {
        let far = env_far();
        let p = self.depth_from_world * point_in_world;
        if p.z <= 0.0 { return None; }
        let d = self.depth;
        let (x, y) = (p.x / p.z * d.focal[0] + d.center[0] + 0.5, p.y / p.z * d.focal[1] + d.center[1] + 0.5);
        if !(x >= 0.0 && y >= 0.0 && x < d.columns as f64 && y < d.rows as f64) { return None; }
        let z = f64::from(d.depths[y as usize * d.columns + x as usize]);
        (z > 0.0 && z < far).then(|| (z - p.z, 1.0))
    }
}

fn env_far() -> f64 { static FAR: std::sync::OnceLock<f64> = std::sync::OnceLock::new(); *FAR.get_or_init(|| env("LC_FAR", 4.0)) }
