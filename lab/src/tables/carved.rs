//! Surfaces carved from the end points of segments, with the labels of the paper's public code beside others.

use linecarve_carving::internals::flow::{Network, NodeId};
use linecarve_carving::{
    Carver, CarverOptions, CellId, CutOptions, Labels, TransactionError, VertexId, Votes,
};
use linecarve_mesh::Shape;
use nalgebra::{Point3, Vector3};
use serde::Serialize;

use crate::baselines::FoundSegment;

/// Half the side of the cube that the public code carves, in units of its map.
const HALF_SIDE: f64 = 20.0;
/// Cost of a unit of area of the surface against a unit of volume with the wrong label, in the public code.
const AREA_WEIGHT: f64 = 0.05;
/// Capacities are integers: this many for a unit. The cube has 64 000 units of volume, far below the range.
const RESOLUTION: f64 = (1_u64 << 40) as f64;

/// Which cells are free.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum CellLabels {
    /// Those that a ray crosses.
    Votes,
    /// The minimum cut of the public code: a label against the votes costs the volume of the cell, the surface 0.05 of its area.
    VolumeArea,
    /// The minimum cut of the product.
    Cut,
}

impl CellLabels {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Votes, Self::VolumeArea, Self::Cut];

    /// Name in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Votes => "votes",
            Self::VolumeArea => "volume against area",
            Self::Cut => "our cut",
        }
    }
}

/// The surface between free and occupied cells of the tetrahedralisation of all end points.
///
/// As in the public code of the paper every end has one ray, to the keyframe of its segment; space is a cube of 40 units around the
/// first keyframe, beyond which points are left out; triangles with a corner of the cube are left out; and nothing joins points or filters
/// triangles. `unit` is the length of a unit of the paper's maps, whose median depth is about 1. Segments without a keyframe are left out.
///
/// *Differs from the public code*: all rays are kept, where it forgets all but the first of a cell.
///
/// # Errors
/// When a camera is not at a finite position.
///
/// # Reference
/// S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018,
/// section IV-D; D. Lovi, N. Birkbeck, D. Cobzas, M. Jagersand, Incremental free-space carving for real-time 3D reconstruction,
/// 3DPVT 2010.
pub fn carve(
    segments: &[FoundSegment],
    centers: &[Point3<f64>],
    labels: CellLabels,
    unit: f64,
) -> Result<Shape, TransactionError> {
    let carver_labels = match labels {
        CellLabels::Votes | CellLabels::VolumeArea => Labels::Votes(Votes::default()),
        CellLabels::Cut => Labels::Cut(CutOptions::default()),
    };
    let Some(first) = centers.first() else {
        return Ok(Shape::default());
    };
    let half = HALF_SIDE * unit;
    let mut carver = Carver::new(CarverOptions::with_labels(carver_labels));
    let mut transaction = carver.transaction();
    let mut corners = Vec::new();
    for corner in 0..8 {
        let side = |axis: u32| if corner >> axis & 1 == 0 { -half } else { half };
        corners.push(transaction.add_point(first + Vector3::new(side(0), side(1), side(2)))?);
    }
    let mut views = Vec::new();
    for center in centers {
        views.push(transaction.add_view(*center)?);
    }
    for segment in segments {
        let view = segment
            .keyframe
            .and_then(|number| views.get(number as usize));
        let Some(&view) = view else {
            continue;
        };
        let center = centers[view.0 as usize];
        for end in segment.ends_in_world {
            // False for coordinates that are not numbers, too.
            if (end - first).amax() < half && end != center {
                let point = transaction.add_point(end)?;
                transaction.add_observation(view, point, 1)?;
            }
        }
    }
    transaction.commit()?;
    let corners: Vec<VertexId> = corners
        .iter()
        .filter_map(|corner| carver.vertex_of(*corner))
        .collect();
    let is_free = match labels {
        CellLabels::Votes | CellLabels::Cut => cells(&carver, |cell| carver.is_free(cell)),
        CellLabels::VolumeArea => volume_against_area(&carver, &corners, unit),
    };
    Ok(surface(&carver, &corners, &is_free))
}

/// A property of every finite cell, by its index; false for ghosts.
fn cells(carver: &Carver, property: impl Fn(CellId) -> bool) -> Vec<bool> {
    let tetrahedra = carver.tetrahedra();
    let mut found = vec![false; tetrahedra.cell_capacity()];
    for cell in tetrahedra
        .cells()
        .filter(|cell| !tetrahedra.is_ghost(*cell))
    {
        found[cell.index()] = property(cell);
    }
    found
}

/// The three vertices of a facet, the one opposite a corner of the cell.
fn facet_vertices(vertices: [VertexId; 4], facet: usize) -> [VertexId; 3] {
    std::array::from_fn(|corner| vertices[if corner < facet { corner } else { corner + 1 }])
}

