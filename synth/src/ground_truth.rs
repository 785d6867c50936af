//! The observed part of a scene's surface.

use linecarve_lines::camera::Camera;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

use super::scene::Scene;
use super::surface::Surface;
use linecarve_mesh::TriangleMesh;
use linecarve_mesh::raycast::RayScene;
use linecarve_mesh::srgb::encoded_color;

/// Maximum side of the pieces whose visibility is decided as a whole.
const PIECE_M: f64 = 0.05;

/// The observed surface.
pub(super) struct Observed {
    /// Mesh of the observed pieces, merged into few rectangles.
    pub(super) mesh: TriangleMesh,
    /// Observed share of the whole area.
    pub(super) share: f64,
}

/// Finds the pieces of the scene's surfaces (at most 5 cm wide) whose centre is visible from its front in at least
/// one frame.
pub(super) fn observed(
    scene: &Scene,
    rays: &RayScene,
    camera: &Camera,
    (width, height): (u32, u32),
    poses: &[Isometry3<f64>],
) -> Observed {
    let cameras: Vec<_> = poses
        .iter()
        .map(|pose| (Point3::from(pose.translation.vector), pose.inverse()))
        .collect();
    let is_seen = |surface: &Surface, point: &Point3<f64>| {
        cameras.iter().any(|(eye, camera_from_world)| {
            let toward = eye - point;
            toward.dot(&surface.normal()) > 0.0
                && camera.project(&(camera_from_world * point)).is_some_and(|pixel| {
                    pixel.x >= -0.5
                        && pixel.y >= -0.5
                        && pixel.x <= f64::from(width) - 0.5
                        && pixel.y <= f64::from(height) - 0.5
                })
                // Starts slightly above the surface to avoid hitting it.
                && !rays.is_occluded(&(point + toward * 1e-6), &toward, 1.0)
        })
    };
    let patches: Vec<(Vec<Block>, [usize; 2])> = scene
        .surfaces
        .par_iter()
        .map(|surface| {
            let counts =
                [surface.size.0, surface.size.1].map(|l| (l / PIECE_M).ceil().max(1.0) as usize);
            let piece = [
                surface.size.0 / counts[0] as f64,
                surface.size.1 / counts[1] as f64,
            ];
            let mut grid = vec![false; counts[0] * counts[1]];
            for (index, seen) in grid.iter_mut().enumerate() {
                let (column, row) = (index % counts[0], index / counts[0]);
                let centre = surface.point(
                    (column as f64 + 0.5) * piece[0],
                    (row as f64 + 0.5) * piece[1],
                );
                *seen = is_seen(surface, &centre);
            }
            (blocks(&mut grid, counts[0]), counts)
        })
        .collect();

    let mut mesh = TriangleMesh::default();
    let mut colors = Vec::new();
    let (mut area, mut seen_area) = (0.0, 0.0);
    for (surface, (blocks, counts)) in scene.surfaces.iter().zip(patches) {
        let (width, height) = surface.size;
        let piece = [width / counts[0] as f64, height / counts[1] as f64];
        area += width * height;
        for block in blocks {
            let [u0, u1] = [block.columns.0, block.columns.1].map(|c| c as f64 * piece[0]);
            let [v0, v1] = [block.rows.0, block.rows.1].map(|r| r as f64 * piece[1]);
            seen_area += (u1 - u0) * (v1 - v0);
            let first = mesh.positions.len() as u32;
            for (u, v) in [(u0, v0), (u1, v0), (u1, v1), (u0, v1)] {
                mesh.positions.push(surface.point(u, v));
                colors.push(encoded_color(surface.color_at(u, v).0));
            }
            mesh.triangles.push([first, first + 1, first + 2]);
            mesh.triangles.push([first, first + 2, first + 3]);
        }
    }
    mesh.colors = Some(colors);
    Observed {
        mesh,
        share: if area > 0.0 { seen_area / area } else { 0.0 },
    }
}

/// Half-open ranges of columns and rows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Block {
    columns: (usize, usize),
    rows: (usize, usize),
}

/// Covers the true entries of a grid with disjoint blocks: greedily the longest run in the first row, then all rows
/// that contain it. Clears the grid.
fn blocks(grid: &mut [bool], columns: usize) -> Vec<Block> {
    let rows = grid.len() / columns;
    let mut blocks = Vec::new();
    for row in 0..rows {
        let mut column = 0;
        while column < columns {
            if !grid[row * columns + column] {
                column += 1;
                continue;
            }
            let line = &grid[row * columns..(row + 1) * columns];
            let end = column + line[column..].iter().take_while(|seen| **seen).count();
            let mut below = row + 1;
            while below < rows
                && grid[below * columns + column..below * columns + end]
                    .iter()
                    .all(|s| *s)
            {
                below += 1;
            }
            for covered in row..below {
                grid[covered * columns + column..covered * columns + end].fill(false);
            }
            blocks.push(Block {
                columns: (column, end),
                rows: (row, below),
            });
            column = end;
        }
    }
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_each_true_entry_once() {
        for pattern in 0..1_u32 << 12 {
            let grid: Vec<bool> = (0..12).map(|bit| pattern >> bit & 1 == 1).collect();
            let mut covered = vec![0; 12];
            for block in blocks(&mut grid.clone(), 4) {
                for row in block.rows.0..block.rows.1 {
                    for column in block.columns.0..block.columns.1 {
                        covered[row * 4 + column] += 1;
                    }
                }
            }
            let expected: Vec<i32> = grid.iter().map(|seen| i32::from(*seen)).collect();
            assert_eq!(covered, expected);
        }
    }
}
