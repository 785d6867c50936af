//! The surface that is fused from the pixels of all depth images, in place of the carved one: `[surface] method = "fused"`.
//!
//! It is thinned where it is flat, small holes are closed where depth was measured, and planes are flattened within what the measurements
//! allow.

use linecarve_mesh::fusion::{FusionOptions, fuse_depth};
use linecarve_mesh::simplify::{ThinOptions, thin};
use linecarve_mesh::{
    SmoothOptions, TriangleMesh, close_holes, flat_vertices, smooth_piecewise_flat,
};
use nalgebra::Point3;
use rustc_hash::FxHashSet;

use super::depth_noise::DepthNoise;
use super::depth_validation::DepthValidation;
use super::surface_points::KeyframeSurface;
use super::vertex_adjustment::{adjust_vertices, scatter};
use super::vertex_colors::vertex_colors;
use crate::options::{HoleFilling, SurfaceOptions};

/// Side of the cubes in which depth is fused, in pixels at the median scene depth. Tuned on two indoor sequences with sensor depth and a
/// rendered room.
const FUSION_SIDE_PX: f64 = 3.2;
/// Least side of the cubes, in deviations of a depth at the median scene depth. Smaller ones would show noise.
const FUSION_SIDE_SIGMAS: f64 = 0.9;
/// How far vertices may lie from the fused surface where it is thinned, in deviations of a depth at the median scene depth.
const THINNING_SIGMAS: f64 = 0.4;
/// The same for its boundary, in sides of the cubes.
const THINNING_BOUNDARY_SIDES: f64 = 0.35;
/// Longest edge of a thinned triangle, in sides of the cubes.
const LONGEST_EDGE_SIDES: f64 = 8.0;
/// Planes further than this from a fused vertex, in deviations, are those of another surface.
const FUSED_GATE_SIGMAS: f64 = 1.0;
/// How far a vertex is smoothed, as a share of how far its measurements lie apart.
const SMOOTHING_BOUND: f64 = 0.5;
/// Rounds of smoothing.
const SMOOTHING_ROUNDS: usize = 20;
/// Least doubled area of a triangle over the sum of its squared sides; 0.29 for an equilateral one.
const LEAST_SHAPE: f64 = 0.01;
/// Most edges of a hole that is closed where depth measured a surface. Larger ones are shadows of objects.
const MEASURED_HOLE_EDGES: usize = 24;

/// What the surface is made from.
pub(super) struct FusedSurface<'a> {
    pub(super) validation: &'a DepthValidation,
    pub(super) noise: &'a DepthNoise,
    pub(super) focal_px: f64,
    pub(super) median_depth: f64,
    /// End points of segments along which edges and boundaries lie, in world coordinates.
    pub(super) segments: Vec<[Point3<f64>; 2]>,
    pub(super) options: &'a SurfaceOptions,
}

impl FusedSurface<'_> {
    /// The surface; `None` without depth images.
    ///
    /// # Complexity
    /// That of [`fuse_depth`], and the vertices times the keyframes.
    pub(super) fn make(&self) -> Option<TriangleMesh> {
        let surfaces = self.validation.dense_surfaces();
        let mut mesh = self.fused(&surfaces)?;
        if self.options.holes == HoleFilling::Measured {
            close_holes(&mut mesh, MEASURED_HOLE_EDGES, |triangle| {
                self.validation.is_along(&surfaces, triangle)
            });
        }
        let mut bounds = scatter(&mesh.positions, &surfaces);
        for bound in &mut bounds {
            *bound *= SMOOTHING_BOUND;
        }
        let rough = mesh.positions.clone();
        let smoothing = SmoothOptions {
            normal_rounds: SMOOTHING_ROUNDS,
            vertex_rounds: SMOOTHING_ROUNDS,
            ..SmoothOptions::default()
        };
        smooth_piecewise_flat(&mut mesh, &bounds, &smoothing);
        restore_folded(&mut mesh, &rough);
        Some(mesh)
    }

    /// The surface fused from depth images; `None` where there are none.
    fn fused(&self, surfaces: &[KeyframeSurface<'_>]) -> Option<TriangleMesh> {
        let images: Vec<_> = self.validation.depth_images().collect();
        if images.is_empty() {
            return None;
        }
        let rho = 1.0 / self.median_depth;
        let sigma = self.noise.sigma(rho) / (rho * rho);
        let pixel = self.median_depth / self.focal_px;
        let side = (FUSION_SIDE_PX * pixel).max(FUSION_SIDE_SIGMAS * sigma);
        let mut options = FusionOptions::with_side(side);
        options.least_component = options.least_component.max(self.options.minimum_component);
        let mut mesh = fuse_depth(&images, &self.segments, &options);
        let thinning = ThinOptions {
            tolerance: THINNING_SIGMAS * sigma,
            boundary_tolerance: THINNING_BOUNDARY_SIDES * side,
            longest_edge: LONGEST_EDGE_SIDES * side,
        };
        thin(&mut mesh, &thinning);
        let thinned = mesh.positions.clone();
        // At an edge, planes were measured over both of its sides. Vertices at one position stay together.
        let bits = |position: &Point3<f64>| <[f64; 3]>::from(position.coords).map(f64::to_bits);
        let vertices = mesh.positions.iter().zip(flat_vertices(&mesh));
        let at_edges: FxHashSet<[u64; 3]> = vertices
            .filter(|(_, is_flat)| !is_flat)
            .map(|(position, _)| bits(position))
            .collect();
        adjust_vertices(&mut mesh, surfaces, FUSED_GATE_SIGMAS, |position| {
            !at_edges.contains(&bits(position))
        });
        restore_folded(&mut mesh, &thinned);
        mesh.colors = vertex_colors(&mesh, surfaces, &self.validation.colors());
        Some(mesh)
    }
}

/// Moves the vertices of triangles that turned over or lost their area back to where they were `before`.
fn restore_folded(mesh: &mut TriangleMesh, before: &[Point3<f64>]) {
    let doubled_area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a));
    loop {
        let mut is_changed = false;
        for triangle in &mesh.triangles {
            let corners = triangle.map(|corner| mesh.positions[corner as usize]);
            let (old, new) = (
                doubled_area(triangle.map(|corner| before[corner as usize])),
                doubled_area(corners),
            );
            let [a, b, c] = corners;
            let squares = (b - a).norm_squared() + (c - b).norm_squared() + (a - c).norm_squared();
            let is_folded = new.dot(&old) <= 0.0 || new.norm() < LEAST_SHAPE * squares;
            if !is_folded {
                continue;
            }
            for corner in triangle.map(|corner| corner as usize) {
                is_changed |= mesh.positions[corner] != before[corner];
                mesh.positions[corner] = before[corner];
            }
        }
        if !is_changed {
            break;
        }
    }
}
