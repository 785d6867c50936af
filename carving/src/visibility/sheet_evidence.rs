//! What a segment seen by a view says about a cell: the rays to all of its points, together one ray.
//!
//! Between the rays to the two ends lie the rays to all points between. A facet that the triangle of centre and ends
//! cuts is pierced by a part of them; that part of the weight it costs to be matter behind the facet, less near the
//! segment, as for [single rays](super::softness). The deviation at a point of the segment lies between those of the ends,
//! in proportion. Where the triangle is cut across from side to side the parts add up to the weight of one ray.
//!
//! All is a function of positions, deviations and weight of one segment and one cell; ends and corners are put in order by
//! position first.

use crate::predicates::orient3d;
use crate::tetrahedralization::Tetrahedralization;

use super::evidence::CellEvidence;
use super::softness::{MAX_WEIGHT, Softness, UNIT, cross, dot, in_order, minus, precedes, soft};

/// A segment seen by a view, as evidence.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SheetSight<'a> {
    pub(crate) center: &'a [f64; 3],
    pub(crate) ends: [&'a [f64; 3]; 2],
    /// Standard deviations of the ends along the rays to them.
    pub(crate) sigmas: [Option<f64>; 2],
    pub(crate) weight: u32,
}

/// Rays over which the part of a facet is averaged.
const RAYS: usize = 4;

/// The triangle as a frame of its plane: the centre is the origin, the ends are the axes.
struct Frame {
    ends: [[f64; 3]; 2],
    sigmas: [f64; 2],
    normal: [f64; 3],
    squared: f64,
}

impl Frame {
    /// Where an edge of a facet cuts the plane, if it does, by the two coordinates; corners relative to the centre.
    fn cut(&self, p: &[f64; 3], q: &[f64; 3], heights: [f64; 2]) -> Option<[f64; 2]> {
        let [above, below] = heights;
        if (above > 0.0) == (below > 0.0) {
            return None;
        }
        let share = above / (above - below);
        let point: [f64; 3] = std::array::from_fn(|k| p[k] + share * (q[k] - p[k]));
        let [a, b] = &self.ends;
        Some([
            dot(&self.normal, &cross(&point, b)) / self.squared,
            dot(&self.normal, &cross(a, &point)) / self.squared,
        ])
    }

    /// Mean of what the rays between two places in the triangle say, times their part of all rays.
    fn part(&self, from: [f64; 2], to: [f64; 2]) -> f64 {
        // The share of the way from the first end to the second at which the ray through a place ends.
        let share = |[u, v]: [f64; 2]| v / (u + v);
        let (first, last) = (share(from), share(to));
        let part = (last - first).abs();
        // Also for what is not a number, at the centre.
        if part.is_nan() || part <= 0.0 {
            return 0.0;
        }
        let step = [to[0] - from[0], to[1] - from[1]];
        let turn = from[0] * step[1] - from[1] * step[0];
        let said: f64 = (0..RAYS)
            .map(|k| {
                let t = first + (last - first) * (k as f64 + 0.5) / RAYS as f64;
                // How far from the centre, as a share of the ray, it meets the line between the two places.
                let reach = (turn / ((1.0 - t) * step[1] - t * step[0])).clamp(0.0, 1.0);
                let [a, b] = &self.ends;
                let target: [f64; 3] = std::array::from_fn(|k| a[k] + t * (b[k] - a[k]));
                let sigma = self.sigmas[0] + t * (self.sigmas[1] - self.sigmas[0]);
                soft((1.0 - reach) * dot(&target, &target).sqrt() / sigma)
            })
            .sum();
        said / RAYS as f64 * part
    }
}

/// The part of the way between two places that lies in the triangle between the origin and (1, 0) and (0, 1).
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

