//! The surface on which the depth images of several views agree.
//!
//! Around measured points, on the corners of a grid of cubes, the distance from the surface that each view measured along the ray is averaged.
//! The surface lies where the mean changes its sign: one vertex in each cube that it crosses. It is cut off behind 3D line segments that are
//! outlines, and along edges and boundaries vertices move onto them.
//!
//! # Reference
//! The mean distance: B. Curless and M. Levoy, *A volumetric method for building complex models from range images*, SIGGRAPH 1996. The
//! vertices: S. Gibson, *Constrained elastic surface nets*, MICCAI 1998; several in a cube where it has several sheets, as in G. Nielson,
//! *Dual marching cubes*, VIS 2004.
//!
//! *Differs from the papers*: distances are those from planes, where pixels lie on one, so that surfaces seen at a grazing angle are not torn.
//! Nothing is accumulated view by view, so the result depends neither on the order of the views nor on which of them moved before.

mod blocks;
mod corners;
mod field;
mod grid;
mod lips;
mod nets;
mod outlines;
mod segments;
mod sheets;
mod view;

use linecarve_lines::depth::CompactDepth;
use nalgebra::{Isometry3, Point3};

use crate::TriangleMesh;
use field::Field;
use outlines::Outlines;

/// The depth image of a view with its pose.
#[derive(Debug, Clone)]
pub struct PosedDepth<'a> {
    depth: &'a CompactDepth,
    world_from_depth: Isometry3<f64>,
}

impl<'a> PosedDepth<'a> {
    /// Depth measured beside a colour camera with this pose.
    pub fn new(depth: &'a CompactDepth, world_from_color: &Isometry3<f64>) -> Self {
        Self {
            depth,
            world_from_depth: world_from_color * depth.color_from_depth(),
        }
    }
}

/// How depth is fused.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FusionOptions {
    /// Side of the cubes, in units of the poses.
    pub side: f64,
    /// Distances are cut off at this many sides: points further behind a surface are not seen by the view.
    pub truncation_sides: f64,
    /// Pieces with fewer triangles are left out.
    pub least_component: usize,
}

impl FusionOptions {
    /// Cubes of this side, distances cut off at three sides, pieces of 30 triangles and more.
    pub fn with_side(side: f64) -> Self {
        Self {
            side,
            truncation_sides: 3.0,
            least_component: 30,
        }
    }
}

/// The surface on which the depth of all `views` agrees, with normals towards the cameras and without colours. It is manifold; where
/// sheets touch, vertices have copies. It is open where depth ends, and at segments that views see as outlines. Edges and boundaries lie on `segments`
/// (end points in world coordinates) that are near them.
///
/// Empty when the side is not a positive, finite length. Points further from the origin than a million sides are left out.
///
/// # Complexity
/// O((c + s) v) for c corners of cubes near measured points, s cubes that segments cross and v views, and O(p log p) for p measured points. Memory of O(c); few images are
/// unpacked at a time.
pub fn fuse_depth(
    views: &[PosedDepth<'_>],
    segments: &[[Point3<f64>; 2]],
    options: &FusionOptions,
) -> TriangleMesh {
    if !(options.side > 0.0 && options.side.is_finite()) {
        return TriangleMesh::default();
    }
    let mut outlines = Outlines::new(segments, options.side);
    let (positions, mut triangles) = nets::extract(&Field::new(views, options, &mut outlines));
    outlines.cut(&positions, &mut triangles);
    let (positions, triangles) = sheets::separate(positions, triangles, options.least_component);
    let mut mesh = TriangleMesh {
        positions,
        triangles,
        colors: None,
    };
    segments::snap(&mut mesh, segments, options.side);
    mesh
}

#[cfg(test)]
mod tests;
