//! Outlines: parts of segments beyond which views see that the surface ends. Some views look past a rim and others see the surface before it, so that
//! the zero of their mean distance leads on from the rim, through its shadow, to what lies behind. That part is cut off.

use nalgebra::{Point3, Vector2, Vector3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::grid::Corner;
use super::segments::{Part, parts_by_cube};
use super::view::{View, sphere_around};

/// Parts that are looked at together: views that see none of them are skipped.
const CHUNK: usize = 64;
/// Least number of views that see that the surface ends. Single views err: depth is that of the wrong side of an edge, or of neither.
const LEAST_VIEWS: u16 = 3;
/// Least length of the sum of the directions in which it ends, a view each, over their number.
const LEAST_AGREEMENT: f64 = 0.97;
/// What lies behind a rim is at least so many sides further away. Segments lie as much as one beside creases.
const LEAST_JUMP_SIDES: f64 = 2.0;
/// Depth lies on one plane within so many sides.
const FLAT_SIDES: f64 = 0.5;
/// Pixels on either side of a segment at which depth is looked at.
const PIXELS: [f64; 3] = [1.3, 2.3, 3.3];
/// Least length of a side of a cube along the segment in the image, in pixels.
const LEAST_LENGTH_PX: f64 = 0.4;

/// The surface beyond an outline is cut from the first to the last of these distances, in sides. The first is that of noise, the last that over which
/// views look past the rim.
const BEYOND_SIDES: [f64; 2] = [0.25, 3.0];
/// What is cut lies within so many sides and this slope of the plane before the outline: views see no further into the shadow.
const MOST_OFFSET_SIDES: f64 = 0.2;
const MOST_SLOPE: f64 = 0.4;
/// Least cosine between the normals of the two: what is cut is no other surface, such as the wall behind.
const LEAST_COSINE: f64 = 0.9;

/// Parts of segments with what views saw beside them.
pub(super) struct Outlines<'a> {
    segments: &'a [[Point3<f64>; 2]],
    side: f64,
    parts: Vec<Votes>,
}

/// The middle of a part, and the unit vector along its segment.
type Place = (Point3<f64>, Vector3<f64>);

/// What views saw beside a part, in 32 bytes.
struct Votes {
    part: Part,
    /// Views that saw that the surface ends, and the sum of the directions in which it does.
    ends: u16,
    outward: Vector3<f32>,
    /// Views that saw that it goes on.
    goes_on: u16,
}

/// What a view sees beside a segment.
enum Sight {
    /// The surface ends there; the direction away from it.
    Ends(Vector3<f64>),
    GoesOn,
}

/// An outline.
struct Outline {
    middle: Point3<f64>,
    along: Vector3<f64>,
    outward: Vector3<f64>,
    normal: Vector3<f64>,
}

impl<'a> Outlines<'a> {
    /// None yet, for the parts of segments in cubes with this side.
    pub(super) fn new(segments: &'a [[Point3<f64>; 2]], side: f64) -> Self {
        let mut sorted: Vec<(Corner, Part)> = parts_by_cube(segments, side).into_iter().collect();
        sorted.sort_unstable_by_key(|(cube, _)| *cube);
        let votes = |(_, part)| Votes {
            part,
            ends: 0,
            outward: Vector3::zeros(),
            goes_on: 0,
        };
        Self {
            segments,
            side,
            parts: sorted.into_iter().map(votes).collect(),
        }
    }

    /// Adds what views see, in their order.
    pub(super) fn observe(&mut self, views: &[View]) {
        let (segments, side) = (self.segments, self.side);
        let chunks = self.parts.par_chunks_mut(CHUNK);
        chunks.for_each_init(Vec::new, |places, parts| {
            places.clear();
            places.extend(parts.iter().map(|it| it.place(segments)));
            let (center, radius) = sphere_around(places.iter().map(|(middle, _)| *middle));
            for view in views {
                if !view.may_see(&view.in_camera(&center), radius) {
                    continue;
                }
                for (votes, place) in parts.iter_mut().zip(&*places) {
                    match sight(view, place, side) {
                        Some(Sight::Ends(outward)) => {
                            votes.ends = votes.ends.saturating_add(1);
                            votes.outward += outward.cast::<f32>();
                        }
                        Some(Sight::GoesOn) => votes.goes_on = votes.goes_on.saturating_add(1),
                        None => {}
                    }
                }
            }
        });
    }

    /// Removes what goes on beyond outlines: triangles about parallel to the surface before them.
    ///
    /// # Complexity
    /// Expected linear in parts and triangles.
    pub(super) fn cut(&self, positions: &[Point3<f64>], triangles: &mut Vec<[u32; 3]>) {
        let side = self.side;
        let outline = |votes: &Votes| votes.outline(self.segments);
        let outlines: Vec<Outline> = self.parts.iter().filter_map(outline).collect();
        let mut by_cube: FxHashMap<Corner, Vec<u32>> = FxHashMap::default();
        for (number, outline) in (0..).zip(&outlines) {
            // Twice a side, so that hardly a cube is left out.
            for out in 0..=(2.0 * BEYOND_SIDES[1]) as i32 {
                let most = (MOST_SLOPE * f64::from(out)).ceil() as i32;
                for up in -most..=most {
                    let [out, up] = [out, up].map(|steps| 0.5 * side * f64::from(steps));
                    let position = outline.middle + out * outline.outward + up * outline.normal;
                    let Some(cube) = Corner::below(&position, side) else {
                        continue;
                    };
                    let numbers = by_cube.entry(cube).or_default();
                    if numbers.last() != Some(&number) {
                        numbers.push(number);
                    }
                }
            }
        }
        let normal_before = |position: &Point3<f64>| {
            let numbers = by_cube.get(&Corner::below(position, side)?)?;
            let mut near = numbers.iter().map(|number| &outlines[*number as usize]);
            near.find(|outline| outline.is_beyond(position, side))
                .map(|outline| outline.normal)
        };
        let normals: Vec<Option<Vector3<f64>>> = positions.iter().map(normal_before).collect();
        triangles.retain(|triangle| {
            let Some(normal) = triangle.iter().find_map(|it| normals[*it as usize]) else {
                return true;
            };
            let [a, b, c] = triangle.map(|corner| positions[corner as usize]);
            let own = (b - a).cross(&(c - a));
            own.dot(&normal).abs() < LEAST_COSINE * own.norm()
        });
    }
}

