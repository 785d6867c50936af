//! The merged surface with the triangles that meet at each edge.

use linecarve_carving::internals::{
    NO_NEIGHBOR, RankedSurface, RankedTriangle, rotate_smallest_first,
};

use super::mesh::{MergedMesh, merged_mesh};
use crate::error::TilesError;
use crate::split::by_position;
use crate::stage::Stage;
use crate::surface_file::{Side, SurfaceFile};
use crate::work::Work;

/// The surface of a plan that [keeps neighbours](crate::PlanOptions::keeps_neighbors) and whose stages are all done, in memory: all
/// triangles, as one carver connects them.
///
/// # Errors
/// When it is not there, the plan does not keep neighbours, or a file is damaged.
pub fn merged_surface(work: &Work) -> Result<RankedSurface, TilesError> {
    let item = MergedMesh::ITEM;
    if !work.plan().keeps_neighbors {
        return Err(TilesError::damaged(
            &work.path(item),
            "its plan keeps no neighbours",
        ));
    }
    let mesh = merged_mesh(work)?;
    let mut surface = RankedSurface {
        positions: mesh.vertices.into_iter().map(<[f64; 3]>::from).collect(),
        neighbors: vec![[NO_NEIGHBOR; 3]; mesh.triangles.len()],
        triangles: mesh.triangles,
    };
    connect_pairs(&mut surface);
    for needed in work.items(Stage::Surface) {
        let file = SurfaceFile::new(work.open_result(needed, item)?)?;
        for side in file.sides()? {
            let found = number(&surface, &side);
            let (index, k, neighbor) =
                found.ok_or_else(|| file.damaged("a side of an unknown triangle"))?;
            surface.neighbors[index as usize][k] = neighbor;
        }
    }
    Ok(surface)
}

/// Connects the triangles of each edge that has two.
fn connect_pairs(surface: &mut RankedSurface) {
    let mut sides: Vec<([u32; 2], (u32, usize))> = Vec::new();
    for (index, triangle) in (0u32..).zip(&surface.triangles) {
        for k in 0..3 {
            let (a, b) = (triangle[k], triangle[(k + 1) % 3]);
            sides.push(([a.min(b), a.max(b)], (index, k)));
        }
    }
    sides.sort_unstable();
    for same in sides.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, (a, k)), (_, (b, l))] = *same {
            surface.neighbors[a as usize][k] = b;
            surface.neighbors[b as usize][l] = a;
        }
    }
}

/// Triangle, edge and neighbour of a side.
fn number(surface: &RankedSurface, [a, b, c, apex]: &Side) -> Option<(u32, usize, u32)> {
    let rank = |position: &[f64; 3]| {
        let by = |other: &[f64; 3]| by_position(other, position);
        surface.positions.binary_search_by(by).ok()
    };
    let index = |triangle: RankedTriangle| {
        let triangle = rotate_smallest_first(triangle);
        surface.triangles.binary_search(&triangle).ok()
    };
    let (a, b, c) = (rank(a)? as u32, rank(b)? as u32, rank(c)? as u32);
    let own = index([a, b, c])?;
    let k = surface.triangles[own].iter().position(|&rank| rank == a)?;
    let neighbor = match apex[0].is_nan() {
        true => NO_NEIGHBOR,
        false => index([b, a, rank(apex)? as u32])? as u32,
    };
    Some((own as u32, k, neighbor))
}
