//! From a mesh to planes, polygons and what they measure.

use linecarve_mesh::TriangleMesh;
use nalgebra::{Point3, Vector3};

use crate::border::{chains, place};
use crate::directions::{Directions, align, directions};
use crate::estimate::{Measured, measure};
use crate::grow::{grow, mean_normal, noise};
use crate::kind::{Kind, kinds};
use crate::label::{Labels, REST, Tolerances, clean, complete, components, release_far};
use crate::measures::{angles, distances};
use crate::merge::merge;
use crate::plane::Plane;
use crate::polygon::{Filled, fill, rings};
use crate::straighten::{Straightener, lines_in};
use crate::structure::{Polygon, Structure, StructureOptions, StructurePlane};
use crate::surface::Surface;

/// Rounds in which polygons whose rings cross lose their straight borders, and then their plane.
const ROUNDS: usize = 8;

/// Finds planes and polygons in a mesh. `segments` are known straight edges, such as clusters of 3D line segments: borders that run along
/// them are moved onto them.
///
/// # Complexity
/// O(n log n) in the triangles, quadratic in planes and in the corners of a polygon.
pub fn structure(
    mesh: &TriangleMesh,
    segments: &[[Point3<f64>; 2]],
    options: &StructureOptions,
) -> Structure {
    let origin = center_of(&mesh.positions);
    let mut mesh = mesh.clone();
    mesh.translate(&-origin);
    let segments: Vec<[Point3<f64>; 2]> = segments
        .iter()
        .map(|ends| ends.map(|end| end - origin))
        .collect();
    let surface = Surface::new(&mesh);
    let mut found = Finder::new(&surface, options).structure(&segments);
    found.positions.iter_mut().for_each(|it| *it += origin);
    for plane in &mut found.planes {
        plane.center += origin;
        plane.offset += plane.normal.dot(&origin);
    }
    found
}

/// The middle of the bounding box, so that sums of coordinates are accurate.
fn center_of(positions: &[Point3<f64>]) -> Vector3<f64> {
    let Some(first) = positions.first() else {
        return Vector3::zeros();
    };
    let bounds = positions
        .iter()
        .fold((*first, *first), |(a, b), it| (a.inf(it), b.sup(it)));
    nalgebra::center(&bounds.0, &bounds.1).coords
}

struct Finder<'a> {
    surface: &'a Surface,
    options: &'a StructureOptions,
    tolerances: Tolerances,
    measured: Vec<Measured>,
    planes: Vec<Plane>,
    is_aligned: Vec<bool>,
    directions: Option<Directions>,
    labels: Labels,
}

/// What the rings of all components came to.
struct Attempt {
    component: Vec<u32>,
    plane_of: Vec<u32>,
    positions: Vec<Point3<f64>>,
    filled: Vec<Result<Filled, Vec<u32>>>,
}

impl<'a> Finder<'a> {
    fn new(surface: &'a Surface, options: &'a StructureOptions) -> Self {
        let sigma = noise(surface);
        let tolerances = Tolerances {
            sigma,
            edge: (0.5 * surface.edge_length).max(sigma),
        };
        let regions = merge(grow(surface, sigma), sigma);
        let mut labels = vec![REST; surface.triangles.len()];
        for (number, region) in (0..).zip(&regions) {
            region
                .triangles
                .iter()
                .for_each(|it| labels[*it as usize] = number);
        }
        let measured: Vec<Measured> = (regions.iter())
            .map(|region| {
                measure(
                    &region.plane,
                    &samples(surface, &labels, &region.triangles),
                    sigma / 10.0,
                )
            })
            .collect();
        let areas: Vec<f64> = (regions.iter())
            .map(|region| mean_normal(surface, &region.triangles).norm())
            .collect();
        let directions = directions(&measured, &areas, &options.up);
        let aligned = |it: &Measured| directions.as_ref().and_then(|found| align(it, found));
        let aligned: Vec<Option<Plane>> = measured.iter().map(aligned).collect();
        let planes = aligned
            .iter()
            .zip(&measured)
            .map(|(it, own)| it.unwrap_or(own.plane));
        Self {
            surface,
            options,
            tolerances,
            planes: planes.collect(),
            is_aligned: aligned.iter().map(Option::is_some).collect(),
            measured,
            directions,
            labels,
        }
    }

