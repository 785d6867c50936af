//! Association of a trajectory with the images of a sequence, by time, number or order.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use nalgebra::Isometry3;

use super::super::join::OtherJoin;
use super::super::layout::{RecordedFrame, Recording, image_stem};
use super::super::text::{Stamp, TimeUnit, shorten};
use super::super::warning::{WarningCounter, stamp_text};
use super::super::{SequenceError, Warning, associate};
use super::{PoseFile, PoseFileFormat, Poses, read_pose_file, written_unit};

/// Largest time difference between an image and its pose.
pub(in super::super) const MAX_DIFFERENCE_NS: i64 = 20_000_000;

/// A value with its time in nanoseconds.
type Stamped<T> = (i64, T);

/// Sorts by time and keeps the first value of each time.
pub(in super::super) fn sort_and_dedup<T>(
    mut rows: Vec<Stamped<T>>,
    file: &str,
    warnings: &mut Vec<Warning>,
) -> Vec<Stamped<T>> {
    let total = rows.len();
    if rows.windows(2).any(|pair| pair[1].0 < pair[0].0) {
        warnings.push(Warning::statement(format!(
            "{file}: time stamps do not ascend and were sorted"
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
        &format!("time stamps in {file} are repeated; the first line of each is used"),
    ));
    rows
}

/// Assigns the poses of a trajectory file to the frames of a recording. Returns the format of the file.
///
/// # Errors
/// If the file cannot be read, no frame gets a pose, or poses without stamps and frames differ in number.
pub(in super::super) fn attach_file(
    recording: &mut Recording,
    path: &Path,
) -> Result<PoseFileFormat, SequenceError> {
    let trajectory = read_pose_file(path)?;
    let format = trajectory.format;
    recording.other_quaternion = format.other_quaternion_order();
    let frames = std::mem::take(&mut recording.frames);
    let warnings = &mut recording.warnings;
    let (frames, other) = attach(frames, recording.has_time, trajectory, path, warnings)?;
    recording.frames = frames;
    recording.other_join = other;
    Ok(format)
}

/// Assigns each frame its pose; frames without one are skipped and counted.
///
/// Stamped poses are associated one-to-one with the nearest frames within 0.02 s. If that leaves most frames without a
/// pose, other units of the stamps are tried, and the unit that associates the most is used. If frames have numbers but
/// no times, integer stamps count as numbers, if each image has a pose of its number or each pose has the number of an
/// image; otherwise poses are assigned in order. If some images have no pose of their number, but there are as many poses
/// as images, they are assigned in order and the join by number is returned as well.
///
/// # Errors
/// If no frame gets a pose, or poses assigned in order and frames differ in number.
pub(in super::super) fn attach(
    frames: Vec<RecordedFrame>,
    has_time: bool,
    trajectory: PoseFile,
    path: &Path,
    warnings: &mut Vec<Warning>,
) -> Result<(Vec<RecordedFrame>, Option<OtherJoin>), SequenceError> {
    let file = path
        .file_name()
        .map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let unusable = |problem: String| SequenceError::UnusablePoses {
        path: path.to_owned(),
        reason: problem,
    };
    if trajectory.poses.valid() == 0 {
        let skipped: Vec<String> = trajectory
            .warnings
            .iter()
            .map(ToString::to_string)
            .collect();
        return Err(unusable(match skipped.is_empty() {
            true => "the file has no poses".to_owned(),
            false => skipped.join("; "),
        }));
    }
    warnings.extend(trajectory.warnings);
    let total = frames.len();
    let times = times_of(&frames, &trajectory.poses);
    let mut other = None;
    let posed = match trajectory.poses {
        Poses::Stamped(rows) if has_time => {
            let posed = by_time(&frames, &rows, &file, warnings);
            let is_complete = posed.iter().all(Option::is_some);
            if is_complete || rows.len() != total || !are_counted(&frames, &rows) {
                posed
            } else {
                other = Some(posed);
                in_order(rows.iter().map(|row| Some(row.1)).collect(), &frames, path)?
            }
        }
        Poses::Stamped(rows) => {
            let numbered: Option<Vec<(u64, Option<Isometry3<f64>>)>> = rows
                .iter()
                .map(|(stamp, pose)| Some((stamp.whole_number()?, Some(*pose))))
                .collect();
            let by_number = numbered.map(|rows| by_number(&frames, &rows));
            match by_number {
                Some(posed) if posed.iter().all(Option::is_some) => posed,
                // A part of the images: each line has the number of one.
                Some(posed) if rows.len() < total && count(&posed) == rows.len() => posed,
                by_number => {
                    let posed =
                        in_order(rows.iter().map(|row| Some(row.1)).collect(), &frames, path)?;
                    other = by_number.filter(|posed| has_any(posed));
                    posed
                }
            }
        }
        Poses::Numbered(rows) if has_time => {
            in_order(rows.into_iter().map(|row| row.1).collect(), &frames, path)?
        }
        Poses::Numbered(rows) => {
            let posed = by_number(&frames, &rows);
            let numbers: BTreeSet<u64> = rows.iter().map(|row| row.0).collect();
            let is_numbered = |frame: &RecordedFrame| {
                u64::try_from(frame.timestamp_ns).is_ok_and(|number| numbers.contains(&number))
            };
            if !has_any(&posed) {
                in_order(rows.into_iter().map(|row| row.1).collect(), &frames, path)?
            } else if rows.len() == total && !frames.iter().all(is_numbered) {
                other = Some(posed);
                in_order(rows.into_iter().map(|row| row.1).collect(), &frames, path)?
            } else {
                posed
            }
        }
        Poses::Named(rows) => by_name(&frames, &rows),
        Poses::InOrder(rows) => in_order(rows, &frames, path)?,
    };
    let mut without_pose = WarningCounter::default();
    let mut kept = Vec::new();
    let mut other = other.map(IntoIterator::into_iter);
    let mut other_of_kept = other.is_some().then(Vec::new);
    for (mut frame, pose) in frames.into_iter().zip(posed) {
        let other_pose = other.as_mut().and_then(Iterator::next).flatten();
        match pose {
            Some(pose) => {
                frame.pose = Some(pose);
                kept.push(frame);
                if let Some(poses) = &mut other_of_kept {
                    poses.push(other_pose);
                }
            }
            None => without_pose.add(frame.name),
        }
    }
    if kept.is_empty() {
        return Err(unusable(format!(
            "none of the {total} images has a pose within 0.02 s, in any unit of time, or of its name: check that images \
             and poses have the same clock or names{times}"
        )));
    }
    warnings.extend(without_pose.into_warning(
        total,
        &format!("images have no pose in {file} and were skipped"),
    ));
    Ok((kept, other_of_kept.map(|poses| OtherJoin { poses })))
}

/// Names of the first and the last image, and stamps or names of the first and the last pose, for messages.
fn times_of(frames: &[RecordedFrame], poses: &Poses) -> String {
    let of_poses = match poses {
        Poses::Stamped(rows) => ends(rows, |row| row.0.to_string()),
        Poses::Numbered(rows) => ends(rows, |row| row.0.to_string()),
        Poses::Named(rows) => ends(rows, |row| shorten(&row.0)),
        Poses::InOrder(_) => None,
    };
    match (ends(frames, |frame| frame.name.clone()), of_poses) {
        (Some(images), Some(poses)) => format!(" (images {images}; poses {poses})"),
        _ => String::new(),
    }
}

fn ends<T>(all: &[T], text: impl Fn(&T) -> String) -> Option<String> {
    let (first, last) = (all.first()?, all.last()?);
    Some(format!("{} to {}", text(first), text(last)))
}

/// Whether the times of images and poses are counts: 0 1 2 ..., or from another number on.
fn are_counted(frames: &[RecordedFrame], rows: &[(Stamp, Isometry3<f64>)]) -> bool {
    const SECOND_NS: i64 = 1_000_000_000;
    let is_second = |frame: &RecordedFrame| frame.timestamp_ns % SECOND_NS == 0;
    let numbers: Option<Vec<u64>> = rows.iter().map(|row| row.0.whole_number()).collect();
    frames.iter().all(is_second)
        && frames
            .windows(2)
            .all(|pair| pair[1].timestamp_ns - pair[0].timestamp_ns == SECOND_NS)
        && numbers.is_some_and(|numbers| numbers.windows(2).all(|pair| pair[1] == pair[0] + 1))
}

fn count(posed: &[Option<Isometry3<f64>>]) -> usize {
    posed.iter().flatten().count()
}

fn has_any(posed: &[Option<Isometry3<f64>>]) -> bool {
    posed.iter().any(Option::is_some)
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
    // Of frames with equal times only the first gets a pose.
    order.dedup_by_key(|&mut at| frames[at].timestamp_ns);
    let stamps: Vec<i64> = order.iter().map(|&at| frames[at].timestamp_ns).collect();
    let written = written_unit(rows);
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
            // A unit that maps all stamps to nearly one time associates a few frames by chance.
            if other.1 > 2 * count && 2 * other.1 >= stamps.len().min(rows.len()) {
                (posed, count, notes) = other;
                notes.push(Warning::statement(format!(
                    "{file}: the stamps are read as {}, which gives {count} images a pose",
                    unit.name()
                )));
            }
        }
    }
    warnings.extend(notes);
    posed
}

/// Names may have a folder and an extension, in the file as well as in the sequence.
fn by_name(frames: &[RecordedFrame], rows: &[(String, Isometry3<f64>)]) -> Posed {
    let stem = |name: &str| {
        let file = name.rsplit(['/', '\\']).next().unwrap_or(name);
        image_stem(file).unwrap_or(file).to_owned()
    };
    let poses: BTreeMap<String, Isometry3<f64>> = rows
        .iter()
        .map(|(name, pose)| (stem(name), *pose))
        .collect();
    frames
        .iter()
        .map(|frame| {
            let file = frame.color.file_name()?.to_str()?;
            poses.get(&stem(file)).copied()
        })
        .collect()
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
            "has {} poses for {} images: without stamps there must be one pose for each image, in the same order",
            poses.len(),
            frames.len()
        ),
    })
}
