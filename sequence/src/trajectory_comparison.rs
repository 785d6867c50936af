//! Errors of an estimated trajectory against a reference.

use std::collections::BTreeSet;
use std::path::Path;

use linecarve_lines::fit_similarity;
use linecarve_mesh::files::read_regular;
use nalgebra::{Isometry3, Point3, Similarity3};
use serde::Serialize;

use crate::export::posed_images;
use crate::parse_stamp_ns;
use crate::poses::{Poses, read_pose_file};
use crate::{OpenOptions, Sequence, SequenceError};

/// Largest time difference of associated poses, as in the tools of the TUM benchmark.
const MAX_DIFFERENCE_NS: u64 = 20_000_000;

/// Time between poses that are only counted.
const SECOND_NS: i64 = 1_000_000_000;

/// Poses over time, ascending: `point_in_world = world_from_camera * point_in_camera`.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TimedPoses {
    /// Time in nanoseconds and pose.
    pub poses: Vec<(i64, Isometry3<f64>)>,
    /// Times of the frames that should have a pose, if known.
    pub frames: Option<Vec<i64>>,
    /// Whether the poses have no times and are counted instead, a second apart.
    pub is_counted: bool,
}

/// How an estimate is brought into the frame of the reference.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TrajectoryAlignment {
    /// It is there.
    None,
    /// A rigid motion that minimises the squared distances of positions.
    Se3,
    /// The same with a scale.
    Sim3,
}

/// Errors between frames a fixed number apart: root mean squares.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RelativeError {
    /// Number of frames from one to the other.
    pub frames_apart: usize,
    /// Pairs of frames.
    pub pairs: usize,
    /// Translation, in the unit of the reference.
    pub translation: f64,
    /// Rotation.
    pub rotation_degrees: f64,
}

/// Errors of positions: absolute trajectory error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PositionError {
    /// Root mean square.
    pub rmse: f64,
    /// Median.
    pub median: f64,
    /// Largest.
    pub max: f64,
}

/// Errors of an estimated trajectory.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrajectoryComparison {
    /// How the two were aligned.
    pub alignment: TrajectoryAlignment,
    /// Scale of the alignment.
    pub scale: f64,
    /// Poses of the estimate that have a partner in the reference.
    pub pairs: usize,
    /// Frames that should have a pose.
    pub frames: usize,
    /// Share of them that has one.
    pub coverage: f64,
    /// Length of the path of the reference between the associated poses.
    pub path: f64,
    /// Root mean square distance of the reference positions from their mean: the error of a camera that stands still.
    pub spread: f64,
    /// Errors of positions after alignment.
    pub position: PositionError,
    /// Errors between frames one and ten apart, where all between them have poses.
    pub relative: Vec<RelativeError>,
}

/// Why trajectories cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum ComparisonError {
    /// A file or folder cannot be read.
    #[error(transparent)]
    Read(#[from] SequenceError),
    /// Too few poses can be associated by time.
    #[error(
        "only {pairs} of {estimated} estimated and {reference} reference poses lie within 20 ms of one another, three are needed: check \
         that both are of the same recording and clock"
    )]
    TooFewPairs {
        /// Number of associated poses.
        pairs: usize,
        /// Poses of the estimate.
        estimated: usize,
        /// Poses of the reference.
        reference: usize,
    },
    /// One of both has times, the other has none.
    #[error(
        "one trajectory has times, the other, such as KITTI's, has none, and their numbers differ ({estimated} estimated and {reference} reference \
         poses): put the times beside it as times.txt, one a line"
    )]
    NoTimes {
        /// Poses of the estimate.
        estimated: usize,
        /// Poses of the reference.
        reference: usize,
    },
    /// The positions do not determine the rotation.
    #[error(
        "the positions lie on a line or in a point, which determines no alignment: use --align none, or icp or sim3 for shapes"
    )]
    Straight,
}

