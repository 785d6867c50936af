//! The floor plan as SVG, to scale.

use std::fmt::Write as _;

use nalgebra::{Point2, Vector2};

use crate::plan::Plan;
use crate::structure::Structure;

/// Scales on paper, and the longer side of the paper in millimetres (A3).
const SCALES: [f64; 9] = [
    10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 2000.0, 5000.0,
];
const PAPER_MM: f64 = 400.0;
/// Space around the section, and between lines of dimensions.
const MARGIN_MM: f64 = 14.0;
const STEP_MM: f64 = 8.0;
/// Distances drawn in one direction at most.
const MOST: usize = 4;

/// A plan: walls, what else is cut, openings with their widths, and distances between walls with standard deviations. One unit of
/// the mesh is taken as a metre. Of a structure without a plan the drawing says so.
pub fn svg(structure: &Structure, plan: Option<&Plan>) -> String {
    match plan {
        Some(plan) => Drawing::new(plan).draw(structure, plan),
        None => "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"80mm\" height=\"10mm\">\
                 <text x=\"5\" y=\"20\">no walls</text></svg>\n"
            .to_owned(),
    }
}

struct Drawing {
    low: Point2<f64>,
    high: Point2<f64>,
    /// Millimetres a unit.
    scale: f64,
    ratio: f64,
    text: String,
    /// Distances drawn below the section, and beside it.
    counts: [usize; 2],
}

impl Drawing {
    fn new(plan: &Plan) -> Self {
        let pieces = plan.walls.iter().flat_map(|it| it.ends);
        let points = pieces.chain(plan.rest.iter().flatten().copied());
        let bounds = points
            .map(|it| (it, it))
            .reduce(|a, b| (a.0.inf(&b.0), a.1.sup(&b.1)));
        let (low, high) = bounds.unwrap_or_default();
        let longer = (high - low).amax();
        let fits = |it: &f64| longer * 1000.0 / it <= PAPER_MM;
        let ratio = SCALES.into_iter().find(fits).unwrap_or(10_000.0);
        Self {
            low,
            high,
            scale: 1000.0 / ratio,
            ratio,
            text: String::new(),
            counts: [0; 2],
        }
    }

    /// Position on paper: x to the right, y down.
    fn at(&self, point: &Point2<f64>) -> [f64; 2] {
        let from = self.scale * (point - self.low);
        let height = self.scale * (self.high.y - self.low.y);
        [MARGIN_MM + from.x, MARGIN_MM + height - from.y]
    }

    fn line(&mut self, [a, b]: [[f64; 2]; 2], class: &str) {
        let [x1, y1, x2, y2] = [a[0], a[1], b[0], b[1]];
        let _ = writeln!(
            self.text,
            "<line class=\"{class}\" x1=\"{x1:.2}\" y1=\"{y1:.2}\" x2=\"{x2:.2}\" y2=\"{y2:.2}\"/>"
        );
    }

    fn label(&mut self, [x, y]: [f64; 2], turn: f64, label: &str) {
        let _ = writeln!(
            self.text,
            "<text transform=\"translate({x:.2} {y:.2}) rotate({turn:.1})\" text-anchor=\"middle\">{label}</text>"
        );
    }

    fn draw(mut self, structure: &Structure, plan: &Plan) -> String {
        for ends in &plan.rest {
            let ends = ends.map(|it| self.at(&it));
            self.line(ends, "rest");
        }
        for piece in &plan.walls {
            let kind = structure.planes[piece.plane as usize].kind;
            self.line(piece.ends.map(|it| self.at(&it)), kind.name());
        }
        for opening in &plan.openings {
            let [a, b] = opening.ends.map(|it| self.at(&it));
            self.line([a, b], "opening");
            let along = Vector2::new(b[0] - a[0], b[1] - a[1]);
            let turn = readable(along.y.atan2(along.x).to_degrees());
            let across = Vector2::new(along.y, -along.x).normalize();
            let middle = [0, 1].map(|it| 0.5 * (a[it] + b[it]) + 2.5 * across[it]);
            self.label(middle, turn, &format!("{:.3}", opening.width));
        }
        self.distances(structure, plan);
        self.finish(plan)
    }

    /// Distances between walls that face each other, level ones below the section and the others beside it.
    fn distances(&mut self, structure: &Structure, plan: &Plan) {
        let upright = structure.upright_rotation();
        let mut facing: Vec<_> = structure.distances.iter().filter(|it| it.facing).collect();
        let area = |it: &crate::Distance| {
            let areas = it.planes.map(|plane| structure.planes[plane as usize].area);
            areas[0].min(areas[1])
        };
        facing.sort_by(|a, b| area(b).total_cmp(&area(a)));
        for distance in facing {
            let [Some(one), Some(other)] = distance.planes.map(|plane| longest(plan, plane)) else {
                continue;
            };
            let normal = upright * structure.planes[distance.planes[0] as usize].normal;
            let axis = (0..2).find(|it| normal[*it].abs() > 0.98);
            if let Some(axis) = axis.filter(|it| self.counts[*it] < MOST) {
                let label = measured_text(distance.value, distance.sigma);
                self.dimension(axis, [one, other], &label);
            }
        }
    }

