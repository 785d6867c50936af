//! A wall two units before the camera, and a spurious point half way to it.

use std::collections::BTreeMap;
use std::ops::Range;

use linecarve_carving::{Carver, CarverOptions, Labels, PointId, Votes};
use linecarve_lines::depth::{InverseDepth, InverseDepthMap};
use linecarve_lines::triangulation::SampleOptions;
use nalgebra::Vector3;

use super::super::vertex_landmarks::VertexLandmarks;
use super::*;

struct Room {
    carver: Carver,
    points: Vec<PointId>,
    vertices: VertexLandmarks,
    validation: DepthValidation,
    stray: PointId,
}

/// Depth of the wall in every `step`-th column.
fn depth(step: usize) -> SurfaceSamples {
    let mut map = InverseDepthMap::unknown(160, 120).unwrap();
    for (x, y) in (0..160)
        .step_by(step)
        .flat_map(|x| (0..120).map(move |y| (x, y)))
    {
        map.set(x, y, InverseDepth::new(0.5, 0.002));
    }
    SurfaceSamples::measure(&map, &SampleOptions::default())
}

impl Room {
    fn new() -> Self {
        let camera = Camera::pinhole(100.0, 100.0, 79.5, 59.5).unwrap();
        let votes = Labels::Votes(Votes::default());
        let mut carver = Carver::new(CarverOptions::with_labels(votes));
        let mut transaction = carver.transaction();
        let mut positions = Vec::new();
        for (i, j) in (-4..=4).flat_map(|i| (-3..=3).map(move |j| (i, j))) {
            // A little relief, so that a tetrahedron has a volume.
            let relief = 0.002 * f64::from((i * i + 3 * j) % 5);
            positions.push([0.3 * f64::from(i), 0.3 * f64::from(j), 2.0 + relief]);
        }
        positions.push([0.05, 0.03, 1.0]);
        // Behind the wall, so that there is occupied space.
        positions.push([0.0, 0.0, 3.0]);
        let points: Vec<PointId> = positions
            .iter()
            .map(|p| transaction.add_point(Point3::from(*p)).unwrap())
            .collect();
        transaction.commit().unwrap();
        let stray = points[points.len() - 2];
        Self {
            carver,
            points,
            vertices: VertexLandmarks::default(),
            validation: DepthValidation::new(0.3, 0.02, &camera, &SurfacePointOptions::default()),
            stray,
        }
    }

    /// A view at `x` that observes all points but the one behind the wall.
    fn look(&mut self, x: f64, surface: &SurfaceSamples) {
        let pose = Isometry3::translation(x, 0.0, 0.0);
        let mut transaction = self.carver.transaction();
        let view = transaction.add_view(Point3::new(x, 0.0, 0.0)).unwrap();
        let seen: Vec<u32> = (0..self.points.len() as u32 - 1).collect();
        for point in &self.points[..seen.len()] {
            transaction.add_observation(view, *point, 1).unwrap();
        }
        let report = transaction.commit().unwrap();
        let landmarks = 0..self.points.len() as u32;
        self.vertices
            .update(&self.carver, &self.points, landmarks, &mut Vec::new());
        let map = VertexViews::new(&self.carver, &self.points, &self.vertices);
        self.validation.add_view(view, &pose, surface);
        self.validation.update(map, &report.surface, &seen);
    }

    /// Moves a landmark that the last view still observes.
    fn shift(&mut self, landmark: u32, by: [f64; 3]) {
        let point = self.points[landmark as usize];
        let position = self.carver.point(point).unwrap() + Vector3::from(by);
        let mut transaction = self.carver.transaction();
        transaction.move_point(point, position).unwrap();
        let report = transaction.commit().unwrap();
        self.vertices.update(
            &self.carver,
            &self.points,
            std::iter::once(landmark),
            &mut Vec::new(),
        );
        let map = VertexViews::new(&self.carver, &self.points, &self.vertices);
        self.validation.update(map, &report.surface, &[]);
    }

