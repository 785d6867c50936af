//! Triangle meshes and line sets as the program holds them, and their files.

use nalgebra::Point3;

/// A triangle mesh. Frame and unit are those of the poses (x right, y down, z forward of the first camera, or whatever
/// frame the sequence has); triangles are counter-clockwise seen from the side that is free of matter.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Vertex positions.
    pub positions: Vec<Point3<f64>>,
    /// Indices into `positions`, three a triangle.
    pub triangles: Vec<[u32; 3]>,
    /// sRGB colour of each vertex, when known; then as long as `positions`.
    pub colors: Option<Vec<[u8; 3]>>,
}

/// A set of straight lines between points.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LineSet {
    /// End points.
    pub points: Vec<Point3<f64>>,
    /// Indices into `points`, two a line.
    pub lines: Vec<[u32; 2]>,
    /// sRGB colour of each point, when known; then as long as `points`.
    pub colors: Option<Vec<[u8; 3]>>,
}