/// Labels of the public code.
fn volume_against_area(carver: &Carver, corners: &[VertexId], unit: f64) -> Vec<bool> {
    let tetrahedra = carver.tetrahedra();
    let at = |vertex: VertexId| tetrahedra.position(vertex).coords / unit;
    let node = |cell: CellId| NodeId(cell.index() as u32);
    let mut network = Network::new();
    network.grow(tetrahedra.cell_capacity());
    for cell in tetrahedra
        .cells()
        .filter(|cell| !tetrahedra.is_ghost(*cell))
    {
        let vertices = tetrahedra.cell_vertices(cell);
        let [a, b, c, d] = vertices.map(at);
        let volume = (b - a).cross(&(c - a)).dot(&(d - a)).abs() / 6.0;
        let votes = (volume * RESOLUTION).round() as i64;
        network.set_terminal(
            node(cell),
            if carver.weight(cell) > 0 {
                votes
            } else {
                -votes
            },
        );
        for facet in 0..4 {
            let (other, back) = tetrahedra.neighbor(cell, facet);
            let triangle = facet_vertices(vertices, facet);
            let is_outer = triangle.iter().any(|vertex| corners.contains(vertex));
            if tetrahedra.is_ghost(other) || is_outer {
                continue;
            }
            let [p, q, r] = triangle.map(at);
            let area = 0.5 * (q - p).cross(&(r - p)).norm();
            network.join(node(cell), facet, node(other), back);
            // The other cell sets the arc back.
            let capacity = (AREA_WEIGHT * area * RESOLUTION).round() as i64;
            network.set_capacity(node(cell), facet, capacity);
        }
    }
    network.maximize();
    cells(carver, |cell| network.is_source_side(node(cell)))
}

/// The facets between free and occupied cells, seen from the free ones, without those at the corners of the cube.
fn surface(carver: &Carver, corners: &[VertexId], is_free: &[bool]) -> Shape {
    let tetrahedra = carver.tetrahedra();
    let mut number = vec![u32::MAX; tetrahedra.vertex_capacity()];
    let mut shape = Shape::default();
    for cell in tetrahedra.cells().filter(|cell| is_free[cell.index()]) {
        let vertices = tetrahedra.cell_vertices(cell);
        for facet in 0..4 {
            let (other, _) = tetrahedra.neighbor(cell, facet);
            let mut triangle = facet_vertices(vertices, facet);
            let is_outer = triangle.iter().any(|vertex| corners.contains(vertex));
            if tetrahedra.is_ghost(other) || is_free[other.index()] || is_outer {
                continue;
            }
            let [a, b, c] = triangle.map(|vertex| tetrahedra.position(vertex));
            let inside = tetrahedra.position(vertices[facet]) - a;
            if (b - a).cross(&(c - a)).dot(&inside) < 0.0 {
                triangle.swap(1, 2);
            }
            shape.triangles.push(triangle.map(|vertex| {
                let number = &mut number[vertex.index()];
                if *number == u32::MAX {
                    *number = shape.positions.len() as u32;
                    shape.positions.push(tetrahedra.position(vertex));
                }
                *number
            }));
        }
    }
    shape
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ends on the walls of a room of 4 x 4 x 4 around the camera, on a grid.
    fn room() -> (Vec<FoundSegment>, Vec<Point3<f64>>) {
        let steps = [-2.0, -1.2, -0.4, 0.4, 1.2, 2.0_f64];
        let mut segments = Vec::new();
        for (axis, side) in [
            (0, -2.0),
            (0, 2.0),
            (1, -2.0),
            (1, 2.0),
            (2, -2.0),
            (2, 2.0),
        ] {
            for u in steps {
                for pair in steps.windows(2).step_by(2) {
                    let end = |v: f64| {
                        let mut point = Point3::origin();
                        (point[axis], point[(axis + 1) % 3], point[(axis + 2) % 3]) = (side, u, v);
                        point
                    };
                    segments.push(FoundSegment {
                        ends_in_world: [end(pair[0]), end(pair[1])],
                        keyframe: Some(0),
                    });
                }
            }
        }
        (segments, vec![Point3::new(0.05, 0.02, -0.03)])
    }

    #[test]
    fn all_labels_carve_a_room() {
        let (segments, centers) = room();
        for labels in CellLabels::ALL {
            let shape = carve(&segments, &centers, labels, 1.0).unwrap();
            assert!(
                shape.triangles.len() > 100,
                "{labels:?}: {}",
                shape.triangles.len()
            );
            // Signed volume, negative because the room is seen from inside.
            let volume: f64 = shape
                .triangles
                .iter()
                .map(|triangle| {
                    let [a, b, c] = triangle.map(|i| shape.positions[i as usize].coords);
                    a.cross(&b).dot(&c) / 6.0
                })
                .sum();
            assert!((-64.01..-50.0).contains(&volume), "{labels:?}: {volume}");
        }
    }

    #[test]
    fn volume_against_area_depends_on_the_unit() {
        let (segments, centers) = room();
        // In a unit of 1000 lengths the surface costs far more than the room.
        let shape = carve(&segments, &centers, CellLabels::VolumeArea, 1000.0).unwrap();
        assert!(shape.triangles.is_empty());
    }

    #[test]
    fn nothing_and_segments_of_several_keyframes_carve_nothing() {
        let nothing = carve(&[], &[], CellLabels::Votes, 1.0).unwrap();
        assert!(nothing.positions.is_empty());
        let (mut segments, centers) = room();
        for segment in &mut segments {
            segment.keyframe = None;
        }
        let shape = carve(&segments, &centers, CellLabels::VolumeArea, 1.0).unwrap();
        assert!(shape.triangles.is_empty());
    }
}
