//! The surface of a map as it is exported.

use linecarve_carving::internals::RankedSurface;
use linecarve_carving::{ExportOptions, Triangle, TriangleRole, VertexId};
use linecarve_mesh::{TriangleMesh, close_holes};

use super::lines::VertexColors;
use super::surface::DEFAULT_COLOR;
use super::{Contents, Map};
use crate::options::{HoleFilling, Options};

/// Most edges of a hole that can be closed; the cost is cubic in them.
const LARGEST_HOLE_EDGES: usize = 400;

impl Map {
    /// The current surface as an estimate from the depth of all keyframes. With depth images it is fused from their pixels, thinned where it is
    /// flat; otherwise it has the triangles of [`surface`](Self::surface). Holes are closed as `options.surface.holes` says, and planes flattened within
    /// what measurements allow.
    ///
    /// # Complexity
    /// That of [`fuse_depth`](linecarve_mesh::fusion::fuse_depth), and the vertices times the keyframes.
    pub fn adjusted_surface(&self) -> TriangleMesh {
        self.adjusted(|| self.surface())
    }

    /// The same of a map whose carving was [left](Self::leave_carving) to others, from all triangles that they carved; `None` for maps
    /// of points, whose surface needs nothing more.
    pub(crate) fn adjusted_surface_of(&mut self, ranked: &RankedSurface) -> Option<TriangleMesh> {
        let export = self.export_options();
        let Contents::Lines(lines) = &mut self.contents else {
            return None;
        };
        let mesh = lines.surface_of(&self.carver, ranked, &export);
        Some(self.adjusted(|| mesh))
    }

    fn adjusted(&self, carved: impl FnOnce() -> TriangleMesh) -> TriangleMesh {
        let mut mesh = match (&self.contents, self.median_depth()) {
            (Contents::Lines(lines), Some(median_depth)) => {
                let options = &self.options.surface;
                let surface = lines.final_surface(options, median_depth, self.has_depth_images);
                surface.estimate(carved)
            }
            _ => carved(),
        };
        if self.options.surface.holes == HoleFilling::All {
            close_all_holes(&mut mesh);
        }
        mesh
    }

    /// The current surface as it is carved, filtered by `options.surface`.
    ///
    /// # Complexity
    /// Linear in the size of the surface, plus sorting of its vertices.
    pub fn surface(&self) -> TriangleMesh {
        match self.followed_surface() {
            Some(surface) if surface.is_current(self.export_options().longest_edge) => {
                surface.to_mesh()
            }
            _ => self.extract_surface(),
        }
    }

    /// The current surface, made anew from the carver.
    fn extract_surface(&self) -> TriangleMesh {
        let export = self.export_options();
        let (mesh, origins) = match &self.contents {
            Contents::Lines(lines) => {
                let longest = export.longest_edge;
                let is_exported = |triangle: Triangle| {
                    lines.role(&self.carver, &triangle, longest) == TriangleRole::Exported
                };
                let all = ExportOptions {
                    longest_edge: None,
                    ..export
                };
                self.carver.mesh_where(&all, is_exported)
            }
            _ => self.carver.mesh_where(&export, |_| true),
        };
        TriangleMesh {
            positions: mesh.vertices,
            triangles: mesh.triangles,
            colors: self.colors_of(&origins),
        }
    }

    /// Colours of exported vertices, by their vertices in the triangulation; `None` when none has a colour.
    fn colors_of(&self, origins: &[Option<VertexId>]) -> Option<Vec<[u8; 3]>> {
        let Contents::Lines(lines) = &self.contents else {
            return None;
        };
        observed_colors(&lines.colors(&self.carver), origins.iter().copied())
    }

    /// Filters and repair of the exported surface.
    pub(crate) fn export_options(&self) -> ExportOptions {
        export_options(&self.options, self.median_depth())
    }
}

/// Colours of exported vertices, by the vertices that they copy; `None` when none has a colour.
pub(super) fn observed_colors(
    observed: &VertexColors<'_>,
    origins: impl Iterator<Item = Option<VertexId>>,
) -> Option<Vec<[u8; 3]>> {
    let colors = origins.map(|vertex| observed.get(vertex?));
    let colors: Vec<Option<[u8; 3]>> = colors.collect();
    let has_any = colors.iter().any(Option::is_some);
    let color = |color: Option<[u8; 3]>| color.unwrap_or(DEFAULT_COLOR);
    has_any.then(|| colors.into_iter().map(color).collect())
}

/// How a surface of this median depth is exported.
pub(crate) fn export_options(options: &Options, median_depth: Option<f64>) -> ExportOptions {
    let surface = &options.surface;
    ExportOptions {
        longest_edge: median_depth
            .zip(surface.longest_edge_share)
            .map(|(depth, share)| share * depth),
        minimum_component: surface.minimum_component,
        manifold: surface.manifold,
    }
}

/// Closes all holes but the largest, whether anything was measured there or not.
pub(crate) fn close_all_holes(mesh: &mut TriangleMesh) {
    close_holes(mesh, LARGEST_HOLE_EDGES, |_| true);
}
