//! Association of a trajectory with the images of a sequence.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Isometry3;

use super::super::layout::{RecordedFrame, Recording};
use super::super::text::{Stamp, TimeUnit};
use super::super::warning::{WarningCounter, stamp_text};
use super::super::{SequenceError, Warning, associate};
use super::{PoseFile, PoseFileFormat, Poses, read_pose_file};

/// Largest difference between the stamps of an image and of its pose.
pub(in super::super) const MAX_DIFFERENCE_NS: i64 = 20_000_000;

/// Something with a time stamp in nanoseconds.
type Stamped<T> = (i64, T);

/// Sorts by stamp and keeps the first of each.
pub(in super::super) fn sort_and_dedup<T>(
    mut rows: Vec<Stamped<T>>,
    file: &str,
    warnings: &mut Vec<Warning>,
) -> Vec<Stamped<T>> {
    let total = rows.len();
    if rows.windows(2).any(|pair| pair[1].0 < pair[0].0) {
        warnings.push(Warning::statement(format!(
            "{file}: time stamps do not ascend; they were sorted"
        )));
    }
    rows.sort_by_key(|row| row.0);
    let mut repeated = WarningCounter::default();
    rows.dedup_by(|later, earlier| {
        let is_repeated = later.0 == earlier.0;
        if is_repeated {
            repeated.add(stamp_text(later.0));
        }
        is_repeated
    });
    warnings.extend(repeated.into_warning(
        total,
        &format!("time stamps in {file} stand there before; the first line of each counts"),
    ));
    rows
}

/// Gives the frames of a recording the poses of a trajectory file, whose format is returned.
///
/// # Errors
/// When the file cannot be read, no frame gets a pose, or counts differ where poses go by order.
pub(in super::super) fn attach_file(
    recording: &mut Recording,
    path: &Path,
) -> Result<PoseFileFormat, SequenceError> {
    let trajectory = read_pose_file(path)?;
    let format = trajectory.format;
    recording.other_quaternion = format.other_quaternion_order();
    let frames = std::mem::take(&mut recording.frames);
    let warnings = &mut recording.warnings;
    recording.frames = attach(frames, recording.has_time, trajectory, path, warnings)?;
    Ok(format)
}

/// Gives each frame its pose of a trajectory; frames without one are left out and counted.
///
/// Stamped poses go to the frame nearest in time, within 0.02 s, each once. When the unit of the stamps as written
/// leaves most frames without a pose, other units are tried and the one that serves the most is taken. Where frames
/// have numbers in place of times, whole stamps are taken for numbers, and else poses and frames must agree in count.
///
/// # Errors
/// When no frame gets a pose, or counts differ where poses go by order.
fn attach(
    frames: Vec<RecordedFrame>,
    has_time: bool,
    trajectory: PoseFile,
    path: &Path,
    warnings: &mut Vec<Warning>,
) -> Result<Vec<RecordedFrame>, SequenceError> {
    let file = path
        .file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    warnings.extend(trajectory.warnings);
    let total = frames.len();
    let posed = match trajectory.poses {
        Poses::Stamped(rows) if has_time => by_time(&frames, &rows, &file, warnings),
        Poses::Stamped(rows) => {
            let numbered: Option<Vec<(u64, Option<Isometry3<f64>>)>> = rows
                .iter()
                .map(|(stamp, pose)| Some((stamp.whole_number()?, Some(*pose))))
                .collect();
            let by_number = numbered.map(|rows| by_number(&frames, &rows));
            match by_number.filter(|posed| posed.iter().flatten().count() == total) {
                Some(posed) => posed,
                None => in_order(rows.iter().map(|row| Some(row.1)).collect(), &frames, path)?,
            }
        }
        Poses::Numbered(rows) if has_time => {
            in_order(rows.into_iter().map(|row| row.1).collect(), &frames, path)?
        }
        Poses::Numbered(rows) => {
            let posed = by_number(&frames, &rows);
            if posed.iter().flatten().next().is_none() {
                in_order(rows.into_iter().map(|row| row.1).collect(), &frames, path)?
            } else {
                posed
            }
        }
        Poses::InOrder(rows) => in_order(rows, &frames, path)?,
    };
    let mut without_pose = WarningCounter::default();
    let mut kept = Vec::new();
    for (mut frame, pose) in frames.into_iter().zip(posed) {
        match pose {
            Some(pose) => {
                frame.pose = Some(pose);
                kept.push(frame);
            }
            None => without_pose.add(frame.name),
        }
    }
    if kept.is_empty() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: format!(
                "not one of {total} images has a pose within 0.02 s, in whichever unit its stamps are read: check that \
                 images and poses have the same clock{}",
                without_pose
                    .first()
                    .map_or_else(String::new, |name| format!(" (first image: {name})"))
            ),
        });
    }
    warnings.extend(without_pose.into_warning(
        total,
        &format!("images have no pose in {file} and were left out"),
    ));
    Ok(kept)
}

