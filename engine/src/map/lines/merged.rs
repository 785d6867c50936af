//! The surface of a map whose carving was left to others, as its tiles.

use linecarve_carving::internals::{RankedSurface, assemble};
use linecarve_carving::{
    Carver, ExportOptions, PointId, Triangle, TriangleRole, VertexId, VertexOrigin,
};
use linecarve_mesh::TriangleMesh;
use nalgebra::Point3;
use rustc_hash::FxHashMap;

use super::{LineMap, VertexColors};
use crate::map::export::observed_colors;
use crate::map::surface::fitted_positions;
use crate::map::vertex_landmarks::{CarvedSurface, VertexViews};

/// A surface of the points of a carver without cells; the ranks of positions number its vertices.
struct Merged<'a> {
    carver: &'a Carver,
    ranked: &'a RankedSurface,
}

impl CarvedSurface for Merged<'_> {
    fn vertex_capacity(&self) -> usize {
        self.ranked.positions.len()
    }

    fn vertex_of(&self, point: PointId) -> Option<VertexId> {
        let point = <[f64; 3]>::from(self.carver.point(point)?);
        let by = |other: &[f64; 3]| {
            let pairs = other.iter().zip(&point);
            let orders = pairs.map(|(a, b)| a.total_cmp(b));
            orders.fold(std::cmp::Ordering::Equal, std::cmp::Ordering::then)
        };
        let rank = self.ranked.positions.binary_search_by(by).ok()?;
        Some(VertexId::from_index(rank))
    }

    fn position(&self, vertex: VertexId) -> Point3<f64> {
        Point3::from(self.ranked.positions[vertex.index()])
    }

    fn triangles(&self) -> Vec<Triangle> {
        self.ranked.triangles.iter().map(of_ranks).collect()
    }
}

fn of_ranks(ranks: &[u32; 3]) -> Triangle {
    ranks.map(|rank| VertexId::from_index(rank as usize))
}

impl LineMap {
    /// The exported surface, of all triangles that were carved from the carver's points.
    pub(in crate::map) fn surface_of(
        &mut self,
        carver: &Carver,
        ranked: &RankedSurface,
        export: &ExportOptions,
    ) -> TriangleMesh {
        let surface = Merged { carver, ranked };
        let points = self.landmarks.points();
        let vertices = &mut self.vertices;
        vertices.update_postponed(&surface, points, &mut Vec::new());
        let views = VertexViews::of(&surface, carver, points, &self.vertices);
        self.validation.validate_anew(views);
        let role = |ranks: &[u32; 3]| self.role(&surface, &of_ranks(ranks), export.longest_edge);
        let roles: Vec<TriangleRole> = ranked.triangles.iter().map(role).collect();
        let (mesh, origins) = assemble(ranked, &roles, export);
        let colors = VertexColors {
            surface: &surface,
            provisional: FxHashMap::default(),
            vertices: &self.vertices,
            landmarks: &self.landmarks,
        };
        let of_rank =
            |origin: VertexOrigin<u32>| origin.map(|rank| VertexId::from_index(rank as usize));
        let origins: Vec<VertexOrigin<VertexId>> = origins.into_iter().map(of_rank).collect();
        let observed = observed_colors(&colors, &origins);
        let vertices = self.vertices_with(colors);
        let positions = fitted_positions(&mesh.vertices, &mesh.triangles, &origins, &vertices);
        TriangleMesh {
            positions,
            triangles: mesh.triangles,
            colors: observed,
        }
    }
}
