//! The floor plan: a level section, at the height that shows most of the walls.

use linecarve_mesh::raycast::RayScene;
use nalgebra::{IsometryMatrix3, Point2, Point3, Vector3};
use serde::Serialize;

use crate::kind::{Kind, heights};
use crate::structure::Structure;

/// Heights that are compared.
const HEIGHTS: usize = 64;
/// An opening is at least this share of the height of the room wide.
const LEAST_OPENING: f64 = 0.1;
/// Frames of openings stand out of a wall by less than this share of the smallest opening.
const REACH: f64 = 0.25;

/// A straight piece of a plane in the section.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Piece {
    /// Number of the plane.
    pub plane: u32,
    /// From where to where, in the upright frame.
    pub ends: [Point2<f64>; 2],
}

/// A gap in a wall through which the surface behind was seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Opening {
    /// Number of the wall's plane.
    pub plane: u32,
    /// Clear width at the height of the section: between frames or jambs where these were seen, else of the gap in the wall.
    pub width: f64,
    /// From where to where, in the upright frame.
    pub ends: [Point2<f64>; 2],
}

/// A level section through a structure. Coordinates are in the upright frame, seen from above.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Height of the section in the upright frame.
    pub height: f64,
    /// Height above the floor, when there is one.
    pub above_floor: Option<f64>,
    /// Pieces of upright planes, by plane.
    pub walls: Vec<Piece>,
    /// Everything else that is cut.
    pub rest: Vec<[Point2<f64>; 2]>,
    /// Gaps in walls.
    pub openings: Vec<Opening>,
}

impl Plan {
    /// The section of a structure; `None` when no upright plane can be cut. The height is the one at which walls and their openings are
    /// longest, openings counted twice.
    ///
    /// # Complexity
    /// Linear in the triangles, times the number of heights that are compared.
    pub fn new(structure: &Structure) -> Option<Self> {
        let upright = structure.upright_from_original();
        let ranges = heights(structure, &upright);
        let walls =
            (0..structure.planes.len()).filter(|it| structure.planes[*it].kind == Kind::Wall);
        let [low, high] = walls
            .map(|it| ranges[it])
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])])?;
        let scene = RayScene::new(&structure.mesh());
        // Off the heights of borders, where sections are ambiguous.
        let height = |step: usize| low + (high - low) * (step as f64 + 0.4871) / HEIGHTS as f64;
        let sections: Vec<Vec<Piece>> = (0..HEIGHTS)
            .map(|step| pieces(structure, &upright, height(step)))
            .collect();
        let section = |step: usize| {
            let mut plan = Self {
                height: height(step),
                above_floor: None,
                walls: sections[step].clone(),
                rest: Vec::new(),
                openings: Vec::new(),
            };
            let gaps =
                plan.find_openings(structure, &upright, &scene, LEAST_OPENING * (high - low));
            // The wall goes on above an opening.
            let is_below = |it: &Opening| {
                let above = sections[step + 1..].iter().flatten();
                above.filter(|piece| piece.plane == it.plane).any(|piece| {
                    let along = piece.ends[1] - piece.ends[0];
                    let at = nalgebra::center(&it.ends[0], &it.ends[1]) - piece.ends[0];
                    (0.0..along.norm_squared()).contains(&at.dot(&along))
                })
            };
            plan.openings = gaps.into_iter().filter(is_below).collect();
            plan
        };
        let shown = |plan: &Self| {
            let walls = plan.walls.iter();
            let walls = walls.filter(|it| structure.planes[it.plane as usize].kind == Kind::Wall);
            let length: f64 = walls.map(|it| (it.ends[1] - it.ends[0]).norm()).sum();
            length + 2.0 * plan.openings.iter().map(|it| it.width).sum::<f64>()
        };
        let plans = (0..HEIGHTS).map(section).map(|it| (shown(&it), it));
        let (_, mut plan) = plans.reduce(|best, it| if it.0 > best.0 { it } else { best })?;
        let others = structure
            .polygons
            .iter()
            .filter(|it| !is_upright(structure, it.plane));
        let triangles = others.flat_map(|it| &it.triangles).chain(&structure.rest);
        plan.rest = triangles
            .filter_map(|it| cut(structure, &upright, it, plan.height))
            .collect();
        let least = LEAST_OPENING * (high - low);
        plan.narrow(REACH * least);
        plan.openings.retain(|it| it.width >= least);
        let floor = structure.planes.iter().find(|it| it.kind == Kind::Floor);
        plan.above_floor = floor.map(|it| plan.height - (upright * it.center).z);
        Some(plan)
    }

    /// Gaps between pieces of a wall behind which the surface goes on, with free space in front of them.
    fn find_openings(
        &self,
        structure: &Structure,
        upright: &IsometryMatrix3<f64>,
        scene: &RayScene,
        least: f64,
    ) -> Vec<Opening> {
        let far = scene
            .bounds()
            .map_or(0.0, |(low, high)| (high - low).norm());
        let mut found = Vec::new();
        for pair in self.walls.windows(2) {
            let plane = &structure.planes[pair[0].plane as usize];
            let ends = [pair[0].ends[1], pair[1].ends[0]];
            let width = (ends[1] - ends[0]).norm();
            if pair[0].plane != pair[1].plane || plane.kind != Kind::Wall || width < least {
                continue;
            }
            let is_open = |share: &f64| {
                let at = ends[0] + *share * (ends[1] - ends[0]);
                let at = upright.inverse() * Point3::new(at.x, at.y, self.height);
                let behind = scene.cast(&at, &-plane.normal, far).is_some();
                behind && scene.cast(&at, &plane.normal, 0.5 * width).is_none()
            };
            if [0.25, 0.5, 0.75].iter().filter(|it| is_open(it)).count() < 2 {
                continue;
            }
            found.push(Opening {
                plane: pair[0].plane,
                width,
                ends,
            });
        }
        found
    }

    /// Narrows openings to their clear width: frames and jambs stand in the gap, within `reach` of the plane of the wall.
    fn narrow(&mut self, reach: f64) {
        let cuts: Vec<[Point2<f64>; 2]> = (self.walls.iter().map(|it| it.ends))
            .chain(self.rest.iter().copied())
            .collect();
        for opening in &mut self.openings {
            let along = (opening.ends[1] - opening.ends[0]) / opening.width;
            let middle = nalgebra::center(&opening.ends[0], &opening.ends[1]);
            let mut clear = [-0.5, 0.5].map(|it| it * opening.width);
            for ends in &cuts {
                // Along the wall and across it, as far as the cut is within reach.
                let [a, b] =
                    ends.map(|end| [along.dot(&(end - middle)), along.perp(&(end - middle))]);
                let [s, t] =
                    [-reach, reach].map(|it| ((it - a[1]) / (b[1] - a[1])).clamp(0.0, 1.0));
                if s == t {
                    continue;
                }
                let [s, t] = [s, t].map(|it| a[0] + it * (b[0] - a[0]));
                if s.max(t) <= 0.0 {
                    clear[0] = clear[0].max(s.max(t));
                } else if s.min(t) >= 0.0 {
                    clear[1] = clear[1].min(s.min(t));
                }
            }
            opening.width = clear[1] - clear[0];
            opening.ends = clear.map(|it| middle + it * along);
        }
    }
}

