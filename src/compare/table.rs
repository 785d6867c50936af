//! The numbers as text.

use super::result::SurfaceSummary;

/// A table of text, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ScoreTable {
    /// Headings.
    pub columns: Vec<String>,
    /// Rows, each as long as the headings.
    pub rows: Vec<Vec<String>>,
}

/// A row for each surface: what it is made from, its size, its distances to the ground truth when there is one, its time.
/// `labels` name the rows; lengths are in units of the poses.
pub fn score_table(surfaces: &[SurfaceSummary], labels: &[&str]) -> ScoreTable {
    let mut columns: Vec<String> = ["", "made from", "vertices", "faces"]
        .map(str::to_owned)
        .to_vec();
    let thresholds: Vec<f64> = surfaces
        .iter()
        .find_map(|surface| surface.evaluation.as_ref())
        .map(|evaluation| evaluation.at.iter().map(|score| score.threshold).collect())
        .unwrap_or_default();
    if !thresholds.is_empty() {
        columns.push("accuracy mean (median)".to_owned());
        columns.push("completeness mean (median)".to_owned());
        columns.extend(
            thresholds
                .iter()
                .map(|threshold| format!("F at {threshold}")),
        );
    }
    columns.push("ms a keyframe".to_owned());
    let rows = surfaces.iter().zip(labels).map(|(surface, label)| {
        let mut row = vec![
            (*label).to_owned(),
            format!("{} {}", surface.elements, surface.made_from),
            surface.vertices.to_string(),
            surface.triangles.to_string(),
        ];
        if !thresholds.is_empty() {
            let distances = |statistics: Option<linecarve_mesh::evaluate::DistanceStatistics>| {
                statistics.map_or_else(dash, |s| format!("{:.4} ({:.4})", s.mean, s.median))
            };
            let evaluation = surface.evaluation.as_ref();
            row.push(distances(evaluation.and_then(|e| e.accuracy)));
            row.push(distances(evaluation.and_then(|e| e.completeness)));
            for place in 0..thresholds.len() {
                let f = evaluation
                    .and_then(|e| e.at.get(place))
                    .and_then(|score| score.f);
                row.push(f.map_or_else(dash, |f| format!("{f:.3}")));
            }
        }
        row.push(format!("{:.1}", surface.milliseconds_per_keyframe));
        row
    });
    ScoreTable {
        rows: rows.collect(),
        columns,
    }
}

fn dash() -> String {
    "–".to_owned()
}

impl ScoreTable {
    /// Columns side by side, numbers to the right, one line a row.
    pub fn to_text(&self) -> String {
        let width = |column: usize| {
            let cells = self.rows.iter().chain([&self.columns]);
            cells
                .map(|row| row[column].chars().count())
                .max()
                .unwrap_or(0)
        };
        let widths: Vec<usize> = (0..self.columns.len()).map(width).collect();
        let mut text = String::new();
        for row in std::iter::once(&self.columns).chain(&self.rows) {
            for (column, cell) in row.iter().enumerate() {
                let gap = " ".repeat(widths[column] - cell.chars().count());
                match column {
                    0 => text += &format!("{cell}{gap}"),
                    _ => text += &format!("   {gap}{cell}"),
                }
            }
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compare::ComparedSurface;
    use linecarve_engine::map::CarvedCounts;
    use linecarve_mesh::evaluate::{EvaluationOptions, evaluate};
    use linecarve_mesh::{LineSet, Shape, TriangleMesh};
    use nalgebra::Point3;

    fn wall(z: f64) -> TriangleMesh {
        TriangleMesh {
            positions: vec![
                Point3::new(0.0, 0.0, z),
                Point3::new(4.0, 0.0, z),
                Point3::new(0.0, 3.0, z),
            ],
            triangles: vec![[0, 1, 2]],
            colors: None,
        }
    }

    fn summary(mesh: TriangleMesh) -> SurfaceSummary {
        SurfaceSummary::of(&ComparedSurface {
            name: "lines",
            label: "3D lines",
            elements_name: "segments",
            elements: 3,
            carved: CarvedCounts::default(),
            mesh,
            marks: LineSet::default(),
            keyframes: Vec::new(),
        })
    }

    #[test]
    fn scores_stand_in_the_rows_of_their_surfaces() {
        let mut options = EvaluationOptions::default();
        options.region_margin = 0.1;
        options.samples = 100;
        let mut near = summary(wall(0.03));
        let truth = Shape::from(wall(0.0));
        near.evaluation = evaluate(&Shape::from(wall(0.03)), &truth, &options).ok();
        let empty = summary(TriangleMesh::default());
        let table = score_table(&[near, empty], &["3D lines", "map points"]);
        assert_eq!(table.columns.len(), 10);
        let expected = ["3D lines", "3 segments", "3", "1", "0.0300 (0.0300)"];
        assert_eq!(table.rows[0][..5], expected);
        assert_eq!(table.rows[0][6..9], ["0.000", "1.000", "1.000"]);
        assert_eq!(table.rows[1][3..9], ["0", "–", "–", "–", "–", "–"]);
        let text = table.to_text();
        let lengths: Vec<usize> = text.lines().map(|line| line.chars().count()).collect();
        assert_eq!(lengths.len(), 3);
        assert!(lengths.iter().all(|length| *length == lengths[0]));
    }

    #[test]
    fn without_a_ground_truth_there_are_counts_and_times() {
        let table = score_table(&[summary(wall(0.0))], &["3D lines"]);
        assert_eq!(
            table.columns,
            ["", "made from", "vertices", "faces", "ms a keyframe"]
        );
    }
}