    /// Evidence of each triangle, by the positions of its corners. Contradictions of agreed samples depend on the order of
    /// views and are left out.
    fn evidence(&self) -> BTreeMap<Vec<[u64; 3]>, FacetEvidence> {
        let counted = |evidence: &FacetEvidence| FacetEvidence {
            contradicted: evidence.contradicted & !evidence.agreed,
            ..*evidence
        };
        let tetrahedra = self.carver.tetrahedra();
        let corners = |triangle: &Triangle| {
            let mut corners: Vec<[u64; 3]> = triangle
                .iter()
                .map(|v| tetrahedra.coordinates(*v).map(f64::to_bits))
                .collect();
            corners.sort_unstable();
            corners
        };
        let known = &self.validation.triangles;
        assert_eq!(known.len(), self.carver.triangle_count());
        known
            .iter()
            .map(|(triangle, evidence)| (corners(triangle), counted(evidence)))
            .collect()
    }

    /// Status of the triangles on the wall, and of those at the stray point.
    fn statuses(&self) -> [Vec<FacetStatus>; 2] {
        let stray = self.carver.vertex_of(self.stray).unwrap();
        let (mut wall, mut spike) = (Vec::new(), Vec::new());
        for triangle in self.carver.triangles() {
            let z = triangle.map(|vertex| self.carver.tetrahedra().position(vertex).z);
            if triangle.contains(&stray) {
                spike.push(self.validation.status(&triangle));
            } else if z.iter().all(|z| *z < 2.5) {
                wall.push(self.validation.status(&triangle));
            }
        }
        assert!(!wall.is_empty());
        [wall, spike]
    }
}

fn are_all(statuses: &[FacetStatus], expected: FacetStatus) -> bool {
    statuses.iter().all(|status| *status == expected)
}

#[test]
fn a_wall_is_measured_and_a_spike_before_it_is_not() {
    let mut room = Room::new();
    room.look(0.02, &depth(1));
    let [wall, spike] = room.statuses();
    assert!(!spike.is_empty());
    assert!(are_all(&wall, FacetStatus::Measured), "{wall:?}");
    assert!(are_all(&spike, FacetStatus::NotMeasured), "{spike:?}");
}

#[test]
fn depth_without_planes_says_nothing() {
    let mut room = Room::new();
    room.look(0.02, &depth(8));
    let [wall, spike] = room.statuses();
    assert!(are_all(&wall, FacetStatus::Unobserved) && are_all(&spike, FacetStatus::Unobserved));
}

/// Depth of the wall in a range of columns.
fn part_of_a_wall(columns: Range<usize>) -> SurfaceSamples {
    let mut map = InverseDepthMap::unknown(160, 120).unwrap();
    for (x, y) in columns.flat_map(|x| (0..120).map(move |y| (x, y))) {
        map.set(x, y, InverseDepth::new(0.5, 0.002));
    }
    SurfaceSamples::measure(&map, &SampleOptions::default())
}

#[test]
fn evidence_does_not_depend_on_the_order_of_events() {
    let looks = [
        (-0.1, part_of_a_wall(0..40)),
        (0.02, part_of_a_wall(70..160)),
        (0.2, depth(8)),
        (0.25, part_of_a_wall(0..40)),
    ];
    // The stray point and one of the wall move before look number `shifts`.
    let evidence_after = |order: [usize; 4], shifts: usize| {
        let mut room = Room::new();
        for (sample, look) in order.into_iter().enumerate() {
            if sample == shifts {
                room.shift(room.points.len() as u32 - 2, [0.03, -0.02, 0.1]);
                room.shift(31, [0.01, 0.02, 0.0]);
            }
            room.look(looks[look].0, &looks[look].1);
        }
        room.evidence()
    };
    let expected = evidence_after([0, 1, 2, 3], 0);
    let partly = |evidence: &FacetEvidence| evidence.agreed != 0 && !evidence.is_complete();
    assert!(expected.values().any(partly));
    for (order, shifts) in [([3, 2, 1, 0], 0), ([1, 3, 0, 2], 2), ([2, 0, 3, 1], 3)] {
        assert!(
            evidence_after(order, shifts) == expected,
            "{order:?}, {shifts}"
        );
    }
}

#[test]
fn a_removed_vertex_comes_back_with_a_triangle() {
    let vertex = VertexId::from_index;
    let mut open = VertexSet::default();
    assert!(!open.remove(vertex(7)));
    open.insert_corners(&[vertex(2), vertex(7), vertex(4)]);
    assert!(open.remove(vertex(7)) && !open.remove(vertex(7)));
    open.insert_corners(&[vertex(7), vertex(1), vertex(0)]);
    assert!(
        [0, 1, 2, 4, 7]
            .into_iter()
            .all(|it| open.remove(vertex(it)))
    );
    assert!((0..9).all(|it| !open.remove(vertex(it))));
}
