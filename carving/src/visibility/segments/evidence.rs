//! The evidence of a segment seen by a view about one cell: that of the rays to all of its points, together one ray.
//!
//! Between the rays to the two ends lie the rays to all points between. A facet that the visibility triangle cuts is
//! pierced by a part of them; that part of the weight is the cost of an occupied cell behind the facet, reduced near the
//! segment as for [single rays](super::super::softness). The standard deviation is interpolated along the segment. Where
//! the triangle is cut from side to side the parts add up to the weight of one ray. Rays that end inside a cell contribute
//! nothing to it: a part of the cell is free, the rest is not.
//!
//! As behind the point of a ray, space is expected to be occupied behind the segment: at a few anchors, whose weights add
//! up to that of one ray.
//!
//! Everything is a function of positions, deviations and weight of one segment and one cell; ends and corners are sorted by
//! position first.

use crate::predicates::{are_collinear, orient3d};
use crate::tetrahedralization::Tetrahedralization;
use crate::vectors::{cross, dot, minus};

use super::super::CellEvidence;
use super::super::segment_cell::crosses_cell;
use super::super::softness::{
    LEAST_BEHIND, MAX_WEIGHT, SATURATED_SIGMAS, Softness, UNIT, falloff, in_order, precedes,
};

/// A segment seen by a view, as evidence.
#[derive(Clone, Copy, Debug)]
pub(super) struct SegmentEvidence<'a> {
    pub(super) center: &'a [f64; 3],
    pub(super) ends: [&'a [f64; 3]; 2],
    /// Standard deviations of the ends along the rays to them.
    pub(super) sigmas: [Option<f64>; 2],
    pub(super) weight: u32,
}

/// Number of rays over which the part of a facet is averaged.
const RAYS: usize = 4;

/// Number of anchors behind a segment.
pub(super) const ANCHORS: usize = 4;

/// The triangle as a frame of its plane: the centre is the origin, the ends are the axes.
pub(super) struct Frame {
    ends: [[f64; 3]; 2],
    sigmas: [f64; 2],
    normal: [f64; 3],
    squared: f64,
    /// Share of the distance to the segment up to which the evidence has its full amount.
    clear: f64,
}

/// A corner of a cell in frame coordinates.
struct FrameCorner {
    height: f64,
    along: [f64; 2],
}

/// Where an edge of a facet cuts the plane, if it does.
fn cut(p: &FrameCorner, q: &FrameCorner) -> Option<[f64; 2]> {
    if (p.height > 0.0) == (q.height > 0.0) {
        return None;
    }
    let share = p.height / (p.height - q.height);
    Some([0, 1].map(|k| p.along[k] + share * (q.along[k] - p.along[k])))
}

impl Frame {
    /// A point relative to the centre by its height over the plane, up to a factor, and its two coordinates along the ends.
    fn corner(&self, point: &[f64; 3]) -> FrameCorner {
        let [a, b] = &self.ends;
        FrameCorner {
            height: dot(&self.normal, point),
            along: [
                dot(&self.normal, &cross(point, b)) / self.squared,
                dot(&self.normal, &cross(a, point)) / self.squared,
            ],
        }
    }

    /// Mean evidence of the rays between two positions in the triangle, times their part of all rays. Rays that end between
    /// the two `silent` shares along the segment are left out.
    fn part(&self, from: [f64; 2], to: [f64; 2], silent: Option<[f64; 2]>) -> f64 {
        // The share along the segment at which the ray through a position ends.
        let share = |[u, v]: [f64; 2]| v / (u + v);
        let (first, last) = (share(from), share(to));
        let (first, last) = (first.min(last), first.max(last));
        let between = |first: f64, last: f64| self.part_between(from, to, [first, last]);
        match silent {
            Some([low, high]) => between(first, last.min(low)) + between(first.max(high), last),
            None => between(first, last),
        }
    }

    /// The same for the rays that end between two shares; they meet the line between the two positions.
    fn part_between(&self, from: [f64; 2], to: [f64; 2], [first, last]: [f64; 2]) -> f64 {
        let part = last - first;
        // NaN at the centre.
        if part.is_nan() || part <= 0.0 {
            return 0.0;
        }
        if from[0] + from[1] < self.clear && to[0] + to[1] < self.clear {
            return part;
        }
        let step = [to[0] - from[0], to[1] - from[1]];
        let turn = from[0] * step[1] - from[1] * step[0];
        let sum: f64 = (0..RAYS)
            .map(|k| {
                let t = first + part * (k as f64 + 0.5) / RAYS as f64;
                // The share along the ray, from the centre, at which it meets the line between the two positions.
                let reach = (turn / ((1.0 - t) * step[1] - t * step[0])).clamp(0.0, 1.0);
                let [a, b] = &self.ends;
                let target: [f64; 3] = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
                let sigma = self.sigmas[0] + t * (self.sigmas[1] - self.sigmas[0]);
                falloff((1.0 - reach) * dot(&target, &target).sqrt() / sigma)
            })
            .sum();
        sum / RAYS as f64 * part
    }