impl Votes {
    fn place(&self, segments: &[[Point3<f64>; 2]]) -> Place {
        let [from, to] = segments[self.part.segment as usize];
        (self.part.middle(segments), (to - from).normalize())
    }

    /// The outline; `None` where views do not agree that the surface ends.
    fn outline(&self, segments: &[[Point3<f64>; 2]]) -> Option<Outline> {
        let outward: Vector3<f64> = self.outward.cast();
        let is_agreed = outward.norm() >= LEAST_AGREEMENT * f64::from(self.ends);
        if self.ends < LEAST_VIEWS || self.ends <= self.goes_on || !is_agreed {
            return None;
        }
        let (middle, along) = self.place(segments);
        let outward = outward.normalize();
        Some(Outline {
            middle,
            along,
            outward,
            normal: along.cross(&outward),
        })
    }
}

impl Outline {
    /// Whether a position lies where the surface would go on.
    fn is_beyond(&self, position: &Point3<f64>, side: f64) -> bool {
        let offset = (position - self.middle) / side;
        let out = offset.dot(&self.outward);
        let [first, last] = BEYOND_SIDES;
        (first..last).contains(&out)
            && offset.dot(&self.normal).abs() <= MOST_OFFSET_SIDES + MOST_SLOPE * out
            && offset.dot(&self.along).abs() <= 1.0
    }
}

/// A pixel beside a segment.
struct Sample {
    /// Distance from the segment in the image, in pixels.
    across: f64,
    /// Inverse depth less that of the segment.
    excess: f64,
    pixel: [usize; 2],
}

/// What a view sees beside a part of a segment; `None` where depth on either side is unknown, or it is neither an outline nor on a surface.
fn sight(view: &View, (middle, along): &Place, side: f64) -> Option<Sight> {
    let image = view.image();
    let from = view.in_camera(middle);
    let pixel = image.project(&from)?;
    let rho = 1.0 / from.z;
    // What a side of a cube along the ray is in inverse depth.
    let unit = side * rho * rho;
    let (_, seen) = image.sample(&pixel)?;
    if seen > rho + LEAST_JUMP_SIDES * unit {
        return None;
    }
    let to = view.in_camera(&(middle + side * along));
    let along = image.project(&to)? - pixel;
    let length = along.norm();
    if length < LEAST_LENGTH_PX {
        return None;
    }
    let along = along / length;
    // Inverse depth is linear in the image, along lines as on planes.
    let slope = (1.0 / to.z - rho) / length;
    let sample = |pixels: f64| {
        let position = pixel + pixels * Vector2::new(-along.y, along.x);
        let ([column, row], rho_there) = image.sample(&position)?;
        let offset = Vector2::new(column as f64 - pixel.x, row as f64 - pixel.y);
        Some(Sample {
            across: along.perp(&offset).abs(),
            excess: rho_there - rho - slope * along.dot(&offset),
            pixel: [column, row],
        })
    };
    let samples = |sign: f64| {
        let [a, b, c] = PIXELS.map(|pixels| sample(sign * pixels));
        Some([a?, b?, c?])
    };
    let sides = [samples(-1.0)?, samples(1.0)?];
    let [left, right] = &sides;
    for (near, far) in [(left, right), (right, left)] {
        let rise = slope_through(near);
        let lies_off = |samples: &[Sample; 3], base: f64, rise: f64| {
            let off = |it: &Sample| (it.excess - base - rise * it.across).abs();
            samples.iter().any(|it| off(it) > FLAT_SIDES * unit)
        };
        if lies_off(near, 0.0, rise) {
            continue;
        }
        if !lies_off(far, 0.0, -rise) {
            return Some(Sight::GoesOn);
        }
        let (base, rise) = line(far);
        if base < -LEAST_JUMP_SIDES * unit && !lies_off(far, base, rise) {
            let along = (to - from) / side;
            let points = near.iter().map(|it| image.point(it.pixel[0], it.pixel[1]));
            let away: Vector3<f64> = points.flatten().map(|point| from - point).sum();
            let outward = (away - along * along.dot(&away)).try_normalize(0.0)?;
            return Some(Sight::Ends(view.in_world(&outward)));
        }
    }
    None
}

/// Slope of the least-squares line through the segment.
fn slope_through(samples: &[Sample; 3]) -> f64 {
    let products: f64 = samples.iter().map(|it| it.across * it.excess).sum();
    let squares: f64 = samples.iter().map(|it| it.across * it.across).sum();
    products / squares
}

/// Value at the segment and slope of the least-squares line.
fn line(samples: &[Sample; 3]) -> (f64, f64) {
    let mean = |value: fn(&Sample) -> f64| samples.iter().map(value).sum::<f64>() / 3.0;
    let (across, excess) = (mean(|it| it.across), mean(|it| it.excess));
    let products: f64 = samples
        .iter()
        .map(|it| (it.across - across) * (it.excess - excess))
        .sum();
    let squares: f64 = samples.iter().map(|it| (it.across - across).powi(2)).sum();
    let slope = products / squares;
    (excess - slope * across, slope)
}
