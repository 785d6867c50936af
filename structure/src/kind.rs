//! What planes seem to be: floor, ceiling, walls.

use nalgebra::{IsometryMatrix3, Vector3};
use serde::Serialize;

use crate::structure::Structure;

/// Planes are level or upright up to this angle: sine of 5 degrees.
const SLANT: f64 = 0.087;
/// A floor or a ceiling has at least this share of the largest level area that faces the same way.
const SHARE: f64 = 0.25;

/// What a plane seems to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// The lowest large level plane that faces up.
    Floor,
    /// The highest large level plane that faces down.
    Ceiling,
    /// Upright, and at least half as high as the room.
    Wall,
    /// Upright, and lower.
    Upright,
    /// Level, neither floor nor ceiling.
    Level,
    /// Anything else.
    Other,
}

impl Kind {
    /// The name in files, the colour of planes where the mesh has none (sRGB), and the colour of layers (AutoCAD colour index).
    fn look(self) -> (&'static str, [u8; 3], u8) {
        match self {
            Self::Floor => ("floor", [176, 144, 108], 32),
            Self::Ceiling => ("ceiling", [236, 234, 228], 254),
            Self::Wall => ("wall", [206, 200, 184], 9),
            Self::Upright => ("upright", [128, 160, 190], 151),
            Self::Level => ("level", [150, 180, 140], 83),
            Self::Other => ("other", [190, 150, 170], 221),
        }
    }

    /// The name in files.
    pub fn name(self) -> &'static str {
        self.look().0
    }

    /// The colour of its planes where the mesh has none: sRGB.
    pub fn color(self) -> [u8; 3] {
        self.look().1
    }

    /// The colour of its layers: a number of the AutoCAD colour index.
    pub(crate) fn autocad_color(self) -> u8 {
        self.look().2
    }
}

/// Lowest and highest height of the vertices of each plane in the upright frame.
pub(crate) fn heights(structure: &Structure, upright: &IsometryMatrix3<f64>) -> Vec<[f64; 2]> {
    let mut ranges = vec![[f64::INFINITY, f64::NEG_INFINITY]; structure.planes.len()];
    for polygon in &structure.polygons {
        let range = &mut ranges[polygon.plane as usize];
        for vertex in polygon.rings.iter().flatten() {
            let height = (upright * structure.positions[*vertex as usize]).z;
            *range = [range[0].min(height), range[1].max(height)];
        }
    }
    ranges
}

/// Width of a plane along a level direction, and its height across that.
pub(crate) fn size(structure: &Structure, plane: u32) -> [f64; 2] {
    let upright = structure.upright_rotation();
    let normal = upright * structure.planes[plane as usize].normal;
    let level = Vector3::z().cross(&normal);
    let along = if level.norm() > SLANT {
        level.normalize()
    } else {
        Vector3::x()
    };
    let own = structure.polygons.iter().filter(|it| it.plane == plane);
    let own: Vec<u32> = own.flat_map(|it| it.rings.concat()).collect();
    [along, normal.cross(&along)].map(|axis| {
        let heights = own
            .iter()
            .map(|it| axis.dot(&(upright * structure.positions[*it as usize]).coords));
        let ends = heights
            .map(|it| [it, it])
            .reduce(|a, b| [a[0].min(b[0]), a[1].max(b[1])]);
        ends.map_or(0.0, |[low, high]| high - low)
    })
}

/// The kind of each plane, from its normal, its area and its height.
pub(crate) fn kinds(structure: &Structure) -> Vec<Kind> {
    let up = structure.up;
    let upright = structure.upright_from_original();
    let ranges = heights(structure, &upright);
    let level = |sign: f64| {
        let planes = structure.planes.iter().enumerate();
        let planes =
            planes.filter(move |(_, it)| sign * it.normal.dot(&up) > (1.0 - SLANT * SLANT).sqrt());
        let largest = planes.clone().map(|(_, it)| it.area).fold(0.0, f64::max);
        let height = |it: usize| sign * (upright * structure.planes[it].center).z;
        planes
            .filter(|(_, it)| it.area >= SHARE * largest)
            .map(|(number, _)| number)
            .min_by(|a, b| height(*a).total_cmp(&height(*b)))
    };
    let (floor, ceiling) = (level(1.0), level(-1.0));
    let all = ranges
        .iter()
        .fold([f64::INFINITY, f64::NEG_INFINITY], |a, b| {
            [a[0].min(b[0]), a[1].max(b[1])]
        });
    let center = |plane: Option<usize>, other: f64| {
        plane.map_or(other, |it| (upright * structure.planes[it].center).z)
    };
    let room = center(ceiling, all[1]) - center(floor, all[0]);
    let kind = |number: usize| {
        let slant = structure.planes[number].normal.dot(&up);
        let height = ranges[number][1] - ranges[number][0];
        match slant.abs() {
            _ if floor == Some(number) => Kind::Floor,
            _ if ceiling == Some(number) => Kind::Ceiling,
            slant if slant > (1.0 - SLANT * SLANT).sqrt() => Kind::Level,
            slant if slant > SLANT => Kind::Other,
            _ if height >= 0.5 * room => Kind::Wall,
            _ => Kind::Upright,
        }
    };
    (0..structure.planes.len()).map(kind).collect()
}
