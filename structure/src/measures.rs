//! Distances and angles between planes, with standard deviations.

use std::collections::BTreeMap;

use nalgebra::{Point3, Vector3};
use serde::Serialize;

use crate::directions::Directions;
use crate::estimate::Measured;
use crate::structure::Structure;
use crate::surface::unique;

/// Planes with at least this share of the area of all are measured against each other.
const SHARE: f64 = 0.01;
/// Parallel planes turn by less than this: radians.
const PARALLEL: f64 = 2.0 * std::f64::consts::PI / 180.0;

/// The distance between two parallel planes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Distance {
    /// Numbers of the planes.
    pub planes: [u32; 2],
    /// The distance, between the centres of both.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// Whether the planes face each other, as opposite walls do.
    pub facing: bool,
}

/// The angle between two planes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Angle {
    /// Numbers of the planes.
    pub planes: [u32; 2],
    /// The angle between the normals as measured, before they were aligned with main directions: degrees.
    pub degrees: f64,
    /// Its standard deviation: degrees.
    pub sigma: f64,
}

/// Where polygons of two planes meet.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Edge {
    /// Numbers of the planes.
    pub planes: [u32; 2],
    /// Length of their common sides.
    pub length: f64,
}

/// Where planes meet, by planes.
pub(crate) fn edges(structure: &Structure) -> Vec<Edge> {
    let mut uses: Vec<([u32; 2], u32)> = Vec::new();
    for polygon in &structure.polygons {
        uses.extend(
            polygon
                .sides()
                .map(|[a, b]| ([a.min(b), a.max(b)], polygon.plane)),
        );
    }
    let mut lengths: BTreeMap<[u32; 2], f64> = BTreeMap::new();
    for both in unique(uses).chunk_by(|a, b| a.0 == b.0) {
        if let [(ends, one), (_, other)] = both {
            let [from, to] = ends.map(|it| structure.positions[it as usize]);
            *lengths.entry([*one, *other]).or_default() += (to - from).norm();
        }
    }
    let edge = |(planes, length)| Edge { planes, length };
    lengths.into_iter().map(edge).collect()
}

/// Pairs of planes large enough to be measured.
fn pairs(structure: &Structure) -> impl Iterator<Item = [usize; 2]> + '_ {
    let total: f64 = structure.planes.iter().map(|it| it.area).sum();
    let large = move |it: &usize| structure.planes[*it].area >= SHARE * total;
    let count = structure.planes.len();
    let first = (0..count).filter(large);
    first.flat_map(move |a| (a + 1..count).filter(large).map(move |b| [a, b]))
}

/// Distances between all pairs of large planes that are parallel. The variance of two planes in a main direction has three parts: both
/// offsets at their centres, and the direction times how far the centres are apart along the planes. Other planes are compared half
/// way between their centres.
pub(crate) fn distances(
    structure: &Structure,
    measured: &[Measured],
    directions: Option<&Directions>,
) -> Vec<Distance> {
    let distance = |[a, b]: [usize; 2]| {
        let (one, other) = (&structure.planes[a], &structure.planes[b]);
        let turn = one.normal.dot(&other.normal);
        if turn.abs() < PARALLEL.cos() {
            return None;
        }
        let apart = other.center - one.center;
        let (value, variance) = match directions.filter(|_| one.is_aligned && other.is_aligned) {
            Some(directions) => {
                let lever = one.normal.cross(&apart);
                let turned = (lever.transpose() * directions.covariance * lever)[0];
                let offsets = measured[a].sigma().powi(2) + measured[b].sigma().powi(2);
                (one.normal.dot(&apart), offsets + turned)
            }
            None => {
                let middle: Point3<f64> = nalgebra::center(&one.center, &other.center);
                let to = |it: &crate::StructurePlane| it.normal.dot(&middle.coords) - it.offset;
                let variance = measured[a].variance_at(&middle) + measured[b].variance_at(&middle);
                (to(one) - turn.signum() * to(other), variance)
            }
        };
        Some(Distance {
            planes: [a as u32, b as u32],
            value: value.abs(),
            sigma: variance.sqrt(),
            facing: turn < 0.0 && one.normal.dot(&apart) > 0.0,
        })
    };
    pairs(structure).filter_map(distance).collect()
}

/// Angles between the normals of all pairs of large planes that are not parallel.
pub(crate) fn angles(structure: &Structure, measured: &[Measured]) -> Vec<Angle> {
    let angle = |[a, b]: [usize; 2]| {
        let [one, other] = [a, b].map(|it| measured[it].plane.normal);
        let cosine = one.dot(&other);
        if cosine.abs() >= PARALLEL.cos() {
            return None;
        }
        // The direction in which a normal turns when the angle changes.
        let towards =
            |from: &Vector3<f64>, to: &Vector3<f64>| (to - from.dot(to) * from).normalize();
        let variance = |it: usize, direction: Vector3<f64>| {
            let [u, v] = measured[it].plane.axes();
            let along = nalgebra::Vector2::new(u.dot(&direction), v.dot(&direction));
            (along.transpose() * measured[it].slopes() * along)[0]
        };
        let sum = variance(a, towards(&one, &other)) + variance(b, towards(&other, &one));
        Some(Angle {
            planes: [a as u32, b as u32],
            degrees: cosine.acos().to_degrees(),
            sigma: sum.max(0.0).sqrt().to_degrees(),
        })
    };
    pairs(structure).filter_map(angle).collect()
}
