//! The plane of each triangle: regions, completed at their borders and cleaned.

use nalgebra::Point3;

use crate::grow::REACH;
use crate::plane::Plane;
use crate::surface::Surface;

/// No plane: the triangle stays a triangle.
pub(crate) const REST: u32 = u32::MAX;

/// The plane of each triangle, or [`REST`].
pub(crate) type Labels = Vec<u32>;

/// How far vertices may move.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tolerances {
    /// Standard deviation of vertices across flat parts.
    pub(crate) sigma: f64,
    /// Where surfaces bend or end they are known to half an edge of the mesh: the samples are so far apart.
    pub(crate) edge: f64,
}

impl Tolerances {
    /// How far a vertex may lie from a plane on which it is taken to be.
    pub(crate) fn across(&self) -> f64 {
        REACH * self.sigma
    }

    /// How far a vertex may move to where planes meet.
    pub(crate) fn corner(&self) -> f64 {
        self.edge.max(std::f64::consts::SQRT_2 * self.across())
    }
}

/// Distinct planes of the triangles at a vertex, ascending.
pub(crate) fn planes_at(surface: &Surface, labels: &Labels, vertex: u32) -> Vec<u32> {
    let around = surface.triangles_at(vertex).iter();
    let mut planes: Vec<u32> = around.map(|it| labels[*it as usize]).collect();
    planes.retain(|it| *it != REST);
    planes.sort_unstable();
    planes.dedup();
    planes
}

/// Gives triangles beside a plane to it when all corners lie on it, and triangles between planes when each corner lies near one of them.
/// In rounds, so that the order of triangles does not matter.
pub(crate) fn complete(
    surface: &Surface,
    planes: &[Plane],
    labels: &mut Labels,
    tolerances: &Tolerances,
) {
    for _ in 0..24 {
        let mut changes: Vec<(u32, u32)> = Vec::new();
        for triangle in 0..surface.triangles.len() as u32 {
            if labels[triangle as usize] != REST {
                continue;
            }
            let mut own: Vec<u32> = surface.neighbours(triangle).collect();
            own = own.iter().map(|it| labels[*it as usize]).collect();
            own.retain(|it| *it != REST);
            own.sort_unstable();
            own.dedup();
            if own.is_empty() {
                continue;
            }
            let mut near = own.clone();
            for corner in surface.triangles[triangle as usize] {
                near.extend(planes_at(surface, labels, corner));
            }
            near.sort_unstable();
            near.dedup();
            let corners = surface.corners(triangle);
            let away = |plane: u32, corner| planes[plane as usize].distance(corner).abs();
            let nearest = |corner| {
                near.iter()
                    .map(|it| away(*it, corner))
                    .fold(f64::INFINITY, f64::min)
            };
            let between = corners.iter().map(nearest).fold(0.0, f64::max);
            let misfit = |plane: &u32| {
                corners
                    .iter()
                    .map(|it| away(*plane, it))
                    .fold(0.0, f64::max)
            };
            let best = own.iter().map(|it| (misfit(it), *it));
            let Some((worst, best)) = best.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
            else {
                continue;
            };
            let is_on = worst <= tolerances.across();
            let is_between = near.len() > 1
                && between <= tolerances.across().max(0.5 * tolerances.edge)
                && worst <= tolerances.corner();
            if is_on || is_between {
                changes.push((triangle, best));
            }
        }
        if changes.is_empty() {
            break;
        }
        for (triangle, plane) in changes {
            labels[triangle as usize] = plane;
        }
    }
}

/// Takes the plane of triangles that lie further from it than vertices may move: merged and aligned planes are not those that they grew on.
pub(crate) fn release_far(
    surface: &Surface,
    planes: &[Plane],
    labels: &mut Labels,
    tolerances: &Tolerances,
) {
    for (triangle, label) in (0..).zip(labels.iter_mut()).filter(|it| *it.1 != REST) {
        let plane = &planes[*label as usize];
        let far = |it: &Point3<f64>| plane.distance(it).abs() > tolerances.corner();
        if surface.corners(triangle).iter().any(far) {
            *label = REST;
        }
    }
}

/// Connected triangles of one plane, or of none: for each triangle its component, and the number of components. Components are numbered by
/// their first triangle.
pub(crate) fn components(surface: &Surface, labels: &Labels) -> (Vec<u32>, usize) {
    let mut of = vec![REST; labels.len()];
    let mut count = 0;
    for first in 0..labels.len() {
        if of[first] != REST {
            continue;
        }
        of[first] = count;
        let mut stack = vec![first as u32];
        while let Some(triangle) = stack.pop() {
            for other in surface.neighbours(triangle) {
                let other = other as usize;
                if of[other] == REST && labels[other] == labels[first] {
                    of[other] = count;
                    stack.push(other as u32);
                }
            }
        }
        count += 1;
    }
    (of, count as usize)
}

/// Gives islands of few triangles inside one plane to it, when vertices may move so far, and takes the plane of components
/// that have too little area, or too few triangles, for a polygon, or that are not among the `most` largest.
pub(crate) fn clean(
    surface: &Surface,
    planes: &[Plane],
    labels: &mut Labels,
    tolerances: &Tolerances,
    most: usize,
) {
    let (of, count) = components(surface, labels);
    let mut members = vec![Vec::new(); count];
    (0..)
        .zip(&of)
        .for_each(|(triangle, it)| members[*it as usize].push(triangle));
    for island in &members {
        if labels[island[0] as usize] != REST || island.len() > 2 * LEAST_TRIANGLES {
            continue;
        }
        let mut around: Vec<u32> = Vec::new();
        let mut is_closed = true;
        for triangle in island {
            for across in surface.across[*triangle as usize] {
                match across {
                    Some(other) => around.push(labels[other as usize]),
                    None => is_closed = false,
                }
            }
        }
        around.retain(|it| *it != REST);
        around.dedup();
        if let ([plane], true) = (around.as_slice(), is_closed) {
            let near = |corner: &Point3<f64>| {
                planes[*plane as usize].distance(corner).abs() <= tolerances.corner()
            };
            if island
                .iter()
                .all(|it| surface.corners(*it).iter().all(near))
            {
                island.iter().for_each(|it| labels[*it as usize] = *plane);
            }
        }
    }
    let (of, count) = components(surface, labels);
    // Area and number of triangles of each component with a plane.
    let mut sizes: Vec<(f64, usize, u32)> = (0..count as u32).map(|it| (0.0, 0, it)).collect();
    for (triangle, component) in of.iter().enumerate() {
        if labels[triangle] != REST {
            let size = &mut sizes[*component as usize];
            *size = (size.0 + surface.areas[triangle], size.1 + 1, *component);
        }
    }
    let least_area = (2.0 * surface.edge_length).powi(2);
    let mut kept = sizes;
    kept.retain(|it| it.0 >= least_area && it.1 >= LEAST_TRIANGLES);
    kept.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.cmp(&b.2)));
    kept.truncate(most);
    let mut is_kept = vec![false; count];
    kept.iter().for_each(|it| is_kept[it.2 as usize] = true);
    for (label, component) in labels.iter_mut().zip(&of) {
        if !is_kept[*component as usize] {
            *label = REST;
        }
    }
}

/// Triangles that a polygon replaces at least: with fewer it is no shorter than they are.
const LEAST_TRIANGLES: usize = 8;