type Posed = Vec<Option<Isometry3<f64>>>;

fn by_time(
    frames: &[RecordedFrame],
    rows: &[(Stamp, Isometry3<f64>)],
    file: &str,
    warnings: &mut Vec<Warning>,
) -> Posed {
    let mut order: Vec<usize> = (0..frames.len()).collect();
    order.sort_by_key(|&at| frames[at].timestamp_ns);
    // Frames with one time compete for the pose; the first has it.
    order.dedup_by_key(|&mut at| frames[at].timestamp_ns);
    let stamps: Vec<i64> = order.iter().map(|&at| frames[at].timestamp_ns).collect();
    let written = rows
        .first()
        .map_or(TimeUnit::Second, |(stamp, _)| stamp.unit_as_written());
    let attempt = |unit: TimeUnit| {
        let mut notes = Vec::new();
        let poses: Vec<_> = rows
            .iter()
            .filter_map(|(stamp, pose)| Some((stamp.in_nanoseconds(unit)?, *pose)))
            .collect();
        let poses = sort_and_dedup(poses, file, &mut notes);
        let pose_stamps: Vec<i64> = poses.iter().map(|row| row.0).collect();
        let partners = associate::nearest_unique(&stamps, &pose_stamps, MAX_DIFFERENCE_NS);
        let mut posed: Posed = vec![None; frames.len()];
        for (&at, partner) in order.iter().zip(&partners) {
            posed[at] = partner.map(|partner| poses[partner].1);
        }
        (posed, partners.iter().flatten().count(), notes)
    };
    let (mut posed, mut count, mut notes) = attempt(written);
    if 2 * count < stamps.len() {
        for unit in TimeUnit::ALL.into_iter().filter(|unit| *unit != written) {
            let other = attempt(unit);
            // A unit that shrinks all stamps to one moment serves a few frames by chance.
            if other.1 > 2 * count && 2 * other.1 >= stamps.len().min(rows.len()) {
                (posed, count, notes) = other;
                notes.push(Warning::statement(format!(
                    "{file}: the stamps are taken for {}, which gives {count} images a pose",
                    unit.name()
                )));
            }
        }
    }
    warnings.extend(notes);
    posed
}

fn by_number(frames: &[RecordedFrame], rows: &[(u64, Option<Isometry3<f64>>)]) -> Posed {
    let mut poses: BTreeMap<u64, Option<Isometry3<f64>>> = BTreeMap::new();
    for (number, pose) in rows {
        poses.entry(*number).or_insert(*pose);
    }
    frames
        .iter()
        .map(|frame| {
            let number = u64::try_from(frame.timestamp_ns).ok()?;
            poses.get(&number).copied().flatten()
        })
        .collect()
}

fn in_order(poses: Posed, frames: &[RecordedFrame], path: &Path) -> Result<Posed, SequenceError> {
    if poses.len() == frames.len() {
        return Ok(poses);
    }
    Err(SequenceError::Content {
        path: path.to_owned(),
        problem: format!(
            "holds {} poses that no time or number ties to the {} images: without stamps there must be one pose for \
             each image, in their order",
            poses.len(),
            frames.len()
        ),
    })
}
