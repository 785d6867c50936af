//! The surface of a map as it is exported.

use linecarve_carving::internals::RankedSurface;
use linecarve_carving::{Carver, ExportOptions, TriangleRole, VertexId, VertexOrigin};
use linecarve_mesh::{TriangleMesh, close_holes};

use super::Map;
use super::lines::VertexColors;
use super::surface::{DEFAULT_COLOR, color_of};
use crate::options::{HoleFilling, Options};

/// Most edges of a hole that can be closed; the cost is cubic in them.
const LARGEST_HOLE_EDGES: usize = 400;

impl Map {
    /// The current [`surface`](Self::surface) as it is written after the last keyframe: `options.surface.holes` may close all holes.
    ///
    /// # Complexity
    /// That of [`surface`](Self::surface).
    pub fn final_surface(&self) -> TriangleMesh {
        let mut mesh = self.surface();
        if self.options.surface.holes == HoleFilling::All {
            close_all_holes(&mut mesh);
        }
        mesh
    }

    /// The surface of a map whose carving was [left](Self::leave_carving) to others, from all triangles that they carved; `None` for
    /// maps of points, whose surface needs nothing more.
    pub(crate) fn surface_of(&mut self, ranked: &RankedSurface) -> Option<TriangleMesh> {
        let export = self.export_options();
        let lines = self.contents.lines_mut()?;
        let mut mesh = lines.surface_of(&self.carver, ranked, &export);
        if self.options.surface.holes == HoleFilling::All {
            close_all_holes(&mut mesh);
        }
        Some(mesh)
    }

    /// The current surface as it is carved, filtered by `options.surface`; with depth its vertices lie where it was measured. After each
    /// keyframe it is the surface that is [followed](Self::followed_surface).
    ///
    /// # Complexity
    /// Linear in the size of the surface, plus sorting of its vertices.
    pub fn surface(&self) -> TriangleMesh {
        let export = self.export_options();
        let cloud = self.cloud();
        let followed = self.followed_surface();
        match (
            followed.filter(|surface| surface.is_current(export.longest_edge)),
            cloud,
        ) {
            (Some(surface), _) => surface.to_mesh(),
            (None, Some(cloud)) => cloud.mesh_of(&self.carver, &export),
            _ if self.is_fitted() => {
                let mut surface = self.new_surface();
                self.update_surface(&mut surface);
                surface.to_mesh()
            }
            _ => carved_mesh(&self.carver, &export),
        }
    }

    /// Filters and repair of the exported surface.
    pub(crate) fn export_options(&self) -> ExportOptions {
        export_options(&self.options, self.median_depth())
    }
}

/// The surface as it is carved, without colours.
fn carved_mesh(carver: &Carver, export: &ExportOptions) -> TriangleMesh {
    let (mesh, _) = carver.mesh_where(export, |_| TriangleRole::Exported);
    TriangleMesh {
        positions: mesh.vertices,
        triangles: mesh.triangles,
        colors: None,
    }
}

/// Colours of exported vertices; `None` when none has a colour.
pub(super) fn observed_colors(
    observed: &VertexColors<'_>,
    origins: &[VertexOrigin<VertexId>],
) -> Option<Vec<[u8; 3]>> {
    let color = |origin: &VertexOrigin<VertexId>| color_of(*origin, |vertex| observed.get(vertex));
    let colors: Vec<Option<[u8; 3]>> = origins.iter().map(color).collect();
    let has_any = colors.iter().any(Option::is_some);
    let color = |color: Option<[u8; 3]>| color.unwrap_or(DEFAULT_COLOR);
    has_any.then(|| colors.into_iter().map(color).collect())
}

/// How a surface of this median depth is exported.
pub(crate) fn export_options(options: &Options, median_depth: Option<f64>) -> ExportOptions {
    let surface = &options.surface;
    {
        let mut options = ExportOptions::default();
        options.longest_edge = median_depth
            .zip(surface.longest_edge_share)
            .map(|(depth, share)| share * depth);
        options.minimum_component = surface.minimum_component;
        options.manifold = surface.manifold;
        // The samples of a triangle are few: one that is left out alone is seldom a hole.
        options.fill_gaps = surface.holes != HoleFilling::None;
        options
    }
}

/// Closes all holes but the largest, whether anything was measured there or not.
pub(crate) fn close_all_holes(mesh: &mut TriangleMesh) {
    close_holes(mesh, LARGEST_HOLE_EDGES);
}
