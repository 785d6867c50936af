//! Straight borders: a chain becomes few corners, on 3D segments along it where there are any.
//!
//! 1. A chain between two planes lies on their intersection: only its ends stay.
//! 2. Any other chain is split where it leaves a straight line by more than the tolerance (Douglas & Peucker 1973).
//! 3. A line is fitted to each part, or the known segment along it is taken, and neighbouring lines are intersected.
//! 4. Vertices that remain triangles use stay on the border, moved onto it in their order.

use nalgebra::{Point3, Vector2};

use crate::border::Chain;
use crate::label::REST;
use crate::plane::Plane;
use crate::surface::unique;

/// Parts of a border turn by more at a corner between two fitted lines: cosine of 15 degrees.
const LEAST_CORNER_COSINE: f64 = 0.966;
/// A segment along a part of a border turns from it by less: cosine of 10 degrees.
const ALONG: f64 = 0.985;
/// Points of a part to which a line is fitted.
const LEAST_POINTS: usize = 4;

type Point2 = Vector2<f64>;

/// A known line in a plane: a point, its unit direction, and from where to where it reaches.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Line {
    from: Point2,
    along: Point2,
    length: f64,
}

impl Line {
    pub(crate) fn between(from: Point2, to: Point2) -> Option<Self> {
        let length = (to - from).norm();
        (length > 0.0).then(|| Self {
            from,
            along: (to - from) / length,
            length,
        })
    }

    fn across(&self, point: &Point2) -> f64 {
        self.along.perp(&(point - self.from))
    }

    fn foot(&self, point: &Point2) -> Point2 {
        self.from + self.along.dot(&(point - self.from)) * self.along
    }
}

/// Known segments near a plane, in its coordinates.
pub(crate) fn lines_in(plane: &Plane, segments: &[[Point3<f64>; 2]], reach: f64) -> Vec<Line> {
    let axes = plane.axes();
    let flat = |end: &Point3<f64>| Point2::from(plane.coordinates(end, &axes));
    let near = segments.iter();
    let near = near.filter(|ends| ends.iter().all(|end| plane.distance(end).abs() <= reach));
    near.filter_map(|[from, to]| Line::between(flat(from), flat(to)))
        .collect()
}

/// Straightens chains.
pub(crate) struct Straightener<'a> {
    pub(crate) planes: &'a [Plane],
    /// The plane of each component.
    pub(crate) plane_of: &'a [u32],
    /// Known lines in each plane.
    pub(crate) lines: &'a [Vec<Line>],
    pub(crate) tolerance: f64,
}

