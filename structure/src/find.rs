//! From a mesh to planes, polygons and what they measure.

use linecarve_mesh::TriangleMesh;
use nalgebra::{Point3, Vector3};

use crate::border::{chains, place};
use crate::directions::{Directions, align, directions};
use crate::estimate::{Measured, measure};
use crate::grow::{Region, grow, mean_normal, noise};
use crate::kind::{Kind, kinds, size};
use crate::label::{Labels, REST, Tolerances};
use crate::measures::{angles, distances, edges};
use crate::merge::merge;
use crate::plane::Plane;
use crate::polygon::{Filled, fill, rings};
use crate::straighten::{Straightener, lines_in};
use crate::structure::{Polygon, Structure, StructureOptions, StructurePlane};
use crate::surface::{Surface, rank, unique};

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
    // Sums of coordinates are accurate around the middle of the bounding box.
    let boxes = mesh.positions.iter().map(|it| (*it, *it));
    let bounds = boxes.reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
    let origin = bounds.map_or(Vector3::zeros(), |(low, high)| {
        nalgebra::center(&low, &high).coords
    });
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

struct Finder<'a> {
    surface: &'a Surface,
    options: &'a StructureOptions,
    measured: Vec<Measured>,
    is_aligned: Vec<bool>,
    directions: Option<Directions>,
    labels: Labels<'a>,
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
        let regions = merge(grow(surface, sigma), sigma);
        let mut of = vec![REST; surface.triangles.len()];
        for (number, region) in (0..).zip(&regions) {
            region
                .triangles
                .iter()
                .for_each(|it| of[*it as usize] = number);
        }
        let measured = (regions.iter()).map(|region| {
            let positions = samples(surface, &of, &region.triangles);
            measure(&region.plane, &positions, sigma / 10.0)
        });
        let measured: Vec<Measured> = measured.collect();
        let area = |it: &Region| mean_normal(surface, &it.triangles).norm();
        let areas: Vec<f64> = regions.iter().map(area).collect();
        let directions = directions(&measured, &areas, &options.up);
        let aligned = |it: &Measured| directions.as_ref().and_then(|found| align(it, found));
        let aligned: Vec<Option<Plane>> = measured.iter().map(aligned).collect();
        let planes = aligned
            .iter()
            .zip(&measured)
            .map(|(it, own)| it.unwrap_or(own.plane));
        let labels = Labels {
            surface,
            planes: planes.collect(),
            of,
            tolerances: Tolerances {
                sigma,
                edge: (0.5 * surface.edge_length).max(sigma),
            },
        };
        Self {
            surface,
            options,
            is_aligned: aligned.iter().map(Option::is_some).collect(),
            measured,
            directions,
            labels,
        }
    }

    fn structure(mut self, segments: &[[Point3<f64>; 2]]) -> Structure {
        self.labels.release_far();
        self.labels.complete();
        // Where rings crossed: borders there are not straightened any more, and then triangles there lose their plane.
        let mut is_raw = vec![false; self.surface.positions.len()];
        for round in 1.. {
            let attempt = self.attempt(segments, &is_raw);
            if attempt.filled.iter().all(Result::is_ok) {
                return self.finish(attempt);
            }
            self.release_faults(&attempt, round >= ROUNDS, &mut is_raw);
        }
        unreachable!("in every round after the last one a polygon is lost")
    }

    /// Marks the vertices where rings crossed. Triangles at vertices that were marked before lose their plane, or whole components.
    fn release_faults(&mut self, attempt: &Attempt, is_whole: bool, is_raw: &mut [bool]) {
        let was_raw = is_raw.to_vec();
        for (component, filled) in (0..).zip(&attempt.filled) {
            let Err(vertices) = filled else { continue };
            let is_own = |it: &usize| attempt.component[*it] == component;
            for &vertex in vertices {
                is_raw[vertex as usize] = true;
                let at = self
                    .surface
                    .triangles_at(vertex)
                    .iter()
                    .map(|it| *it as usize);
                for triangle in at.filter(|_| was_raw[vertex as usize]).filter(is_own) {
                    self.labels.of[triangle] = REST;
                    let corners = self.surface.triangles[triangle];
                    corners.iter().for_each(|it| is_raw[*it as usize] = true);
                }
            }
            if is_whole {
                let all = 0..attempt.component.len();
                all.filter(is_own).for_each(|it| self.labels.of[it] = REST);
            }
        }
    }

    fn attempt(&mut self, segments: &[[Point3<f64>; 2]], is_raw: &[bool]) -> Attempt {
        let surface = self.surface;
        self.labels.clean(self.options.most_polygons);
        let mut positions = place(&mut self.labels);
        let (component, plane_of) = self.labels.polygons();
        let chains = chains(surface, &component);
        let tolerance = self.labels.tolerances.corner();
        let planes = &self.labels.planes;
        let lines = planes
            .iter()
            .map(|plane| lines_in(plane, segments, tolerance));
        let straightener = Straightener {
            planes,
            plane_of: &plane_of,
            lines: &lines.collect::<Vec<_>>(),
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
            // What the mesh does not resolve is no hole.
            let is_hole = |ring: &[u32], area: f64| {
                ring.iter().any(|it| is_joined[*it as usize]) || area > tolerance * tolerance
            };
            fill(rings, &positions, &planes[*plane as usize], is_hole)
        });
        Attempt {
            filled: filled.collect(),
            component,
            plane_of,
            positions,
        }
    }

    fn finish(&self, attempt: Attempt) -> Structure {
        let areas = self.labels.areas();
        let mut order = unique(attempt.plane_of.iter().copied());
        order.sort_by(|a, b| areas[*b as usize].total_cmp(&areas[*a as usize]));
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
        let used = compact(&mut polygons, &mut rest);
        let color = |colors: &Vec<[u8; 3]>| used.iter().map(|it| colors[*it as usize]).collect();
        let planes = order.iter().map(|&number| self.plane(number as usize));
        let mut found = Structure {
            positions: used
                .iter()
                .map(|it| attempt.positions[*it as usize])
                .collect(),
            colors: self.surface.colors.as_ref().map(color),
            planes: planes.collect(),
            polygons,
            rest,
            distances: Vec::new(),
            edges: Vec::new(),
            angles: Vec::new(),
            main_directions: self.directions.map(|it| it.axes),
            up: self
                .directions
                .map_or(self.options.up.normalize(), |it| it.axes[2]),
            noise: self.labels.tolerances.sigma,
            tolerance: self.labels.tolerances.corner(),
            mesh_area: self.surface.areas.iter().sum(),
        };
        let areas = found.polygons.iter().map(|it| found.area_of(&it.triangles));
        for (polygon, area) in found.polygons.iter().zip(areas.collect::<Vec<_>>()) {
            let plane = &mut found.planes[polygon.plane as usize];
            plane.area += area;
            plane.polygons += 1;
        }
        for (number, kind) in kinds(&found).into_iter().enumerate() {
            found.planes[number].kind = kind;
            found.planes[number].size = size(&found, number as u32);
            found.planes[number].name = format!("plane_{number:03}_{}", kind.name());
        }
        let measured: Vec<Measured> = order.iter().map(|it| self.measured[*it as usize]).collect();
        found.distances = distances(&found, &measured, self.directions.as_ref());
        found.edges = edges(&found);
        found.angles = angles(&found, &measured);
        found
    }

    /// A plane without what its polygons say about it.
    fn plane(&self, number: usize) -> StructurePlane {
        let (plane, measured) = (&self.labels.planes[number], &self.measured[number]);
        StructurePlane {
            name: String::new(),
            kind: Kind::Other,
            polygons: 0,
            normal: plane.normal,
            offset: plane.offset,
            center: plane.center,
            area: 0.0,
            size: [0.0; 2],
            rms: measured.rms,
            sigma: measured.sigma(),
            is_aligned: self.is_aligned[number],
            color: self
                .surface
                .colors
                .as_ref()
                .map(|it| self.color(number, it)),
        }
    }

    /// Mean colour of the corners of the triangles of a plane.
    fn color(&self, number: usize, colors: &[[u8; 3]]) -> [u8; 3] {
        let triangles = self.surface.triangles.iter().zip(&self.labels.of);
        let own = triangles.filter(|it| *it.1 as usize == number);
        let (mut count, mut sum) = (0_u64, [0_u64; 3]);
        for corner in own.flat_map(|it| it.0) {
            count += 1;
            let color = colors[*corner as usize];
            (0..3).for_each(|channel| sum[channel] += u64::from(color[channel]));
        }
        sum.map(|channel| (channel / count.max(1)) as u8)
    }
}

