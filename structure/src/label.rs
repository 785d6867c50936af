//! The plane of each triangle: regions, completed at their borders and cleaned.

use nalgebra::Point3;

use crate::grow::REACH;
use crate::plane::Plane;
use crate::surface::{Surface, unique};

/// No plane: the triangle stays a triangle.
pub(crate) const REST: u32 = u32::MAX;

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

/// Triangles that a polygon replaces at least: with fewer it is no shorter than they are.
const LEAST_TRIANGLES: usize = 8;

/// The plane of each triangle.
pub(crate) struct Labels<'a> {
    pub(crate) surface: &'a Surface,
    pub(crate) planes: Vec<Plane>,
    /// Numbers of planes, or [`REST`].
    pub(crate) of: Vec<u32>,
    pub(crate) tolerances: Tolerances,
}

impl Labels<'_> {
    /// Distinct planes of triangles, ascending.
    fn planes_of(&self, triangles: impl Iterator<Item = u32>) -> Vec<u32> {
        let planes = triangles.map(|it| self.of[it as usize]);
        unique(planes.filter(|it| *it != REST))
    }

    /// Distinct planes of the triangles at a vertex, ascending.
    pub(crate) fn planes_at(&self, vertex: u32) -> Vec<u32> {
        self.planes_of(self.surface.triangles_at(vertex).iter().copied())
    }

    /// Area of the triangles of each plane.
    pub(crate) fn areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.planes.len()];
        for (label, area) in self.of.iter().zip(&self.surface.areas) {
            if *label != REST {
                areas[*label as usize] += area;
            }
        }
        areas
    }

    /// How far the farthest corner of a triangle lies from a plane.
    fn misfit(&self, triangle: u32, plane: u32) -> f64 {
        let corners = self.surface.corners(triangle);
        let away = |it: &Point3<f64>| self.planes[plane as usize].distance(it).abs();
        corners.iter().map(away).fold(0.0, f64::max)
    }

    /// Gives triangles beside a plane to it when all corners lie on it, and triangles between planes when each corner lies near one of
    /// them. In rounds, so that the order of triangles does not matter.
    pub(crate) fn complete(&mut self) {
        for _ in 0..24 {
            let all = (0..).zip(&self.of).filter(|it| *it.1 == REST);
            let changes = all.filter_map(|(triangle, _)| Some((triangle, self.joined(triangle)?)));
            let changes: Vec<(u32, u32)> = changes.collect();
            if changes.is_empty() {
                break;
            }
            for (triangle, plane) in changes {
                self.of[triangle as usize] = plane;
            }
        }
    }

    /// The plane that a triangle joins.
    fn joined(&self, triangle: u32) -> Option<u32> {
        let own = self.planes_of(self.surface.neighbours(triangle));
        let own = own.iter().map(|it| (self.misfit(triangle, *it), *it));
        let (worst, best) = own.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let corners = self.surface.triangles[triangle as usize];
        let at_corners = corners.iter().flat_map(|it| self.surface.triangles_at(*it));
        let near = self.planes_of(at_corners.copied());
        let nearest = |corner: &Point3<f64>| {
            let away = near
                .iter()
                .map(|it| self.planes[*it as usize].distance(corner).abs());
            away.fold(f64::INFINITY, f64::min)
        };
        let between = self
            .surface
            .corners(triangle)
            .iter()
            .map(nearest)
            .fold(0.0, f64::max);
        let across = self.tolerances.across();
        let is_between = near.len() > 1
            && between <= across.max(0.5 * self.tolerances.edge)
            && worst <= self.tolerances.corner();
        (worst <= across || is_between).then_some(best)
    }

    /// Takes the plane of triangles that lie further from it than vertices may move: merged and aligned planes are not those that they grew
    /// on.
    pub(crate) fn release_far(&mut self) {
        for triangle in 0..self.of.len() {
            let label = self.of[triangle];
            if label != REST && self.misfit(triangle as u32, label) > self.tolerances.corner() {
                self.of[triangle] = REST;
            }
        }
    }

    /// Connected triangles of one plane, or of none, by their first triangle.
    fn components(&self) -> Vec<Vec<u32>> {
        let mut is_found = vec![false; self.of.len()];
        let mut components = Vec::new();
        for first in 0..self.of.len() {
            if std::mem::replace(&mut is_found[first], true) {
                continue;
            }
            let mut component = vec![first as u32];
            let mut next = 0;
            while let Some(&triangle) = component.get(next) {
                next += 1;
                for other in self.surface.neighbours(triangle) {
                    let is_same = self.of[other as usize] == self.of[first];
                    if is_same && !std::mem::replace(&mut is_found[other as usize], true) {
                        component.push(other);
                    }
                }
            }
            components.push(component);
        }
        components
    }

    /// The component of each triangle, [`REST`] without a plane, and the plane of each component.
    pub(crate) fn polygons(&self) -> (Vec<u32>, Vec<u32>) {
        let mut component_of = vec![REST; self.of.len()];
        let mut plane_of = Vec::new();
        for component in self.components() {
            let plane = self.of[component[0] as usize];
            if plane != REST {
                let number = plane_of.len() as u32;
                component
                    .iter()
                    .for_each(|it| component_of[*it as usize] = number);
                plane_of.push(plane);
            }
        }
        (component_of, plane_of)
    }

    /// Gives islands of few triangles inside one plane to it, when vertices may move so far, and takes the plane of components
    /// that have too little area, or too few triangles, for a polygon, or that are not among the `most` largest.
    pub(crate) fn clean(&mut self, most: usize) {
        for island in self.components() {
            if self.of[island[0] as usize] != REST || island.len() > 2 * LEAST_TRIANGLES {
                continue;
            }
            let across = island
                .iter()
                .flat_map(|it| self.surface.across[*it as usize]);
            let is_closed = across.clone().all(|it| it.is_some());
            if let ([plane], true) = (self.planes_of(across.flatten()).as_slice(), is_closed)
                && island
                    .iter()
                    .all(|it| self.misfit(*it, *plane) <= self.tolerances.corner())
            {
                island.iter().for_each(|it| self.of[*it as usize] = *plane);
            }
        }
        let sized = |it: Vec<u32>| {
            let areas = it.iter().map(|it| self.surface.areas[*it as usize]);
            (areas.sum::<f64>(), it)
        };
        let mut sizes: Vec<(f64, Vec<u32>)> = self.components().into_iter().map(sized).collect();
        sizes.sort_by(|a, b| b.0.total_cmp(&a.0));
        let least_area = (2.0 * self.surface.edge_length).powi(2);
        let mut left = most;
        for (area, component) in sizes {
            if self.of[component[0] as usize] == REST {
                continue;
            }
            if left > 0 && area >= least_area && component.len() >= LEAST_TRIANGLES {
                left -= 1;
            } else {
                component.iter().for_each(|it| self.of[*it as usize] = REST);
            }
        }
    }
}