impl TimedPoses {
    /// Reads a trajectory of any format that `--poses` takes, or the poses of the sequence in a folder, whose frames then count for coverage.
    /// An image list `rgb.txt` beside a file is the list of frames. Poses without times have those of `times.txt` beside the file, if it
    /// has as many.
    ///
    /// # Errors
    /// If the file or folder cannot be read; the text names file and line.
    pub fn read(path: &Path) -> Result<Self, SequenceError> {
        if path.is_dir() {
            return Self::of_sequence(path);
        }
        let mut is_counted = false;
        let file = read_pose_file(path)?;
        let mut poses: Vec<(i64, Isometry3<f64>)> = match file.poses {
            Poses::Stamped(rows) => {
                let unit = file.format.unit_of(&rows);
                rows.into_iter()
                    .filter_map(|(stamp, pose)| Some((stamp.in_nanoseconds(unit)?, pose)))
                    .collect()
            }
            Poses::Numbered(rows) => {
                is_counted = true;
                let second = |number: u64| i64::try_from(number).ok()?.checked_mul(SECOND_NS);
                rows.into_iter()
                    .filter_map(|(number, pose)| Some((second(number)?, pose?)))
                    .collect()
            }
            Poses::InOrder(rows) => {
                let times = times_beside(path).filter(|times| times.len() == rows.len());
                is_counted = times.is_none();
                let times = times
                    .unwrap_or_else(|| (0..rows.len() as i64).map(|k| k * SECOND_NS).collect());
                let both = times.into_iter().zip(rows);
                both.filter_map(|(time, pose)| Some((time, pose?)))
                    .collect()
            }
            Poses::Named(_) => {
                return Err(SequenceError::Content {
                    path: path.to_owned(),
                    problem: "has image names and no times: give a trajectory with times, or the folder of the sequence"
                        .to_owned(),
                });
            }
        };
        poses.sort_by_key(|(stamp, _)| *stamp);
        poses.dedup_by_key(|(stamp, _)| *stamp);
        let list = path.with_file_name("rgb.txt");
        let list = read_regular(&list).ok();
        let text = list.and_then(|bytes| String::from_utf8(bytes).ok());
        let frames = text.map(|text| {
            let stamps = text
                .lines()
                .filter(|line| !line.trim_start().starts_with('#'));
            let mut frames: Vec<i64> = stamps
                .filter_map(|line| parse_stamp_ns(line.split_whitespace().next()?))
                .collect();
            frames.sort_unstable();
            frames
        });
        Ok(Self {
            poses,
            frames,
            is_counted,
        })
    }

    fn of_sequence(folder: &Path) -> Result<Self, SequenceError> {
        let sequence = Sequence::open(folder, &OpenOptions::default())?;
        let poses: Vec<(i64, Isometry3<f64>)> = posed_images(&sequence)
            .into_iter()
            .map(|image| (image.timestamp_ns, image.world_from_camera))
            .collect();
        let frames = poses.iter().map(|(stamp, _)| *stamp).collect();
        Ok(Self {
            poses,
            frames: Some(frames),
            is_counted: false,
        })
    }

    /// The similarity that brings the positions nearest to those of a reference, by squared distances. Each pose is compared with the
    /// nearest in time, within 20 ms.
    ///
    /// # Errors
    /// If fewer than three poses are associated, or the positions lie on a line.
    pub fn similarity_to(&self, reference: &Self) -> Result<Similarity3<f64>, ComparisonError> {
        let [from, to] = positions(&self.pairs(reference)?);
        fit(&from, &to, true)
    }