impl Straightener<'_> {
    /// Moves the vertices of a chain, except its end nodes, and says which of them are corners. Raw vertices stay
    /// where they are, and so does the chain between two of them.
    pub(crate) fn straighten(
        &self,
        chain: &Chain,
        is_raw: &[bool],
        positions: &mut [Point3<f64>],
        is_corner: &mut [bool],
    ) {
        let around = chain.around.iter().filter(|it| **it != REST);
        let planes = unique(around.map(|it| self.plane_of[*it as usize]));
        let keeps_all = chain.around.contains(&REST);
        let plane = &self.planes[planes[0] as usize];
        let axes = plane.axes();
        let flat =
            |vertex: &u32| Point2::from(plane.coordinates(&positions[*vertex as usize], &axes));
        let mut vertices = chain.vertices.clone();
        if chain.is_closed() {
            // From the vertex farthest from the first one: that is a corner.
            vertices.pop();
            let first = flat(&vertices[0]);
            let away = |it: &u32| (flat(it) - first).norm_squared();
            let all = (0..vertices.len()).rev();
            let far = all.max_by(|a, b| away(&vertices[*a]).total_cmp(&away(&vertices[*b])));
            vertices.rotate_left(far.unwrap_or(0));
            vertices.push(vertices[0]);
        }
        let points: Vec<Point2> = vertices.iter().map(flat).collect();
        let raw: Vec<bool> = vertices.iter().map(|it| is_raw[*it as usize]).collect();
        let corners: Vec<(usize, Point2)> = match planes.len() {
            1 => self.corners(
                &points,
                &raw,
                &self.lines[planes[0] as usize],
                chain.is_closed(),
            ),
            _ => [0, points.len() - 1].map(|it| (it, points[it])).to_vec(),
        };
        for &(index, point) in &corners {
            let vertex = vertices[index] as usize;
            is_corner[vertex] = true;
            if chain.is_closed() || (index > 0 && index + 1 < points.len()) {
                positions[vertex] = plane.at(point.into(), &axes);
            }
        }
        if !keeps_all {
            return;
        }
        for pair in corners.windows(2) {
            let ([from, to], [start, end]) = ([pair[0].0, pair[1].0], [pair[0].1, pair[1].1]);
            let span = end - start;
            let share = |point: &Point2| {
                span.dot(&(point - start)) / span.norm_squared().max(f64::MIN_POSITIVE)
            };
            let mut shares: Vec<f64> = (from + 1..to)
                .map(|it| share(&points[it]).clamp(0.0, 1.0))
                .collect();
            spread(&mut shares);
            for (index, share) in (from + 1..to).zip(shares) {
                let vertex = vertices[index] as usize;
                is_corner[vertex] = true;
                positions[vertex] = plane.at((start + share * span).into(), &axes);
            }
        }
    }

    /// The corners of a polyline: its ends, and where it turns. A closed one begins at a corner, which is repeated at the end.
    fn corners(
        &self,
        points: &[Point2],
        raw: &[bool],
        lines: &[Line],
        is_closed: bool,
    ) -> Vec<(usize, Point2)> {
        let last = points.len() - 1;
        let mut kept: Vec<usize> = (0..=last)
            .filter(|it| raw[*it] || *it == 0 || *it == last)
            .collect();
        if is_closed {
            let away = |it: &usize| (points[*it] - points[0]).norm_squared();
            let opposite = (0..last).rev().max_by(|a, b| away(a).total_cmp(&away(b)));
            kept = unique(kept.into_iter().chain(opposite));
        }
        let parts = kept.windows(2).map(|it| [it[0], it[1]]);
        let (done, open): (Vec<_>, Vec<_>) = parts.partition(|it| raw[it[0]] && raw[it[1]]);
        let between_raw = done.iter().flat_map(|it| it[0] + 1..it[1]);
        let splits = split(points, open, self.tolerance);
        let kept = unique(kept.into_iter().chain(between_raw).chain(splits));
        let part = |pair: &[usize]| match pair[1] - pair[0] {
            1 => None,
            _ => self.line(&points[pair[0]..=pair[1]], lines),
        };
        let parts: Vec<Option<Line>> = kept.windows(2).map(part).collect();
        let count = parts.len();
        let corner = |at: usize| {
            let point = points[kept[at]];
            let [before, after] = match at {
                _ if raw[kept[at]] => [None, None],
                _ if is_closed => [parts[(at + count - 1) % count], parts[at % count]],
                _ if at == 0 || at == count => [None, None],
                _ => [parts[at - 1], parts[at]],
            };
            (kept[at], self.join(point, before, after))
        };
        (0..kept.len()).map(corner).collect()
    }

    /// Where two lines meet, near a point.
    fn join(&self, point: Point2, before: Option<Line>, after: Option<Line>) -> Point2 {
        let near = |it: &Point2| (it - point).norm() <= 2.0 * self.tolerance;
        let found = match (before, after) {
            (Some(a), Some(b)) if a.along.dot(&b.along).abs() < LEAST_CORNER_COSINE => {
                let share = (b.from - a.from).perp(&b.along) / a.along.perp(&b.along);
                Some(a.from + share * a.along)
            }
            (Some(a), Some(b)) => Some(0.5 * (a.foot(&point) + b.foot(&point))),
            (Some(line), None) | (None, Some(line)) => Some(line.foot(&point)),
            (None, None) => None,
        };
        found.filter(near).unwrap_or(point)
    }

    /// The known line along a part of a polyline, else the line fitted to it; `None` for short parts.
    fn line(&self, points: &[Point2], lines: &[Line]) -> Option<Line> {
        let chord = Line::between(points[0], points[points.len() - 1])?;
        let mean = |line: &Line| {
            points.iter().map(|it| line.across(it).abs()).sum::<f64>() / points.len() as f64
        };
        let overlap = |line: &Line| {
            let ends = [points[0], points[points.len() - 1]];
            let [a, b] = ends.map(|it| line.along.dot(&(it - line.from)).clamp(0.0, line.length));
            (b - a).abs()
        };
        let known = lines.iter().filter(|line| {
            line.along.dot(&chord.along).abs() >= ALONG
                && overlap(line) >= 0.5 * chord.length
                && mean(line) <= self.tolerance
        });
        let known = known.map(|line| (overlap(line), line));
        if let Some((_, line)) = known.max_by(|a, b| a.0.total_cmp(&b.0)) {
            return Some(*line);
        }
        if points.len() < LEAST_POINTS {
            return None;
        }
        let center = points.iter().sum::<Point2>() / points.len() as f64;
        let spread: nalgebra::Matrix2<f64> = (points.iter())
            .map(|it| (it - center) * (it - center).transpose())
            .sum();
        let eigen = spread.symmetric_eigen();
        let along = eigen
            .eigenvectors
            .column(eigen.eigenvalues.imax())
            .into_owned();
        Some(Line {
            from: center,
            along,
            length: chord.length,
        })
    }
}