impl SheetSight<'_> {
    fn frame(&self, softness: &Softness) -> Frame {
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
        Frame {
            ends,
            sigmas: order.map(sigma),
            normal,
            squared: dot(&normal, &normal),
        }
    }

    /// What it says about a finite cell that it meets.
    pub(crate) fn passage(&self, softness: &Softness, cell: [&[f64; 3]; 4]) -> CellEvidence {
        let mut said = CellEvidence::default();
        let frame = self.frame(softness);
        let weight = u64::from(self.weight.min(MAX_WEIGHT)) * UNIT;
        let mut is_center_inside = true;
        for (facet, corners) in Tetrahedralization::FACET.iter().enumerate() {
            let corners = corners.map(|k| cell[k]);
            let [p, q, r] = corners;
            let side = orient3d(p, q, r, self.center);
            is_center_inside &= side > 0.0;
            if side >= 0.0 {
                continue;
            }
            let corners = in_order(corners).map(|corner| minus(corner, self.center));
            let heights = [0, 1, 2].map(|k: usize| dot(&frame.normal, &corners[k]));
            let mut cuts = [(0, 1), (1, 2), (0, 2)]
                .into_iter()
                .filter_map(|(i, j)| frame.cut(&corners[i], &corners[j], [heights[i], heights[j]]));
            if let (Some(from), Some(to)) = (cuts.next(), cuts.next())
                && let Some([from, to]) = clipped(from, to)
            {
                let part = frame.part(from, to);
                said.entered[facet] = (weight as f64 * part).round() as u64;
            }
        }
        if is_center_inside {
            said.free = weight;
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOFTNESS: Softness = Softness {
        relative_sigma: 0.01,
        behind_sigmas: 2.0,
        tie: UNIT,
    };

    /// A cell in front of the middle of a segment, its base towards it at a height.
    fn cost(height: f64, sigma: f64, flip: bool) -> [u64; 4] {
        let (a, b) = ([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]);
        // Its facet towards the centre is cut from side to side; the base lies far below.
        let cell = [
            [-9.0, -9.0, height],
            [9.0, -9.0, height],
            [0.0, 9.0, height],
            [0.0, 0.0, -20.0],
        ];
        let cell = if orient3d(&cell[0], &cell[1], &cell[2], &cell[3]) > 0.0 {
            cell
        } else {
            [cell[1], cell[0], cell[2], cell[3]]
        };
        let sight = SheetSight {
            center: &[0.0, 0.0, 10.0],
            ends: if flip { [&b, &a] } else { [&a, &b] },
            sigmas: [Some(sigma); 2],
            weight: 3,
        };
        sight.passage(&SOFTNESS, cell.each_ref()).entered
    }

    #[test]
    fn a_facet_far_in_front_costs_one_ray_and_one_at_the_segment_nothing() {
        assert_eq!(cost(5.0, 0.1, false).iter().sum::<u64>(), 3 * UNIT);
        assert_eq!(cost(0.0, 0.1, false).iter().sum::<u64>(), 0);
        // At about one deviation: 1 - exp(-1/2) = 0.39 of 768; rays aside are a little longer.
        let near = cost(0.1, 0.1, false);
        assert!((300..306).contains(&near.iter().sum::<u64>()), "{near:?}");
        assert_eq!(near, cost(0.1, 0.1, true));
        // Behind the segment nothing.
        assert_eq!(cost(-0.1, 0.1, false), [0; 4]);
        // Without a deviation every facet in front is hard.
        assert_eq!(cost(1e-6, 0.0, false).iter().sum::<u64>(), 3 * UNIT);
    }

    #[test]
    fn parts_of_a_facet_add_up() {
        let (center, a, b) = ([0.3, 0.2, 10.0], [-1.0, 0.1, 0.0], [1.0, -0.2, 0.5]);
        let sight = SheetSight {
            center: &center,
            ends: [&a, &b],
            sigmas: [Some(0.3), None],
            weight: 1000,
        };
        // A wide triangle at height 1, and the three triangles that a point within makes of it, each over an apex below.
        let wide = [[-9.0, -9.0, 1.0], [9.0, -9.0, 1.0], [0.0, 9.0, 1.0]];
        let within = [0.11, 0.07, 1.0];
        let apex = [0.0, 0.0, -20.0];
        let entered = |base: [&[f64; 3]; 3]| {
            let [p, q, r] = base;
            let cell = if orient3d(p, q, r, &apex) > 0.0 {
                [p, q, r, &apex]
            } else {
                [q, p, r, &apex]
            };
            // The facet opposite the apex.
            sight.passage(&SOFTNESS, cell).entered[3]
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
        let sight = SheetSight {
            center: &[0.0, 0.0, 10.0],
            ends: [&[-1.0, 0.0, 0.0], &[1.0, 0.0, 0.0]],
            sigmas: [None; 2],
            weight: 2,
        };
        let said = sight.passage(&SOFTNESS, corners);
        assert_eq!(
            (said.free, said.entered, said.matter),
            (2 * UNIT, [0; 4], 0)
        );
    }
}