    /// The part of the segment inside a cell, as shares along it; corners are relative to the centre.
    fn inside(&self, cell: &[[f64; 3]; 4]) -> Option<[f64; 2]> {
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for (opposite, facet) in Tetrahedralization::FACET.iter().enumerate() {
            let [p, q, r] = in_order(facet.map(|k| &cell[k]));
            let normal = cross(&minus(q, p), &minus(r, p));
            let height = |x: &[f64; 3]| dot(&normal, &minus(x, p));
            let inward = height(&cell[opposite]).signum();
            let [start, end] = [0, 1].map(|k| inward * height(&self.ends[k]));
            match (start >= 0.0, end >= 0.0) {
                (true, true) => {}
                (false, false) => return None,
                (true, false) => high = high.min(start / (start - end)),
                (false, true) => low = low.max(start / (start - end)),
            }
        }
        (low < high).then_some([low, high])
    }
}

/// The part of a line segment inside the triangle of the origin, (1, 0) and (0, 1).
fn clipped(from: [f64; 2], to: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    let (mut low, mut high) = (0.0_f64, 1.0_f64);
    let inside = |[u, v]: [f64; 2]| [u, v, 1.0 - u - v];
    for (start, end) in inside(from).into_iter().zip(inside(to)) {
        match (start >= 0.0, end >= 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (true, false) => high = high.min(start / (start - end)),
            (false, true) => low = low.max(start / (start - end)),
        }
    }
    let at = |s: f64| [0, 1].map(|k| from[k] + s * (to[k] - from[k]));
    (low < high).then(|| [at(low), at(high)])
}

/// Indices of the corners, sorted by position.
fn by_position(corners: [&[f64; 3]; 4]) -> [usize; 4] {
    let mut order = [0, 1, 2, 3];
    for (first, second) in [(0, 1), (2, 3), (0, 2), (1, 3), (1, 2)] {
        if precedes(corners[order[second]], corners[order[first]]) {
            order.swap(first, second);
        }
    }
    order
}