    /// A distance along an axis between two pieces of walls.
    fn dimension(&mut self, axis: usize, pieces: [[Point2<f64>; 2]; 2], label: &str) {
        let across = 1 - axis;
        self.counts[axis] += 1;
        let size = self.scale * (self.high - self.low);
        let far = MARGIN_MM + size[across] + STEP_MM * self.counts[axis] as f64;
        let pieces = pieces.map(|ends| ends.map(|it| self.at(&it)));
        let ends = pieces.map(|piece| {
            let mut end = piece[0];
            end[across] = far;
            end
        });
        self.line(ends, "dimension");
        for (end, [a, b]) in ends.into_iter().zip(pieces) {
            self.line(
                [if a[across] > b[across] { a } else { b }, end],
                "extension",
            );
            self.line(
                [[end[0] - 0.8, end[1] + 0.8], [end[0] + 0.8, end[1] - 0.8]],
                "tick",
            );
        }
        let mut middle = [0, 1].map(|it| 0.5 * (ends[0][it] + ends[1][it]));
        middle[across] -= 1.0;
        self.label(middle, [0.0, -90.0][axis], label);
    }

    fn finish(mut self, plan: &Plan) -> String {
        let section = self.scale * (self.high - self.low);
        let foot = MARGIN_MM + section.y + STEP_MM * (self.counts[0] as f64 + 1.0) + 6.0;
        // A scale bar of one, two or five units of some power of ten.
        let raw = section.x / self.scale / 4.0;
        let power = 10_f64.powf(raw.max(f64::MIN_POSITIVE).log10().floor());
        let bar = [5.0, 2.0, 1.0]
            .into_iter()
            .map(|it| it * power)
            .find(|it| *it <= raw);
        let bar = bar.unwrap_or(power);
        let length = bar * self.scale;
        self.line([[MARGIN_MM, foot], [MARGIN_MM + length, foot]], "wall");
        self.label(
            [MARGIN_MM + 0.5 * length, foot + 4.5],
            0.0,
            &format!("{bar} m"),
        );
        let height = match plan.above_floor {
            Some(height) => format!("section {height:.2} m above the floor"),
            None => format!("section at {:.2} m", plan.height),
        };
        let title = format!("1 : {}, {height}", self.ratio);
        let _ = writeln!(
            self.text,
            "<text x=\"{:.2}\" y=\"{:.2}\">{title}</text>",
            MARGIN_MM + length + 6.0,
            foot + 1.0
        );
        let width = (2.0 * MARGIN_MM + section.x + STEP_MM * (self.counts[1] as f64 + 1.0))
            .max(MARGIN_MM + length + 80.0);
        let height = foot + 9.0;
        let style = "line{stroke-linecap:round;stroke:#222}.wall{stroke-width:.7}.upright{stroke-width:.35}\
            .rest{stroke:#999;stroke-width:.18}.opening{stroke:#2060c8;stroke-width:.35;stroke-dasharray:1.5 1}\
            .dimension,.tick{stroke-width:.18}.extension{stroke:#aaa;stroke-width:.1}text{font:3px sans-serif;fill:#222}";
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.2}mm\" height=\"{height:.2}mm\" \
             viewBox=\"0 0 {width:.2} {height:.2}\">\n<style>{style}</style>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{}</svg>\n",
            self.text
        )
    }
}

/// The longest piece of a plane.
fn longest(plan: &Plan, plane: u32) -> Option<[Point2<f64>; 2]> {
    let own = plan
        .walls
        .iter()
        .filter(|it| it.plane == plane)
        .map(|it| it.ends);
    let length = |it: &[Point2<f64>; 2]| (it[1] - it[0]).norm();
    own.rev().max_by(|a, b| length(a).total_cmp(&length(b)))
}

/// An angle at which text is not upside down: degrees.
fn readable(degrees: f64) -> f64 {
    match degrees {
        it if it > 90.0 => it - 180.0,
        it if it <= -90.0 => it + 180.0,
        it => it,
    }
}

/// A standard deviation as text: two significant digits, as far as they are behind the point; no more than six.
pub fn deviation_text(value: f64) -> String {
    format!("{value:.*}", digits(value))
}

/// A value and its standard deviation as text, with the same number of digits behind the point.
pub fn measured_text(value: f64, deviation: f64) -> String {
    let digits = digits(deviation);
    format!("{value:.digits$} ± {deviation:.digits$}")
}

/// Digits behind the point of a standard deviation.
fn digits(deviation: f64) -> usize {
    (1.0 - deviation.max(1e-6).log10().floor()).clamp(1.0, 6.0) as usize
}