fn is_upright(structure: &Structure, plane: u32) -> bool {
    matches!(
        structure.planes[plane as usize].kind,
        Kind::Wall | Kind::Upright
    )
}

/// Where a triangle is cut.
fn cut(
    structure: &Structure,
    upright: &IsometryMatrix3<f64>,
    triangle: &[u32; 3],
    height: f64,
) -> Option<[Point2<f64>; 2]> {
    let corners = triangle.map(|it| upright * structure.positions[it as usize]);
    let mut ends = Vec::with_capacity(2);
    for (a, b) in [(0, 1), (1, 2), (2, 0)] {
        let (a, b): (Point3<f64>, Point3<f64>) = (corners[a], corners[b]);
        if (a.z < height) != (b.z < height) {
            ends.push((a + (height - a.z) / (b.z - a.z) * (b - a)).xy());
        }
    }
    <[Point2<f64>; 2]>::try_from(ends).ok()
}

/// The pieces of upright planes at a height, by plane and along it.
fn pieces(structure: &Structure, upright: &IsometryMatrix3<f64>, height: f64) -> Vec<Piece> {
    let mut found = Vec::new();
    for group in structure.polygons.chunk_by(|a, b| a.plane == b.plane) {
        let plane = group[0].plane;
        if !is_upright(structure, plane) {
            continue;
        }
        let normal: Vector3<f64> = upright * structure.planes[plane as usize].normal;
        let along = nalgebra::Vector2::new(-normal.y, normal.x).normalize();
        let triangles = group.iter().flat_map(|it| &it.triangles);
        let mut cuts: Vec<(f64, f64)> = Vec::new();
        let mut at = Point2::origin();
        for ends in triangles.filter_map(|it| cut(structure, upright, it, height)) {
            let [a, b] = ends.map(|end| along.dot(&end.coords));
            at = ends[0] - along.dot(&ends[0].coords) * along;
            cuts.push((a.min(b), a.max(b)));
        }
        cuts.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
        let mut open: Option<(f64, f64)> = None;
        let mut add = |(from, to): (f64, f64)| {
            let ends = [from, to].map(|it| at + it * along);
            found.push(Piece { plane, ends });
        };
        for (from, to) in cuts {
            // Neighbouring triangles are cut at the same position, up to rounding.
            match &mut open {
                Some(piece) if from - piece.1 <= 1e-9 * (1.0 + piece.1.abs()) => {
                    piece.1 = piece.1.max(to);
                }
                _ => open.replace((from, to)).into_iter().for_each(&mut add),
            }
        }
        open.into_iter().for_each(&mut add);
    }
    found
}
