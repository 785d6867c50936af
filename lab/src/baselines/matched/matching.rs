//! Candidate matches: segments of two views that overlap between epipolar lines.

use nalgebra::{Point2, Vector3};

use super::options::MatchedOptions;
use super::view::View;

/// A segment of one view matched with one of another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Match {
    /// The other view and its segment.
    pub(super) view: u32,
    pub(super) segment: u32,
    /// Intersection over union between the epipolar lines.
    pub(super) overlap: f64,
    /// Distances along the rays of the own segment's ends.
    pub(super) distances: [f64; 2],
    pub(super) score: f64,
}

/// All matches of a view: those of its segment `i` are `matches[offsets[i]..offsets[i + 1]]`, view by view.
#[derive(Debug, Clone)]
pub(super) struct ViewMatches {
    pub(super) offsets: Vec<u32>,
    pub(super) matches: Vec<Match>,
}

impl ViewMatches {
    /// The matches of a segment.
    pub(super) fn of(&self, segment: usize) -> &[Match] {
        &self.matches[self.offsets[segment] as usize..self.offsets[segment + 1] as usize]
    }
}

/// Matches every segment of a view with the segments of its neighbours.
pub(super) fn match_view(
    views: &[View],
    index: usize,
    neighbours: &[u32],
    options: &MatchedOptions,
) -> ViewMatches {
    let view = &views[index];
    let fundamentals: Vec<_> = neighbours
        .iter()
        .map(|&other| view.fundamental(&views[other as usize]))
        .collect();
    let mut all = ViewMatches {
        offsets: vec![0],
        matches: Vec::new(),
    };
    let mut best: Vec<Match> = Vec::new();
    for (id, segment) in view.segments.iter().enumerate() {
        let pixels = segment.ends_px.map(|end| homogeneous(&end));
        for (&other, fundamental) in neighbours.iter().zip(&fundamentals) {
            let lines = pixels.map(|pixel| fundamental * pixel);
            best.clear();
            for (candidate, target) in views[other as usize].segments.iter().enumerate() {
                let Some(overlap) = overlap(&lines, &target.ends_px, target.length_px) else {
                    continue;
                };
                if overlap <= options.minimum_overlap
                    || (best.len() == options.matches_per_view
                        && best.last().is_some_and(|last| last.overlap >= overlap))
                {
                    continue;
                }
                let Some(distances) =
                    triangulate(view, id, &views[other as usize], candidate, options)
                else {
                    continue;
                };
                let rank = best.partition_point(|found| found.overlap >= overlap);
                best.insert(
                    rank,
                    Match {
                        view: other,
                        segment: candidate as u32,
                        overlap,
                        distances,
                        score: 0.0,
                    },
                );
                best.truncate(options.matches_per_view);
            }
            all.matches.extend_from_slice(&best);
        }
        all.offsets.push(all.matches.len() as u32);
    }
    all
}

fn homogeneous(pixel: &Point2<f64>) -> Vector3<f64> {
    Vector3::new(pixel.x, pixel.y, 1.0)
}

/// Intersection over union of a segment and the interval between two epipolar lines on its line; `None` when an epipolar line is
/// parallel to it, or everything lies within a pixel.
fn overlap(lines: &[Vector3<f64>; 2], ends: &[Point2<f64>; 2], length_px: f64) -> Option<f64> {
    // Intersection with an epipolar line, as a share from the first end to the second.
    let share = |line: &Vector3<f64>| {
        let at = |end: &Point2<f64>| line.x * end.x + line.y * end.y + line.z;
        let (first, second) = (at(&ends[0]), at(&ends[1]));
        first / (first - second)
    };
    let (a, b) = (share(&lines[0]), share(&lines[1]));
    if !(a.is_finite() && b.is_finite()) {
        return None;
    }
    let (low, high) = if a <= b { (a, b) } else { (b, a) };
    let common = high.min(1.0) - low.max(0.0);
    let whole = high.max(1.0) - low.min(0.0);
    (common > 0.0 && whole * length_px >= 1.0).then(|| common / whole)
}

/// The distances of the ends of a segment of `view` when it is matched with a segment of `other`; `None` when one of the two
/// segments lies behind its camera or along its view rays.
fn triangulate(
    view: &View,
    segment: usize,
    other: &View,
    candidate: usize,
    options: &MatchedOptions,
) -> Option<[f64; 2]> {
    let (own, target) = (&view.segments[segment], &other.segments[candidate]);
    let baseline = other.center - view.center;
    let distances = |rays: &[Vector3<f64>; 2], normal: &Vector3<f64>, to: &Vector3<f64>| {
        let height = to.dot(normal);
        let found = [height / rays[0].dot(normal), height / rays[1].dot(normal)];
        let is_in_front = |d: &f64| d.is_finite() && *d > 0.0;
        found.iter().all(is_in_front).then_some(found)
    };
    let found = distances(&own.rays, &target.normal, &baseline)?;
    distances(&target.rays, &own.normal, &-baseline)?;
    // The depth of a segment along the view rays is not determined.
    let along = own.rays[1] * found[1] - own.rays[0] * found[0];
    let middle = own.rays[1] + own.rays[0];
    let cosine = along.dot(&middle).abs() / (along.norm() * middle.norm());
    (cosine < options.minimum_view_angle_rad.cos()).then_some(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlap_is_intersection_over_union() {
        let ends = [Point2::new(0.0, 0.0), Point2::new(10.0, 0.0)];
        // Vertical epipolar lines x = c.
        let at = |c: f64| Vector3::new(1.0, 0.0, -c);
        assert_eq!(overlap(&[at(0.0), at(10.0)], &ends, 10.0), Some(1.0));
        assert_eq!(overlap(&[at(15.0), at(5.0)], &ends, 10.0), Some(5.0 / 15.0));
        assert_eq!(overlap(&[at(11.0), at(15.0)], &ends, 10.0), None);
        // An epipolar line parallel to the segment has no intersection.
        let along = Vector3::new(0.0, 1.0, 0.0);
        assert_eq!(overlap(&[along, at(5.0)], &ends, 10.0), None);
    }
}