    /// Area of the triangles of each plane.
    fn areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.planes.len()];
        for (label, area) in self.labels.iter().zip(&self.surface.areas) {
            if *label != REST {
                areas[*label as usize] += area;
            }
        }
        areas
    }

    fn structure(mut self, segments: &[[Point3<f64>; 2]]) -> Structure {
        release_far(
            self.surface,
            &self.planes,
            &mut self.labels,
            &self.tolerances,
        );
        complete(
            self.surface,
            &self.planes,
            &mut self.labels,
            &self.tolerances,
        );
        // Where rings crossed: borders there are not straightened any more, and then triangles there lose their plane.
        let mut is_raw = vec![false; self.surface.positions.len()];
        for round in 1.. {
            let attempt = self.attempt(segments, &is_raw);
            let mut is_complete = true;
            let faults = (0..)
                .zip(&attempt.filled)
                .filter_map(|(it, filled)| Some((it, filled.as_ref().err()?)));
            let mut next_raw = is_raw.clone();
            for (component, vertices) in faults {
                is_complete = false;
                for &vertex in vertices {
                    if is_raw[vertex as usize] {
                        for triangle in self.surface.triangles_at(vertex) {
                            if attempt.component[*triangle as usize] == component {
                                self.labels[*triangle as usize] = REST;
                                let corners = self.surface.triangles[*triangle as usize];
                                corners.iter().for_each(|it| next_raw[*it as usize] = true);
                            }
                        }
                    }
                    next_raw[vertex as usize] = true;
                }
                if round >= ROUNDS {
                    let own = attempt.component.iter().zip(&mut self.labels);
                    own.filter(|it| *it.0 == component)
                        .for_each(|it| *it.1 = REST);
                }
            }
            is_raw = next_raw;
            if is_complete {
                return self.finish(attempt);
            }
        }
        unreachable!("in every round after the last one a polygon is lost")
    }

    fn attempt(&mut self, segments: &[[Point3<f64>; 2]], is_raw: &[bool]) -> Attempt {
        let surface = self.surface;
        let most = self.options.most_polygons;
        clean(
            surface,
            &self.planes,
            &mut self.labels,
            &self.tolerances,
            most,
        );
        let areas = self.areas();
        let mut positions = place(
            surface,
            &self.planes,
            &areas,
            &mut self.labels,
            &self.tolerances,
        );
        let (component, plane_of) = self.polygons();
        let chains = chains(surface, &component);
        let tolerance = self.tolerances.corner();
        let lines: Vec<_> = (self.planes.iter())
            .map(|plane| lines_in(plane, segments, tolerance))
            .collect();
        let straightener = Straightener {
            planes: &self.planes,
            plane_of: &plane_of,
            lines: &lines,
            tolerance,
        };
        let mut is_corner = vec![false; positions.len()];
        let mut is_joined = vec![false; positions.len()];
        for chain in &chains {
            if chain.around.len() > 1 {
                chain
                    .vertices
                    .iter()
                    .for_each(|it| is_joined[*it as usize] = true);
            }
            straightener.straighten(chain, is_raw, &mut positions, &mut is_corner);
        }
        let rings = rings(surface, &component, plane_of.len(), &is_corner);
        let filled = rings.iter().zip(&plane_of).map(|(rings, plane)| {
            let plane = &self.planes[*plane as usize];
            // What the mesh does not resolve is no hole.
            let is_hole = |ring: &[u32], area: f64| {
                ring.iter().any(|it| is_joined[*it as usize]) || area > tolerance * tolerance
            };
            fill(rings, &positions, plane, is_hole)
        });
        Attempt {
            filled: filled.collect(),
            component,
            plane_of,
            positions,
        }
    }

    /// The component of each triangle, [`REST`] without a plane, and the plane of each component.
    fn polygons(&self) -> (Vec<u32>, Vec<u32>) {
        let (mut of, count) = components(self.surface, &self.labels);
        let mut number = vec![REST; count];
        let mut plane_of = Vec::new();
        for (component, label) in of.iter_mut().zip(&self.labels) {
            let known = &mut number[*component as usize];
            if *label != REST && *known == REST {
                *known = plane_of.len() as u32;
                plane_of.push(*label);
            }
            *component = *known;
        }
        (of, plane_of)
    }

    fn finish(&self, attempt: Attempt) -> Structure {
        let areas = self.areas();
        let mut order: Vec<u32> = attempt.plane_of.clone();
        order.sort_by(|a, b| {
            areas[*b as usize]
                .total_cmp(&areas[*a as usize])
                .then(a.cmp(b))
        });
        order.dedup();
        let mut polygons: Vec<Polygon> = Vec::new();
        for (filled, plane) in attempt.filled.into_iter().zip(&attempt.plane_of) {
            let Ok(filled) = filled else { continue };
            let place = order.iter().position(|it| it == plane).unwrap_or(0);
            polygons.push(Polygon {
                plane: place as u32,
                rings: filled.rings,
                triangles: filled.triangles,
            });
        }
        polygons.sort_by_key(|it| it.plane);
        let rest = self.surface.triangles.iter().zip(&attempt.component);
        let mut rest: Vec<[u32; 3]> = rest.filter(|it| *it.1 == REST).map(|it| *it.0).collect();
        let (positions, colors) =
            compact(self.surface, &attempt.positions, &mut polygons, &mut rest);
        let up = self
            .directions
            .map_or(self.options.up.normalize(), |it| it.axes[2]);
        let colors_of = self.plane_colors(&order);
        let planes = order.iter().zip(colors_of).map(|(&number, color)| {
            let (plane, measured) = (
                &self.planes[number as usize],
                &self.measured[number as usize],
            );
            StructurePlane {
                normal: plane.normal,
                offset: plane.offset,
                center: plane.center,
                area: 0.0,
                rms: measured.rms,
                sigma: measured.sigma(),
                kind: Kind::Other,
                is_aligned: self.is_aligned[number as usize],
                color,
            }
        });
        let mut found = Structure {
            positions,
            colors,
            planes: planes.collect(),
            polygons,
            rest,
            distances: Vec::new(),
            angles: Vec::new(),
            main_directions: self.directions.map(|it| it.axes),
            up,
            noise: self.tolerances.sigma,
            tolerance: self.tolerances.corner(),
            mesh_area: self.surface.areas.iter().sum(),
        };
        for polygon in 0..found.polygons.len() {
            let own = &found.polygons[polygon];
            let (plane, area) = (own.plane as usize, found.area_of(&own.triangles));
            found.planes[plane].area += area;
        }
        for (plane, kind) in kinds(&found).into_iter().enumerate() {
            found.planes[plane].kind = kind;
        }
        let measured: Vec<Measured> = order.iter().map(|it| self.measured[*it as usize]).collect();
        found.distances = distances(&found, &measured, self.directions.as_ref());
        found.angles = angles(&found, &measured);
        found
    }

    /// Mean colour of the vertices of each plane.
    fn plane_colors(&self, order: &[u32]) -> Vec<Option<[u8; 3]>> {
        let mut sums = vec![(0_u64, [0_u64; 3]); self.planes.len()];
        let Some(colors) = &self.surface.colors else {
            return vec![None; order.len()];
        };
        for (triangle, label) in self.surface.triangles.iter().zip(&self.labels) {
            if *label == REST {
                continue;
            }
            let (count, sum) = &mut sums[*label as usize];
            for corner in triangle {
                *count += 1;
                let color = colors[*corner as usize];
                (0..3).for_each(|channel| sum[channel] += u64::from(color[channel]));
            }
        }
        let mean = |it: &u32| {
            let (count, sum) = sums[*it as usize];
            Some(sum.map(|channel| (channel / count.max(1)) as u8))
        };
        order.iter().map(mean).collect()
    }
}

