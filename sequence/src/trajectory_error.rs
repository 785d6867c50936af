//! Camera trajectories over time, and the similarity that aligns one to another.

use std::path::{Path, PathBuf};

use nalgebra::{Point3, Similarity3};

use crate::parse_stamp_ns;
use linecarve_mesh::evaluate::fit_similarity;

/// Largest time difference of associated poses, as in the tools of the TUM benchmark.
const MAX_DIFFERENCE_NS: u64 = 20_000_000;

/// Camera positions over time, in ascending order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Trajectory {
    path: PathBuf,
    positions: Vec<(i64, Point3<f64>)>,
}

/// Why a trajectory cannot be read or aligned.
#[derive(Debug, thiserror::Error)]
pub enum TrajectoryError {
    /// The file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: std::io::Error,
    },
    /// A row is not `time x y z ...`.
    #[error("{}, line {line}: expected `seconds tx ty tz qx qy qz qw`, found `{row}`", path.display())]
    TextLine {
        /// The file.
        path: PathBuf,
        /// Line number, from 1.
        line: usize,
        /// The line, truncated.
        row: String,
    },
    /// Too few poses can be associated by time.
    #[error(
        "{} and {}: only {pairs} of {} and {} poses lie within 20 ms of one another, three are needed: check that both \
         files are of the same recording and clock",
        first.display(), second.display(), counts.0, counts.1
    )]
    TooFewPairs {
        /// The first file.
        first: PathBuf,
        /// The second file.
        second: PathBuf,
        /// Number of associated poses.
        pairs: usize,
        /// Number of poses in each file.
        counts: (usize, usize),
    },
    /// The positions do not determine the rotation.
    #[error(
        "{}: the camera moves along a straight line, which does not determine the rotation about it: use --align icp or sim3",
        first.display()
    )]
    Straight {
        /// The first file.
        first: PathBuf,
    },
}

impl Trajectory {
    /// Reads a trajectory in TUM format: `seconds tx ty tz qx qy qz qw` in each line; the quaternion may be absent. Lines
    /// starting with `#` are comments. Positions that are not finite (lost tracking) are skipped.
    ///
    /// # Errors
    /// If the file cannot be read or a line has another format.
    pub fn read(path: &Path) -> Result<Self, TrajectoryError> {
        let text = std::fs::read(path).map_err(|source| TrajectoryError::Open {
            path: path.to_owned(),
            source,
        })?;
        Self::parse(path, &String::from_utf8_lossy(&text))
    }

    fn parse(path: &Path, text: &str) -> Result<Self, TrajectoryError> {
        let mut positions = Vec::new();
        for (number, row) in text.lines().enumerate() {
            let row = row.trim();
            if row.is_empty() || row.starts_with('#') {
                continue;
            }
            let mut words = row
                .split(|c: char| c.is_ascii_whitespace() || c == ',')
                .filter(|word| !word.is_empty());
            let stamp = words.next().and_then(parse_stamp_ns);
            let mut number_of = || words.next().and_then(|word| word.parse::<f64>().ok());
            let (Some(stamp), Some(x), Some(y), Some(z)) =
                (stamp, number_of(), number_of(), number_of())
            else {
                return Err(TrajectoryError::TextLine {
                    path: path.to_owned(),
                    line: number + 1,
                    row: row.chars().take(60).collect(),
                });
            };
            if [x, y, z].iter().all(|v| v.is_finite()) {
                positions.push((stamp, Point3::new(x, y, z)));
            }
        }
        positions.sort_by_key(|(stamp, _)| *stamp);
        Ok(Self {
            path: path.to_owned(),
            positions,
        })
    }

    /// Number of poses.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether the trajectory has no poses.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The similarity that aligns this trajectory to `truth` in the least-squares sense, and the number of associated poses.
    /// Each pose is associated with the nearest in time, within 20 ms.
    ///
    /// # Errors
    /// If fewer than three poses are associated, or the positions are collinear.
    pub fn similarity_to(
        &self,
        truth: &Self,
    ) -> Result<(Similarity3<f64>, usize), TrajectoryError> {
        let (mut from, mut to) = (Vec::new(), Vec::new());
        for (stamp, position) in &self.positions {
            let after = truth.positions.partition_point(|(other, _)| other < stamp);
            let nearest = [after.checked_sub(1), Some(after)]
                .into_iter()
                .flatten()
                .filter_map(|index| truth.positions.get(index))
                .min_by_key(|(other, _)| other.abs_diff(*stamp));
            if let Some((other, partner)) = nearest
                && other.abs_diff(*stamp) <= MAX_DIFFERENCE_NS
            {
                from.push(*position);
                to.push(*partner);
            }
        }
        if from.len() < 3 {
            return Err(TrajectoryError::TooFewPairs {
                first: self.path.clone(),
                second: truth.path.clone(),
                pairs: from.len(),
                counts: (self.len(), truth.len()),
            });
        }
        let fitted = fit_similarity(&from, &to, true).ok_or(TrajectoryError::Straight {
            first: self.path.clone(),
        })?;
        Ok((fitted, from.len()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn parse(text: &str) -> Result<Trajectory, TrajectoryError> {
        Trajectory::parse(Path::new("poses.tum"), text)
    }

    #[test]
    fn poses_are_paired_by_time_and_fitted() {
        let given = Similarity3::new(
            Vector3::new(1.0, 2.0, 3.0),
            Vector3::new(0.1, 0.5, -0.3),
            2.5,
        );
        let (mut estimated, mut truth) = (String::from("# time x y z\n"), String::new());
        for i in 0..20 {
            let t = f64::from(i);
            let p = Point3::new(t.sin(), t.cos(), 0.1 * t);
            let q = given * p;
            estimated += &format!("{:.6} {} {} {} 0 0 0 1\n", 1000.0 + t, p.x, p.y, p.z);
            truth += &format!("{:.6} {} {} {}\n", 1000.012 + t, q.x, q.y, q.z);
        }
        estimated += "1020.0 nan nan nan 0 0 0 1\n5000.0 1 2 3 0 0 0 1\n";
        let (found, pairs) = parse(&estimated)
            .unwrap()
            .similarity_to(&parse(&truth).unwrap())
            .unwrap();
        assert_eq!(pairs, 20);
        assert!((found.scaling() - 2.5).abs() < 1e-9);
        let p = Point3::new(4.0, 5.0, 6.0);
        assert!((found * p - given * p).norm() < 1e-9);
    }

    #[test]
    fn bad_lines_and_undetermined_alignments_are_refused() {
        let message = parse("1 2 3\n").unwrap_err().to_string();
        assert!(message.contains("poses.tum, line 1"), "{message}");
        let few = parse("1 0 0 0\n2 1 0 0\n").unwrap();
        assert!(
            few.similarity_to(&few)
                .unwrap_err()
                .to_string()
                .contains("three")
        );
        let straight = parse("1 0 0 0\n2 1 0 0\n3 2 0 0\n4 5 0 0\n").unwrap();
        let message = straight.similarity_to(&straight).unwrap_err().to_string();
        assert!(message.contains("straight line"), "{message}");
    }
}