/// Where parts of a polyline are split: at the farthest point from each chord, until all are within the tolerance.
fn split(points: &[Point2], mut open: Vec<[usize; 2]>, tolerance: f64) -> Vec<usize> {
    let mut all = Vec::new();
    while let Some([from, to]) = open.pop() {
        let chord = Line::between(points[from], points[to]);
        let away = |it: usize| match &chord {
            Some(line) => {
                let share = line
                    .along
                    .dot(&(points[it] - line.from))
                    .clamp(0.0, line.length);
                (points[it] - line.from - share * line.along).norm()
            }
            None => (points[it] - points[from]).norm(),
        };
        let farthest = (from + 1..to).rev().map(|it| (away(it), it));
        let farthest = farthest.max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((distance, at)) = farthest
            && distance > tolerance
        {
            all.push(at);
            open.extend([[from, at], [at, to]]);
        }
    }
    all
}

/// Makes shares between 0 and 1 ascend strictly: the order stays, and equal ones are spread evenly up to the next.
fn spread(shares: &mut [f64]) {
    for index in 1..shares.len() {
        shares[index] = shares[index].max(shares[index - 1]);
    }
    let mut start = 0;
    while start < shares.len() {
        let value = shares[start];
        let mut end = start;
        while end < shares.len() && shares[end] - value <= 1e-9 {
            end += 1;
        }
        let before = if start == 0 { 0.0 } else { shares[start - 1] };
        let after = shares.get(end).copied().unwrap_or(1.0);
        if end - start > 1 || value - before <= 1e-9 || after - value <= 1e-9 {
            let parts = (end - start + 1) as f64;
            for (rank, share) in (1..).zip(&mut shares[start..end]) {
                *share = before + (after - before) * f64::from(rank) / parts;
            }
        }
        start = end;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;

    /// A square of side 2 around the origin, with corners and three vertices between them that are off by so much, outwards and inwards.
    fn square(off: f64) -> Vec<Point3<f64>> {
        let side = |[x, y]: [f64; 2], [u, v]: [f64; 2]| {
            (0..4).map(move |it| {
                let along = 0.5 * f64::from(it);
                let off = [0.0, off, -off, off][it as usize];
                Point3::new(x + along * u + off * v, y + along * v - off * u, 0.0)
            })
        };
        let sides = [
            side([-1.0, -1.0], [1.0, 0.0]),
            side([1.0, -1.0], [0.0, 1.0]),
            side([1.0, 1.0], [-1.0, 0.0]),
            side([-1.0, 1.0], [0.0, -1.0]),
        ];
        sides.into_iter().flatten().collect()
    }

    /// The corners that remain of such a square as a hole, and all positions.
    fn straightened(around: Vec<u32>, raw: &[usize]) -> (Vec<usize>, Vec<Point3<f64>>) {
        let mut positions = square(0.02);
        let count = positions.len();
        let chain = Chain {
            around,
            vertices: (0..count as u32).chain([0]).collect(),
        };
        let planes = [Plane::new(Vector3::z(), Point3::origin())];
        let straightener = Straightener {
            planes: &planes,
            plane_of: &[0],
            lines: &[vec![]],
            tolerance: 0.1,
        };
        let mut is_raw = vec![false; count];
        raw.iter().for_each(|it| is_raw[*it] = true);
        let mut is_corner = vec![false; count];
        straightener.straighten(&chain, &is_raw, &mut positions, &mut is_corner);
        ((0..count).filter(|it| is_corner[*it]).collect(), positions)
    }

    #[test]
    fn a_jagged_square_has_four_corners() {
        let (corners, positions) = straightened(vec![0], &[]);
        assert_eq!(corners, [0, 4, 8, 12]);
        for corner in corners {
            let [x, y] = [positions[corner].x, positions[corner].y];
            // The mean of the sides lies a little further out.
            assert!(
                (1.0..1.02).contains(&x.abs()) && (1.0..1.02).contains(&y.abs()),
                "{x} {y}"
            );
        }
    }

    #[test]
    fn beside_triangles_all_vertices_stay_on_the_straight_border_in_order() {
        let (corners, positions) = straightened(vec![0, REST], &[]);
        assert_eq!(corners.len(), 16);
        let side = &positions[4..=8];
        assert!(side.windows(2).all(|it| it[1].y > it[0].y));
        let chord = side[4] - side[0];
        for position in side {
            assert!(chord.cross(&(position - side[0])).norm() < 1e-12);
        }
    }

    #[test]
    fn raw_vertices_stay_and_so_does_what_is_between_them() {
        let (corners, positions) = straightened(vec![0], &[5, 7]);
        assert_eq!(corners, [0, 4, 5, 6, 7, 8, 12]);
        assert_eq!(positions[5..=7], square(0.02)[5..=7]);
    }

    #[test]
    fn equal_shares_are_spread() {
        let mut shares = [0.0, 0.5, 0.2, 0.5, 0.9, 1.0];
        spread(&mut shares);
        assert!(shares[0] > 0.0 && shares[5] < 1.0);
        assert!(shares.windows(2).all(|it| it[1] > it[0]), "{shares:?}");
    }
}