impl SegmentEvidence<'_> {
    /// The triangle in its plane, with the deviations at its ends.
    pub(super) fn frame(&self, softness: &Softness) -> Frame {
        let sigma = |k: usize| {
            self.sigmas[k].unwrap_or_else(|| {
                let ray = minus(self.ends[k], self.center);
                softness.relative_sigma * dot(&ray, &ray).sqrt()
            })
        };
        let order = if precedes(self.ends[1], self.ends[0]) {
            [1, 0]
        } else {
            [0, 1]
        };
        let ends = order.map(|k| minus(self.ends[k], self.center));
        let normal = cross(&ends[0], &ends[1]);
        let squared = dot(&normal, &normal);
        let sigmas = order.map(sigma);
        let along = minus(&ends[1], &ends[0]);
        let nearest = (squared / dot(&along, &along)).sqrt();
        // Slightly less, for rounding.
        let clear = 1.0 - 1.000_001 * SATURATED_SIGMAS * sigmas[0].max(sigmas[1]) / nearest;
        Frame {
            ends,
            sigmas,
            normal,
            squared,
            clear,
        }
    }

    /// Whether the triangle has an area; without one it contributes nothing.
    pub(super) fn has_area(&self) -> bool {
        let [a, b] = self.ends;
        !are_collinear(self.center, a, b)
    }

    /// Whether the segment crosses the open interior of a positively oriented cell, which is then free before the segment and
    /// occupied behind it.
    pub(super) fn ends_in(&self, cell: [&[f64; 3]; 4]) -> bool {
        let [a, b] = self.ends;
        crosses_cell(a, b, cell)
    }

    /// Weight of one anchor; together they weigh as much as the anchor of one ray.
    pub(super) fn anchor_weight(&self, softness: &Softness) -> u64 {
        let each = (softness.anchor_weight + ANCHORS as u64 / 2) / ANCHORS as u64;
        u64::from(self.weight.min(MAX_WEIGHT)) * each
    }

    /// Position of one of the [`ANCHORS`], which lie evenly along the segment and behind it as seen from the centre; with the
    /// [frame](Self::frame) of this segment.
    pub(super) fn anchor(&self, frame: &Frame, softness: &Softness, index: usize) -> [f64; 3] {
        let Frame { ends, sigmas, .. } = frame;
        let t = (index as f64 + 0.5) / ANCHORS as f64;
        let target: [f64; 3] = std::array::from_fn(|k| ends[0][k] + t * (ends[1][k] - ends[0][k]));
        let sigma = sigmas[0] + t * (sigmas[1] - sigmas[0]);
        let length = dot(&target, &target).sqrt();
        let share = 1.0 + (softness.behind_sigmas * sigma / length).max(LEAST_BEHIND);
        std::array::from_fn(|k| self.center[k] + share * target[k])
    }

    /// What the segment contributes to a finite cell that its triangle meets; with the [frame](Self::frame) of this segment,
    /// and whether it [ends in](Self::ends_in) the cell.
    pub(super) fn passage(
        &self,
        frame: &Frame,
        cell: [&[f64; 3]; 4],
        ends_in: bool,
    ) -> CellEvidence {
        let mut contribution = CellEvidence::default();
        let weight = u64::from(self.weight.min(MAX_WEIGHT)) * UNIT;
        let relative = cell.map(|corner| minus(corner, self.center));
        let silent = ends_in.then(|| frame.inside(&relative)).flatten();
        let order = by_position(cell);
        let in_frame = relative.map(|corner| frame.corner(&corner));
        let mut is_center_inside = true;
        for (facet, corners) in Tetrahedralization::FACET.iter().enumerate() {
            let [p, q, r] = corners.map(|k| cell[k]);
            let side = orient3d(p, q, r, self.center);
            is_center_inside &= side > 0.0;
            if side >= 0.0 {
                continue;
            }
            let mut corners = order.into_iter().filter(|&k| k != facet);
            let [p, q, r] = std::array::from_fn(|_| corners.next().unwrap_or(facet));
            let mut cuts = [(p, q), (q, r), (p, r)]
                .into_iter()
                .filter_map(|(i, j)| cut(&in_frame[i], &in_frame[j]));
            if let (Some(from), Some(to)) = (cuts.next(), cuts.next())
                && let Some([from, to]) = clipped(from, to)
            {
                let part = frame.part(from, to, silent);
                contribution.entered[facet] = (weight as f64 * part).round() as u64;
            }
        }
        if is_center_inside {
            let part = silent.map_or(1.0, |[low, high]| 1.0 - (high - low));
            contribution.free = (weight as f64 * part).round() as u64;
        }
        contribution
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOFTNESS: Softness = Softness {
        relative_sigma: 0.01,
        behind_sigmas: 2.0,
        anchor_weight: UNIT,
    };

    /// A cell with its facet towards the centre at a height above the segment, cut from side to side, and the corner
    /// opposite at another height.
    fn cost(height: f64, apex: f64, sigma: f64, flip: bool) -> [u64; 4] {
        let (a, b) = ([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        let cell = [
            [-9.0, -9.0, height],
            [9.0, -9.0, height],
            [0.0, 9.0, height],
            [0.0, 0.0, apex],
        ];
        let cell = if orient3d(&cell[0], &cell[1], &cell[2], &cell[3]) > 0.0 {
            cell
        } else {
            [cell[1], cell[0], cell[2], cell[3]]
        };
        let segment = SegmentEvidence {
            center: &[0.0, 0.0, 10.0],
            ends: if flip { [&b, &a] } else { [&a, &b] },
            sigmas: [Some(sigma); 2],
            weight: 3,
        };
        let cell = cell.each_ref();
        segment
            .passage(&segment.frame(&SOFTNESS), cell, segment.ends_in(cell))
            .entered
    }

    #[test]
    fn a_facet_far_in_front_costs_one_ray_and_one_at_the_segment_nothing() {
        assert_eq!(cost(5.0, 4.0, 0.1, false).iter().sum::<u64>(), 3 * UNIT);
        assert_eq!(cost(0.0, -20.0, 0.1, false).iter().sum::<u64>(), 0);
        // At about one deviation: 1 - exp(-1/2) = 0.39 of 768; rays aside are a little longer.
        let near = cost(0.1, 0.05, 0.1, false);
        assert!((300..306).contains(&near.iter().sum::<u64>()), "{near:?}");
        assert_eq!(near, cost(0.1, 0.05, 0.1, true));
        // Behind the segment nothing.
        assert_eq!(cost(-0.1, -20.0, 0.1, false), [0; 4]);
        // Without a deviation every facet in front is hard.
        assert_eq!(cost(1e-6, 5e-7, 0.0, false).iter().sum::<u64>(), 3 * UNIT);
    }

    #[test]
    fn a_cell_that_holds_the_segment_gets_no_evidence() {
        assert_eq!(cost(5.0, -20.0, 0.1, false), [0; 4]);
        // A quarter of the segment inside: the rays to the rest cross the cell.
        let (a, b) = ([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        let cell = [
            [-9.0, -9.0, 5.0],
            [0.0, 9.0, 5.0],
            [9.0, -9.0, 5.0],
            [0.0, 0.0, -5.0],
        ];
        let shifted = cell.map(|[x, y, z]| [x + 2.75, y, z]);
        let segment = SegmentEvidence {
            center: &[0.0, 0.0, 10.0],
            ends: [&a, &b],
            sigmas: [Some(0.1); 2],
            weight: 1000,
        };
        let corners = shifted.each_ref();
        let inside = {
            let frame = segment.frame(&SOFTNESS);
            frame.inside(&shifted.map(|corner| minus(&corner, segment.center)))
        };
        let [low, high] = inside.expect("it ends in the cell");
        assert!((low - 0.75).abs() < 1e-12 && high == 1.0, "{low} {high}");
        assert!(segment.ends_in(corners));
        let sum: u64 = segment
            .passage(&segment.frame(&SOFTNESS), corners, true)
            .entered
            .iter()
            .sum();
        let crossing = 1000.0 * UNIT as f64 * low;
        assert!(sum > 0 && sum as f64 <= crossing, "{sum} {crossing}");
    }

    #[test]
    fn anchors_lie_behind_the_segment_and_weigh_as_one_ray() {
        let (a, b) = ([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        let segment = SegmentEvidence {
            center: &[0.0, 0.0, 10.0],
            ends: [&a, &b],
            sigmas: [Some(0.25), Some(0.25)],
            weight: 3,
        };
        let frame = segment.frame(&SOFTNESS);
        for (index, x) in [-0.75, -0.25, 0.25, 0.75].into_iter().enumerate() {
            let anchor = segment.anchor(&frame, &SOFTNESS, index);
            // Two deviations further from the centre than the segment.
            let beyond = x * x + 100.0;
            let share = 1.0 + 0.5 / f64::sqrt(beyond);
            assert!((anchor[0] - x * share).abs() < 1e-12, "{anchor:?}");
            assert!(
                (anchor[2] - (10.0 - 10.0 * share)).abs() < 1e-12,
                "{anchor:?}"
            );
        }
        assert_eq!(segment.anchor_weight(&SOFTNESS) * ANCHORS as u64, 3 * UNIT);
    }

    #[test]
    fn parts_of_a_facet_add_up() {
        let (center, a, b) = ([0.3, 0.2, 10.0], [-1.0, 0.1, 0.0], [1.0, -0.2, 0.5]);
        let segment = SegmentEvidence {
            center: &center,
            ends: [&a, &b],
            sigmas: [Some(0.3), None],
            weight: 1000,
        };
        // A wide triangle at height 1, and the three triangles that a point within makes of it, each over an apex below.
        let wide = [[-9.0, -9.0, 1.0], [9.0, -9.0, 1.0], [0.0, 9.0, 1.0]];
        let within = [0.11, 0.07, 1.0];
        let apex = [0.0, 0.0, 0.8];
        let entered = |base: [&[f64; 3]; 3]| {
            let [p, q, r] = base;
            let cell = if orient3d(p, q, r, &apex) > 0.0 {
                [p, q, r, &apex]
            } else {
                [q, p, r, &apex]
            };
            // The facet opposite the apex.
            segment
                .passage(&segment.frame(&SOFTNESS), cell, segment.ends_in(cell))
                .entered[3]
        };
        let [p, q, r] = &wide;
        let whole = entered([p, q, r]);
        let parts = entered([p, q, &within]) + entered([q, r, &within]) + entered([r, p, &within]);
        assert!(whole > 200_000 && whole < 1000 * UNIT, "{whole}");
        // Three are averaged more finely than one.
        assert!(whole.abs_diff(parts) < whole / 200, "{whole} {parts}");
    }

    #[test]
    fn the_cell_of_the_centre_is_free() {
        let cell = [
            [-9.0, -9.0, 1.0],
            [0.0, 9.0, 1.0],
            [9.0, -9.0, 1.0],
            [0.0, 0.0, 20.0],
        ];
        let mut corners = cell.each_ref();
        if orient3d(corners[0], corners[1], corners[2], corners[3]) < 0.0 {
            corners.swap(0, 1);
        }
        let segment = SegmentEvidence {
            center: &[0.0, 0.0, 10.0],
            ends: [&[-1.0, 0.0, 0.0], &[1.0, 0.0, 0.0]],
            sigmas: [None; 2],
            weight: 2,
        };
        let contribution = segment.passage(&segment.frame(&SOFTNESS), corners, true);
        assert_eq!(
            (
                contribution.free,
                contribution.entered,
                contribution.occupied
            ),
            (2 * UNIT, [0; 4], 0)
        );
    }
}
