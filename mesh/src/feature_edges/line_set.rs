//! Feature edges as a line set.

use nalgebra::Point3;

use super::find::{EdgeKind, FeatureEdge};
use super::unique_positions::UniquePositions;
use crate::{LineSet, TriangleMesh};

/// sRGB colour of creases in files.
pub const CREASE_COLOR: [u8; 3] = [220, 20, 60];
/// sRGB colour of edges along known lines in files.
pub const LINE_COLOR: [u8; 3] = [0, 200, 100];
/// sRGB colour of boundary edges in files.
pub const BOUNDARY_COLOR: [u8; 3] = [120, 120, 130];

/// Feature edges as coloured lines, with counts and lengths by kind.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FeatureLines {
    /// The lines: creases, then edges along lines, then boundary edges, each in ascending order of their end
    /// positions. Lines of one kind share points where they meet; lines of different kinds do not, because points
    /// have the colour of their kind.
    pub lines: LineSet,
    /// Number of creases, edges along lines and boundary edges.
    pub counts: [usize; 3],
    /// Total length by kind, in units of the mesh.
    pub lengths: [f64; 3],
}

impl FeatureLines {
    /// Collects edges of a mesh. Edges between equal positions become one, of the strongest kind.
    ///
    /// # Panics
    /// When an edge refers to a vertex that does not exist.
    pub fn new(mesh: &TriangleMesh, edges: impl IntoIterator<Item = FeatureEdge>) -> Self {
        let unique = UniquePositions::new(&mesh.positions);
        let mut by_position: Vec<([u32; 2], FeatureEdge)> = edges
            .into_iter()
            .map(|mut edge| {
                if unique.of(edge.ends[0]) > unique.of(edge.ends[1]) {
                    edge.ends.reverse();
                }
                (edge.ends.map(|vertex| unique.of(vertex)), edge)
            })
            .collect();
        by_position.sort_unstable_by_key(|(at, edge)| (*at, edge.kind, edge.ends));
        by_position.dedup_by_key(|(at, _)| *at);
        let mut found = Self::default();
        let kinds = [
            (EdgeKind::Crease, CREASE_COLOR),
            (EdgeKind::AlongLine, LINE_COLOR),
            (EdgeKind::Boundary, BOUNDARY_COLOR),
        ];
        let mut colors = Vec::new();
        for (index, (kind, color)) in kinds.into_iter().enumerate() {
            let of_kind: Vec<_> = by_position.iter().filter(|(_, e)| e.kind == kind).collect();
            let first = found.lines.points.len() as u32;
            let mut points: Vec<(u32, Point3<f64>)> = of_kind
                .iter()
                .flat_map(|(at, edge)| {
                    let positions = edge.ends.map(|vertex| mesh.positions[vertex as usize]);
                    [(at[0], positions[0]), (at[1], positions[1])]
                })
                .collect();
            points.sort_by_key(|(position, _)| *position);
            points.dedup_by_key(|(position, _)| *position);
            let name = |position: &u32| points.partition_point(|(at, _)| at < position) as u32;
            for (at, edge) in &of_kind {
                let [p, q] = edge.ends.map(|vertex| mesh.positions[vertex as usize]);
                found.lengths[index] += (q - p).norm();
                found
                    .lines
                    .lines
                    .push([0, 1].map(|end| first + name(&at[end])));
            }
            found.counts[index] = of_kind.len();
            colors.resize(colors.len() + points.len(), color);
            found
                .lines
                .points
                .extend(points.iter().map(|(_, point)| *point));
        }
        found.lines.colors = Some(colors);
        found
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_kind_share_points_and_copies_are_one() {
        let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let mesh = TriangleMesh {
            positions: vec![at(1.0, 0.0), at(0.0, 0.0), at(1.0, 2.0), at(1.0, 0.0)],
            ..TriangleMesh::default()
        };
        let edge = |ends, kind| FeatureEdge { ends, kind };
        let found = FeatureLines::new(
            &mesh,
            [
                edge([2, 3], EdgeKind::Boundary),
                edge([0, 1], EdgeKind::AlongLine),
                edge([0, 2], EdgeKind::Crease),
                edge([1, 3], EdgeKind::AlongLine),
                edge([2, 1], EdgeKind::AlongLine),
            ],
        );
        assert_eq!(found.counts, [1, 2, 0]);
        assert_eq!(found.lengths, [2.0, 1.0 + 5.0_f64.sqrt(), 0.0]);
        let lines = &found.lines;
        lines.validate().unwrap();
        assert_eq!(lines.lines, [[0, 1], [2, 3], [2, 4]]);
        assert_eq!(
            lines.points[2..],
            [at(0.0, 0.0), at(1.0, 0.0), at(1.0, 2.0)]
        );
        assert_eq!(lines.points[..2], [at(1.0, 0.0), at(1.0, 2.0)]);
        let colors = lines.colors.as_ref().unwrap();
        assert_eq!(colors[..3], [CREASE_COLOR, CREASE_COLOR, LINE_COLOR]);
    }
}