    /// Poses and those of a reference nearest in time, at least three.
    fn pairs(&self, reference: &Self) -> Result<Vec<Pair>, ComparisonError> {
        if self.is_counted != reference.is_counted {
            if self.poses.len() == reference.poses.len() && self.poses.len() >= 3 {
                let both = self.poses.iter().zip(&reference.poses).enumerate();
                let pair = |(frame, (estimated, truth)): (usize, (&Timed, &Timed))| Pair {
                    frame,
                    estimated: estimated.1,
                    truth: truth.1,
                };
                return Ok(both.map(pair).collect());
            }
            return Err(ComparisonError::NoTimes {
                estimated: self.poses.len(),
                reference: reference.poses.len(),
            });
        }
        let mut pairs = self.pairs_in_time(reference);
        let most = self.poses.len().min(reference.poses.len());
        if 2 * pairs.len() < most {
            let others = TIME_FACTORS.into_iter().flat_map(|factor| {
                [
                    self.with_time(factor).pairs_in_time(reference),
                    self.pairs_in_time(&reference.with_time(factor)),
                ]
            });
            let frames_of = |pairs: &Vec<Pair>| {
                pairs
                    .iter()
                    .map(|pair| pair.frame)
                    .collect::<BTreeSet<_>>()
                    .len()
            };
            let best = others.max_by_key(frames_of);
            // Where all times become one, many poses have one partner.
            if let Some(best) = best.filter(|best| 2 * frames_of(best) >= most) {
                pairs = best;
            }
        }
        if pairs.len() < 3 {
            return Err(ComparisonError::TooFewPairs {
                pairs: pairs.len(),
                estimated: self.poses.len(),
                reference: reference.poses.len(),
            });
        }
        Ok(pairs)
    }

    /// Poses and those of a reference nearest in time.
    fn pairs_in_time(&self, reference: &Self) -> Vec<Pair> {
        let reference_stamps = stamps(&reference.poses);
        let frames = reference.frames.as_ref().unwrap_or(&reference_stamps);
        let pairs = self.poses.iter().filter_map(|(stamp, estimated)| {
            let partner = nearest(&reference_stamps, *stamp, MAX_DIFFERENCE_NS)?;
            Some(Pair {
                frame: nearest(frames, *stamp, u64::MAX)?,
                estimated: *estimated,
                truth: reference.poses[partner].1,
            })
        });
        pairs.collect()
    }

    /// The same with times in another unit. Times out of range are left out.
    fn with_time(&self, [times, over]: [i64; 2]) -> Self {
        let changed = |stamp: i64| {
            let stamp = i128::from(stamp) * i128::from(times) / i128::from(over);
            i64::try_from(stamp).ok()
        };
        let poses = self.poses.iter();
        Self {
            poses: poses
                .filter_map(|(stamp, pose)| Some((changed(*stamp)?, *pose)))
                .collect(),
            frames: self
                .frames
                .as_ref()
                .map(|frames| frames.iter().filter_map(|stamp| changed(*stamp)).collect()),
            is_counted: self.is_counted,
        }
    }

    /// Errors of these poses against a reference. Each pose is compared with the nearest in time, within 20 ms. If most poses have none, other
    /// units of time are tried.
    ///
    /// # Errors
    /// If fewer than three poses are associated, or the positions determine no alignment.
    pub fn compare_with(
        &self,
        reference: &Self,
        alignment: TrajectoryAlignment,
    ) -> Result<TrajectoryComparison, ComparisonError> {
        let own_frames = stamps(&reference.poses);
        let frames = reference.frames.as_ref().unwrap_or(&own_frames);
        let pairs = self.pairs(reference)?;
        let [from, to] = positions(&pairs);
        let truth_from_estimate = match alignment {
            TrajectoryAlignment::None => Similarity3::identity(),
            TrajectoryAlignment::Se3 => fit(&from, &to, false)?,
            TrajectoryAlignment::Sim3 => fit(&from, &to, true)?,
        };
        let errors = from
            .iter()
            .zip(&to)
            .map(|(from, to)| (truth_from_estimate * from - to).norm());
        let scale = truth_from_estimate.scaling();
        let covered: BTreeSet<usize> = pairs.iter().map(|pair| pair.frame).collect();
        let mean = to.iter().map(|p| p.coords).sum::<nalgebra::Vector3<f64>>() / to.len() as f64;
        Ok(TrajectoryComparison {
            alignment,
            scale,
            pairs: pairs.len(),
            frames: frames.len(),
            coverage: covered.len() as f64 / frames.len() as f64,
            path: to.windows(2).map(|ends| (ends[1] - ends[0]).norm()).sum(),
            spread: root_mean_square(to.iter().map(|p| (p.coords - mean).norm())),
            position: position_error(errors.collect()),
            relative: [1, 10]
                .into_iter()
                .filter_map(|apart| relative_error(&pairs, apart, scale))
                .collect(),
        })
    }
}