/// The positions of a plane's vertices: those around which all triangles lie on it, or all when these are few.
fn samples(surface: &Surface, labels: &[u32], triangles: &[u32]) -> Vec<Point3<f64>> {
    let vertices = surface.vertices_of(triangles);
    let label = labels[triangles[0] as usize];
    let is_inside = |vertex: &u32| {
        let around = surface.triangles_at(*vertex);
        around.iter().all(|it| labels[*it as usize] == label)
    };
    let inside: Vec<u32> = vertices.iter().copied().filter(is_inside).collect();
    let used = if inside.len() < 12 { vertices } else { inside };
    used.iter()
        .map(|it| surface.positions[*it as usize])
        .collect()
}

/// Numbers used vertices anew, in the order of the surface, and returns them.
fn compact(polygons: &mut [Polygon], rest: &mut [[u32; 3]]) -> Vec<u32> {
    let in_polygons = polygons.iter().flat_map(|it| it.rings.iter().flatten());
    let used = unique(in_polygons.chain(rest.iter().flatten()).copied());
    let renumber = |vertex: &mut u32| *vertex = rank(&used, vertex);
    for polygon in polygons {
        polygon.rings.iter_mut().flatten().for_each(renumber);
        polygon.triangles.iter_mut().flatten().for_each(renumber);
    }
    rest.iter_mut().flatten().for_each(renumber);
    used
}
