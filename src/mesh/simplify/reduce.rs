//! The steps, one after the other.

use rayon::prelude::*;

use super::borders::{self, Borders};
use super::edges::Neighbors;
use super::options::{SimplifyOptions, SimplifyOptionsError};
use super::patch::triangulate;
use super::regions::{Grower, Regions};
use crate::mesh::types::TriangleMesh;

/// A mesh of fewer triangles, and how it came about.
#[derive(Debug, Clone, PartialEq)]
pub struct Simplified {
    /// The mesh. Its vertices are some of the original, in their order.
    pub mesh: TriangleMesh,
    /// Number of regions that are nearly plane; triangles by themselves included.
    pub regions: usize,
    /// Number of regions of more than one triangle that had to stay as they were.
    pub kept_regions: usize,
}

/// A region that lies over itself seen along its normal, as the side of a step does, cannot be triangulated in its plane. Its
/// triangles are then put into regions anew, within half the distance, all in all so many times.
const MOST_ATTEMPTS: usize = 4;

/// Simplifies a mesh, which must be valid ([`TriangleMesh::validate`]).
///
/// Vertices do not move, so that flat parts stay flat and edges sharp. Components, holes and handles stay; triangles
/// without area, which face nowhere, stay as they are. The result may be a mesh of the same size when nothing is plane.
///
/// # Errors
/// When an option is out of range.
///
/// # Complexity
/// O(n log n) for n triangles, but for regions whose border crosses itself, which are tried again.
pub fn simplify(
    mesh: &TriangleMesh,
    options: &SimplifyOptions,
) -> Result<Simplified, SimplifyOptionsError> {
    options.validate()?;
    let neighbors = Neighbors::new(&mesh.triangles);
    let reach = 0.5 * options.tolerance;
    let mut reach_of = vec![reach; mesh.triangles.len()];
    let mut attempts = 1..=MOST_ATTEMPTS;
    let (regions, patches, kept_regions) = loop {
        let is_last = attempts
            .next()
            .is_none_or(|attempt| attempt == MOST_ATTEMPTS);
        let grower = Grower {
            positions: &mesh.positions,
            triangles: &mesh.triangles,
            neighbors: &neighbors,
            reach_of: &reach_of,
            least_cosine: options.most_turn_rad.cos(),
        };
        let regions = grower.grow();
        let borders = borders::find(
            &mesh.positions,
            &mesh.triangles,
            &neighbors,
            &regions,
            reach,
        );
        let (patches, kept) = fill(mesh, &regions, borders);
        if is_last || kept.is_empty() {
            break (regions, patches, kept.len());
        }
        for &triangle in kept.iter().flat_map(|&region| &regions.members[region]) {
            reach_of[triangle as usize] *= 0.5;
        }
    };
    let triangles: Vec<[u32; 3]> = patches.into_iter().flatten().collect();
    Ok(Simplified {
        mesh: compacted(mesh, triangles),
        regions: regions.planes.len(),
        kept_regions,
    })
}