/// Ratios of the units of time, from seconds to nanoseconds.
const TIME_FACTORS: [[i64; 2]; 6] = [
    [1000, 1],
    [1_000_000, 1],
    [1_000_000_000, 1],
    [1, 1000],
    [1, 1_000_000],
    [1, 1_000_000_000],
];

/// A time in nanoseconds, and the pose then.
type Timed = (i64, Isometry3<f64>);

/// An estimated pose, that of the reference, and the number of the frame.
struct Pair {
    frame: usize,
    estimated: Isometry3<f64>,
    truth: Isometry3<f64>,
}

/// The times of `times.txt` beside a file, one a line.
fn times_beside(path: &Path) -> Option<Vec<i64>> {
    let text = std::fs::read_to_string(path.with_file_name("times.txt")).ok()?;
    let lines = text
        .lines()
        .map(str::trim)
        .filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines
        .map(|line| parse_stamp_ns(line.split_whitespace().next()?))
        .collect()
}

fn stamps(poses: &[(i64, Isometry3<f64>)]) -> Vec<i64> {
    poses.iter().map(|(stamp, _)| *stamp).collect()
}

/// Positions of the estimate and of the reference.
fn positions(pairs: &[Pair]) -> [Vec<Point3<f64>>; 2] {
    let position = |pose: &Isometry3<f64>| Point3::from(pose.translation.vector);
    [
        pairs.iter().map(|pair| position(&pair.estimated)).collect(),
        pairs.iter().map(|pair| position(&pair.truth)).collect(),
    ]
}

fn fit(
    from: &[Point3<f64>],
    to: &[Point3<f64>],
    with_scale: bool,
) -> Result<Similarity3<f64>, ComparisonError> {
    fit_similarity(from, to, with_scale).ok_or(ComparisonError::Straight)
}

/// Index of the nearest of ascending stamps within a difference; the earlier of equals.
fn nearest(stamps: &[i64], stamp: i64, most: u64) -> Option<usize> {
    let after = stamps.partition_point(|other| *other < stamp);
    [after.checked_sub(1), Some(after)]
        .into_iter()
        .flatten()
        .filter(|index| *index < stamps.len())
        .min_by_key(|index| stamps[*index].abs_diff(stamp))
        .filter(|index| stamps[*index].abs_diff(stamp) <= most)
}

fn root_mean_square(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len().max(1) as f64;
    (values.map(|value| value * value).sum::<f64>() / count).sqrt()
}

fn position_error(mut errors: Vec<f64>) -> PositionError {
    let rmse = root_mean_square(errors.iter().copied());
    errors.sort_by(f64::total_cmp);
    let (low, high) = ((errors.len() - 1) / 2, errors.len() / 2);
    PositionError {
        rmse,
        median: 0.5 * (errors[low] + errors[high]),
        max: errors[errors.len() - 1],
    }
}

