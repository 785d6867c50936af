//! Dense clouds: points whose noise is measured from the cloud itself, joined within it, and the surface between them.
//!
//! A dense cloud has more points than its noise leaves details. A surface through all of them is rough, and takes long to carve.
//!
//! 1. [`noise`]: the standard deviation of each point, from the plane through the points around it;
//! 2. [`join`]: points of one side of a surface join within a few deviations; the joined point keeps their rays;
//! 3. [`surface`]: which carved triangles the points support, and how far vertices may move where the surface is smoothed.
//!
//! Points without a surface around them, as those of sparse models, stay as they are.
//!
//! # Order
//! All steps use cubes of an octree that is aligned with the axes, and look at one cube of its [top level](top_level) at a time. Points of a
//! cube are sorted by position. So the result does not depend on the order of the points, and clouds larger than memory are joined one part
//! after the other.

mod density;
mod join;
mod noise;
mod octree;
mod surface;

use nalgebra::Point3;

pub(crate) use density::ViewStatistics;
pub(crate) use join::join;
pub(crate) use octree::{top_cube, top_level};
pub(in crate::map) use surface::CloudVertices;
pub(crate) use surface::{
    CloudSurface, append_centers, append_record, color_from_bytes, color_to_bytes, halves,
};

/// A point of a cloud.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct SeenPoint {
    pub(crate) position: Point3<f64>,
    pub(crate) color: Option<[u8; 3]>,
    /// Ascending.
    pub(crate) views: Vec<u32>,
    /// Standard deviation along the rays by the geometry of the views, if known.
    pub(crate) sigma: Option<f64>,
    /// Size of a pixel at the point in the view where it is smallest, if known.
    pub(crate) pixel: Option<f64>,
}

/// A point that stands for one or more of a cloud.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct JoinedPoint {
    pub(crate) position: Point3<f64>,
    pub(crate) color: Option<[u8; 3]>,
    /// Views, ascending, each with the number of points that it saw.
    pub(crate) rays: Vec<[u32; 2]>,
    /// Standard deviation along the rays, if known.
    pub(crate) sigma: Option<f64>,
    /// How far triangles may reach from the point without being seen face on, if known.
    pub(crate) reach: Option<f64>,
    /// Whether the cloud is dense around the point, so that its noise was measured.
    pub(crate) is_dense: bool,
}

#[cfg(test)]
mod tests;
