//! Joins points of a cloud that are as near to each other as they are accurate.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use super::noise::{Patch, patches};
use super::octree::{DEPTH, morton, top_cube};
use super::{JoinedPoint, SeenPoint};

/// Side of the cubes in which points join, in standard deviations, to the nearest power of two. The normals of triangles between points that
/// are so far apart are known to a seventh of a radian, from single points.
const SIDE_SIGMAS: f64 = 7.0;
/// A joined point is at most this much more accurate than a single one: errors of points that are near to each other are alike.
const LARGEST_GAIN: f64 = 4.0;
/// A cloud is dense where its points lie at most this many pixels apart: matched pixel by pixel, not by features.
pub(super) const DENSE_PX: f64 = 8.0;
/// Triangles with longer edges, in pixels, have to be seen face on. Tuned on the kitchen of 7-Scenes.
const REACH_PX: f64 = 15.0;
/// The same in distances between joined points.
const REACH_SPACINGS: f64 = 2.0;

/// Joins the points of a cloud whose octree has this [top level](super::top_level); `centers` are those of the views.
///
/// # Complexity
/// `n log n` in the number of points.
pub(crate) fn join(points: Vec<SeenPoint>, top: i32, centers: &[Point3<f64>]) -> Vec<JoinedPoint> {
    let mut keyed: Vec<([i64; 3], u64, SeenPoint)> = (points.into_par_iter())
        .map(|point| {
            let cube = top_cube(&point.position, top);
            (cube, morton(&point.position, top), point)
        })
        .collect();
    keyed.par_sort_by(|(cube_a, code_a, a), (cube_b, code_b, b)| {
        let keys = (cube_a, code_a).cmp(&(cube_b, code_b));
        keys.then_with(|| order(&a.position, &b.position))
            .then_with(|| a.views.cmp(&b.views))
            .then_with(|| a.color.cmp(&b.color))
    });
    let blocks: Vec<_> = keyed.chunk_by(|a, b| a.0 == b.0).collect();
    let joined = blocks
        .into_par_iter()
        .flat_map_iter(|block| join_block(block, top, centers));
    joined.collect()
}

/// Lexicographic order.
fn order(a: &Point3<f64>, b: &Point3<f64>) -> std::cmp::Ordering {
    let mut pairs = a.iter().zip(b.iter()).map(|(a, b)| a.total_cmp(b));
    pairs
        .find(|order| order.is_ne())
        .unwrap_or(std::cmp::Ordering::Equal)
}

/// Joins the points of a cube of the top level, which are sorted.
fn join_block(
    block: &[([i64; 3], u64, SeenPoint)],
    top: i32,
    centers: &[Point3<f64>],
) -> Vec<JoinedPoint> {
    let positions: Vec<Point3<f64>> = block.iter().map(|(.., point)| point.position).collect();
    let codes: Vec<u64> = block.iter().map(|(_, code, _)| *code).collect();
    let patches = patches(&positions, &codes, f64::from(top).exp2());
    let mut joined = Vec::new();
    let mut groups: Vec<(u32, u64, bool, usize)> = Vec::new();
    for (index, (_, code, point)) in block.iter().enumerate() {
        match patches[index].filter(|patch| is_dense(point, patch)) {
            Some(patch) => {
                let depth = depth_of(SIDE_SIGMAS * patch.sigma, top);
                let cube = code >> (3 * (DEPTH - depth));
                groups.push((depth, cube, is_in_front(point, &patch, centers), index));
            }
            None => {
                let mut alone = JoinedPoint::alone(point.clone());
                // Where points are sparse, triangles reach from one to the next.
                let spacing = patches[index].map_or(0.0, |patch| patch.spacing);
                alone.reach = alone.reach.map(|it| it.max(REACH_SPACINGS * spacing));
                joined.push(alone);
            }
        }
    }
    groups.sort_unstable();
    for group in groups.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        let members = group
            .iter()
            .map(|(.., index)| (&block[*index].2, patches[*index]));
        let side = f64::from(top - group[0].0 as i32).exp2();
        joined.push(together(members, side));
    }
    joined
}

/// The depth below the top level of the cubes whose side is nearest to a length.
fn depth_of(side: f64, top: i32) -> u32 {
    let level = side.log2().round();
    // False also for NaN; a length of zero has the smallest cubes.
    match level < f64::from(top) {
        true => ((f64::from(top) - level).min(f64::from(DEPTH))) as u32,
        false => 0,
    }
}

fn is_dense(point: &SeenPoint, patch: &Patch) -> bool {
    (point.pixel).is_some_and(|pixel| patch.spacing <= DENSE_PX * pixel)
}

/// Whether a point was seen from the side to which the normal of the surface around it points.
fn is_in_front(point: &SeenPoint, patch: &Patch, centers: &[Point3<f64>]) -> bool {
    let towards = |view: &u32| (centers[*view as usize] - point.position).normalize();
    let towards: Vector3<f64> = point.views.iter().map(towards).sum();
    towards.dot(&patch.normal) > 0.0
}

impl JoinedPoint {
    /// A point that stays as it is.
    pub(crate) fn alone(point: SeenPoint) -> Self {
        Self {
            position: point.position,
            color: point.color,
            rays: point.views.into_iter().map(|view| [view, 1]).collect(),
            sigma: point.sigma,
            reach: point.pixel.map(|pixel| REACH_PX * pixel),
            is_dense: false,
        }
    }
}

/// The mean of points.
fn together<'a>(
    members: impl Iterator<Item = (&'a SeenPoint, Option<Patch>)> + Clone,
    side: f64,
) -> JoinedPoint {
    let count = members.clone().count() as f64;
    let mean = |value: &dyn Fn(&SeenPoint, &Patch) -> f64| {
        let values = members
            .clone()
            .filter_map(|(point, patch)| Some(value(point, &patch?)));
        values.sum::<f64>() / count
    };
    let position = std::array::from_fn::<f64, 3, _>(|k| mean(&|point, _| point.position[k]));
    let sigma = mean(&|_, patch| patch.sigma) / count.sqrt().min(LARGEST_GAIN);
    let spacing = mean(&|_, patch| patch.spacing).max(side);
    let pixels = members.clone().filter_map(|(point, _)| point.pixel);
    let reach = (REACH_PX * pixels.fold(0.0, f64::max)).max(REACH_SPACINGS * spacing);
    let colors: Vec<[u8; 3]> = members
        .clone()
        .filter_map(|(point, _)| point.color)
        .collect();
    let channel = |k: usize| {
        let sum: usize = colors.iter().map(|color| usize::from(color[k])).sum();
        ((sum + colors.len() / 2) / colors.len().max(1)) as u8
    };
    let mut views: Vec<u32> = members
        .flat_map(|(point, _)| point.views.iter().copied())
        .collect();
    views.sort_unstable();
    let rays = views.chunk_by(|a, b| a == b);
    JoinedPoint {
        position: Point3::from(position),
        color: (!colors.is_empty()).then(|| [0, 1, 2].map(channel)),
        rays: rays.map(|view| [view[0], view.len() as u32]).collect(),
        sigma: Some(sigma),
        reach: Some(reach),
        is_dense: true,
    }
}