/// The positions of a plane's vertices: those around which all triangles lie on it, or all when these are few.
fn samples(surface: &Surface, labels: &Labels, triangles: &[u32]) -> Vec<Point3<f64>> {
    let mut vertices: Vec<u32> = triangles
        .iter()
        .flat_map(|it| surface.triangles[*it as usize])
        .collect();
    vertices.sort_unstable();
    vertices.dedup();
    let label = labels[triangles[0] as usize];
    let is_inside = |vertex: &u32| {
        let around = surface.triangles_at(*vertex);
        around.iter().all(|it| labels[*it as usize] == label)
    };
    let inside: Vec<u32> = vertices.iter().copied().filter(is_inside).collect();
    let few = inside.len() < 12;
    let used = if few { &vertices } else { &inside };
    used.iter()
        .map(|it| surface.positions[*it as usize])
        .collect()
}

/// Numbers used vertices anew, in the order of the surface, and returns their positions and colours.
fn compact(
    surface: &Surface,
    all: &[Point3<f64>],
    polygons: &mut [Polygon],
    rest: &mut [[u32; 3]],
) -> (Vec<Point3<f64>>, Option<Vec<[u8; 3]>>) {
    let mut number = vec![REST; all.len()];
    let in_polygons = polygons.iter().flat_map(|it| it.rings.iter().flatten());
    for vertex in in_polygons.chain(rest.iter().flatten()) {
        number[*vertex as usize] = 0;
    }
    let mut positions = Vec::new();
    let mut colors = surface.colors.as_ref().map(|_| Vec::new());
    for vertex in 0..all.len() {
        if number[vertex] == REST {
            continue;
        }
        number[vertex] = positions.len() as u32;
        positions.push(all[vertex]);
        if let (Some(colors), Some(given)) = (&mut colors, &surface.colors) {
            colors.push(given[vertex]);
        }
    }
    let renumber = |vertex: &mut u32| *vertex = number[*vertex as usize];
    for polygon in polygons {
        polygon.rings.iter_mut().flatten().for_each(renumber);
        polygon.triangles.iter_mut().flatten().for_each(renumber);
    }
    rest.iter_mut().flatten().for_each(renumber);
    (positions, colors)
}