fn relative_error(pairs: &[Pair], apart: usize, scale: f64) -> Option<RelativeError> {
    let (mut translations, mut rotations) = (Vec::new(), Vec::new());
    for (first, last) in pairs.iter().zip(pairs.iter().skip(apart)) {
        if last.frame != first.frame + apart {
            continue;
        }
        let mut estimated = first.estimated.inverse() * last.estimated;
        estimated.translation.vector *= scale;
        let truth = first.truth.inverse() * last.truth;
        let error = truth.inverse() * estimated;
        translations.push(error.translation.vector.norm());
        rotations.push(error.rotation.angle().to_degrees());
    }
    (!translations.is_empty()).then(|| RelativeError {
        frames_apart: apart,
        pairs: translations.len(),
        translation: root_mean_square(translations.into_iter()),
        rotation_degrees: root_mean_square(rotations.into_iter()),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;

    fn path(count: i64) -> TimedPoses {
        let pose = |k: i64| {
            let t = k as f64 * 0.1;
            let at = Vector3::new(t.sin(), t.cos(), 0.1 * t);
            (
                k * 100_000_000,
                Isometry3::new(at, Vector3::new(0.0, t, 0.1)),
            )
        };
        TimedPoses {
            poses: (0..count).map(pose).collect(),
            frames: None,
            is_counted: false,
        }
    }

    #[test]
    fn a_moved_and_scaled_path_has_no_error() {
        let truth = path(30);
        let motion = Isometry3::new(Vector3::new(3.0, 1.0, -2.0), Vector3::new(0.3, -0.4, 1.0));
        let mut estimate = truth.clone();
        for (stamp, pose) in &mut estimate.poses {
            *stamp += 3_000_000;
            let mut moved = motion * *pose;
            moved.translation.vector *= 0.5;
            *pose = moved;
        }
        let found = estimate
            .compare_with(&truth, TrajectoryAlignment::Sim3)
            .unwrap();
        assert!((found.scale - 2.0).abs() < 1e-9 && found.position.max < 1e-9);
        let similarity = estimate.similarity_to(&truth).unwrap();
        let [moved, true_one] = [&estimate, &truth].map(|path| path.poses[7].1.translation.vector);
        let error = similarity * Point3::from(moved) - Point3::from(true_one);
        assert!(error.norm() < 1e-9, "{error}");
        assert_eq!((found.pairs, found.frames, found.coverage), (30, 30, 1.0));
        assert!(
            found
                .relative
                .iter()
                .all(|one| one.translation < 1e-9 && one.rotation_degrees < 1e-5)
        );
        let rigid = estimate
            .compare_with(&truth, TrajectoryAlignment::Se3)
            .unwrap();
        assert!(rigid.position.rmse > 0.1 && rigid.scale == 1.0);
    }

    #[test]
    fn clocks_of_euroc_may_have_few_digits() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        for (start, step) in [
            (100_000_000_000_i64, 10_000_000_i64),
            (0, 50),
            (1_403_636_579_763_555_584, 5_000_000),
        ] {
            let rows: String = (0..5)
                .map(|k| format!("{},{k},0,0,1,0,0,0,0,0,0,0,0,0,0,0,0\n", start + k * step))
                .collect();
            let head = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x, v_RS_R_y, \
                        v_RS_R_z, b_w_x, b_w_y, b_w_z, b_a_x, b_a_y, b_a_z\n";
            std::fs::write(&path, format!("{head}{rows}")).unwrap();
            let found = TimedPoses::read(&path).unwrap();
            let times: Vec<i64> = found.poses.iter().map(|row| row.0).collect();
            let expected: Vec<i64> = (0..5).map(|k| start + k * step).collect();
            assert_eq!(times, expected);
        }
    }

    #[test]
    fn errors_between_frames_need_all_frames_between() {
        let truth = path(15);
        let mut estimate = truth.clone();
        estimate.poses[4].1.translation.vector.x += 0.1;
        estimate.poses.remove(9);
        let found = estimate
            .compare_with(&truth, TrajectoryAlignment::None)
            .unwrap();
        assert_eq!(found.pairs, 14);
        assert!((found.coverage - 14.0 / 15.0).abs() < 1e-12);
        let one = found.relative[0];
        assert_eq!((one.frames_apart, one.pairs), (1, 12));
        // Two of twelve pairs are wrong by a tenth.
        assert!((one.translation - (2.0 * 0.01 / 12.0_f64).sqrt()).abs() < 1e-9);
        assert!((found.position.rmse - 0.1 / 14.0_f64.sqrt()).abs() < 1e-12);
        let few = path(2);
        assert!(few.compare_with(&truth, TrajectoryAlignment::Se3).is_err());
        let mut straight = path(9);
        for (number, (_, pose)) in straight.poses.iter_mut().enumerate() {
            pose.translation.vector = Vector3::new(number as f64, 0.0, 0.0);
        }
        let error = straight.similarity_to(&straight).unwrap_err();
        assert!(error.to_string().contains("on a line"), "{error}");
    }
}