/// The triangles of each region, between simplified borders where they allow it, and the regions of several triangles that
/// stayed as they were.
fn fill(
    mesh: &TriangleMesh,
    regions: &Regions,
    mut borders: Borders,
) -> (Vec<Vec<[u32; 3]>>, Vec<usize>) {
    let count = regions.planes.len();
    let mut patches: Vec<Option<Vec<[u32; 3]>>> = vec![None; count];
    let mut is_kept = vec![false; count];
    let mut pending: Vec<u32> = (0..count as u32).collect();
    // Every round gives at least one border its vertices back or one region its triangles.
    while !pending.is_empty() {
        let results: Vec<Option<Vec<[u32; 3]>>> = pending
            .par_iter()
            .map(|&region| {
                let border = directed_border(&borders, region);
                // A triangle, and what no vertex less makes better, is what it was.
                if is_full(&borders, region) && regions.members[region as usize].len() == 1 {
                    return None;
                }
                triangulate(&mesh.positions, &regions.planes[region as usize], &border)
            })
            .collect();
        let mut again = Vec::new();
        for (region, result) in pending.iter().copied().zip(results) {
            if result.is_some() {
                patches[region as usize] = result;
                continue;
            }
            if is_full(&borders, region) {
                is_kept[region as usize] = true;
                patches[region as usize] = None;
                continue;
            }
            // With the full border its own triangles fit, whatever else happens.
            for &(border, _) in &borders.of_region[region as usize] {
                let border = &mut borders.borders[border as usize];
                border.kept = (0..border.vertices.len() as u32).collect();
                again.push(border.vertices[0]);
            }
        }
        if again.is_empty() {
            break;
        }
        // All whose border has changed, or who have no patch yet.
        pending = changed_regions(&borders, &patches, &is_kept);
    }
    let kept_regions = (0..count)
        .filter(|region| is_kept[*region] && regions.members[*region].len() > 1)
        .collect();
    let filled = patches
        .into_iter()
        .zip(&regions.members)
        .map(|(patch, members)| {
            patch.unwrap_or_else(|| {
                let own = members.iter().map(|t| mesh.triangles[*t as usize]);
                own.collect()
            })
        })
        .collect();
    (filled, kept_regions)
}

/// Regions whose patch does not have the border that it should have now.
fn changed_regions(
    borders: &Borders,
    patches: &[Option<Vec<[u32; 3]>>],
    is_kept: &[bool],
) -> Vec<u32> {
    (0..patches.len() as u32)
        .filter(|region| {
            let region = *region as usize;
            if is_kept[region] {
                return false;
            }
            match &patches[region] {
                None => true,
                Some(triangles) => {
                    let mut used: Vec<u32> = triangles.as_flattened().to_vec();
                    used.sort_unstable();
                    used.dedup();
                    directed_border(borders, region as u32)
                        .iter()
                        .any(|(from, _)| used.binary_search(from).is_err())
                }
            }
        })
        .collect()
}

/// Whether no border of a region has lost a vertex.
fn is_full(borders: &Borders, region: u32) -> bool {
    borders.of_region[region as usize]
        .iter()
        .all(|(border, _)| {
            let border = &borders.borders[*border as usize];
            border.kept.len() == border.vertices.len()
        })
}

/// The edges that bound a region, the region to their left.
fn directed_border(borders: &Borders, region: u32) -> Vec<(u32, u32)> {
    let mut edges = Vec::new();
    for &(border, is_backward) in &borders.of_region[region as usize] {
        let border = &borders.borders[border as usize];
        let vertices = border.kept.iter().map(|k| border.vertices[*k as usize]);
        let vertices: Vec<u32> = vertices.collect();
        edges.extend(vertices.windows(2).map(|pair| {
            if is_backward {
                (pair[1], pair[0])
            } else {
                (pair[0], pair[1])
            }
        }));
    }
    edges
}

/// The triangles with the vertices that they use.
fn compacted(mesh: &TriangleMesh, mut triangles: Vec<[u32; 3]>) -> TriangleMesh {
    let mut new_name = vec![u32::MAX; mesh.positions.len()];
    for corner in triangles.as_flattened() {
        new_name[*corner as usize] = 0;
    }
    let mut kept = Vec::new();
    for (old, name) in new_name.iter_mut().enumerate() {
        if *name == 0 {
            *name = kept.len() as u32;
            kept.push(old);
        }
    }
    for corner in triangles.as_flattened_mut() {
        *corner = new_name[*corner as usize];
    }
    TriangleMesh {
        positions: kept.iter().map(|old| mesh.positions[*old]).collect(),
        triangles,
        colors: mesh
            .colors
            .as_ref()
            .map(|colors| kept.iter().map(|old| colors[*old]).collect()),
    }
}

#[cfg(test)]
mod tests;
