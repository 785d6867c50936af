//! Reading of trajectory files; the format is detected from the first lines.

use std::path::{Path, PathBuf};

use nalgebra::Isometry3;

use super::super::layout::Folder;
use super::super::text::{TextFile, TextLine, parse_number, parse_stamp, shorten};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, rigid};
use super::{PoseFile, PoseFileFormat, Poses, log};

/// Column layout of a trajectory file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Columns {
    format: PoseFileFormat,
    /// Number of fields in each line; `None` if further fields may follow.
    count: Option<usize>,
    /// Leading fields to skip, such as a running index.
    skipped: usize,
}

/// Reads a trajectory of any known format.
///
/// # Errors
/// If the file cannot be read, has no known format, or its lines differ in format.
pub(in super::super) fn read_pose_file(path: &Path) -> Result<PoseFile, SequenceError> {
    let file = TextFile::read(path)?;
    let columns = detect(&file, path)?;
    if columns.format == PoseFileFormat::Open3dLog {
        return Ok(log::trajectory(log::entries(&file, path)?));
    }
    read_rows(&file, path, columns)
}

/// Reads a trajectory in TUM format, `stamp tx ty tz qx qy qz qw`.
pub(in super::super) fn read_stamped_quaternions(path: &Path) -> Result<PoseFile, SequenceError> {
    let file = TextFile::read(path)?;
    let columns = Columns {
        format: PoseFileFormat::Tum,
        count: Some(8),
        skipped: 0,
    };
    read_rows(&file, path, columns)
}

/// Files of a folder that are trajectories, for suggestions in error messages.
pub(in super::super) fn candidates(folder: &Folder) -> Vec<PathBuf> {
    const MAX_TRIED: usize = 40;
    const MAX_BYTES: u64 = 64 << 20;
    folder
        .names()
        .iter()
        .filter(|name| {
            [".txt", ".csv", ".log", ".tum"]
                .iter()
                .any(|end| name.ends_with(end))
        })
        .take(MAX_TRIED)
        .map(|name| folder.path().join(name))
        .filter(|path| {
            std::fs::metadata(path).is_ok_and(|meta| meta.is_file() && meta.len() < MAX_BYTES)
                && read_pose_file(path).is_ok_and(|found| found.poses.len() > 1)
        })
        .collect()
}

/// Whether a line is a table head: its first field is not a number.
fn is_head(row: &TextLine) -> bool {
    row.fields()
        .next()
        .is_some_and(|field| parse_number(field).is_none())
}

/// Detects the format from the head line, if any, and the fields of the first lines.
fn detect(file: &TextFile, path: &Path) -> Result<Columns, SequenceError> {
    let unknown = |problem: String| SequenceError::Content {
        path: path.to_owned(),
        problem: format!(
            "{problem}; supported formats are TUM (stamp tx ty tz qx qy qz qw), EuRoC (stamp, px, py, pz, qw, qx, qy, \
             qz, ...), KITTI (12 numbers), 4x4 matrices (16 numbers), tx ty tz qx qy qz qw, or Open3D .log"
        ),
    };
    let rows: Vec<TextLine> = file
        .rows()
        .enumerate()
        .filter(|(at, row)| *at > 0 || !is_head(row))
        .map(|(_, row)| row)
        .take(3)
        .collect();
    let first = rows
        .first()
        .ok_or_else(|| unknown("has no poses".to_owned()))?;
    let count = first.fields().count();
    let columns = |format, count, skipped| Columns {
        format,
        count,
        skipped,
    };
    if count == 3 && rows.get(1).is_some_and(|row| row.fields().count() == 4) {
        return Ok(columns(PoseFileFormat::Open3dLog, None, 0));
    }
    let has_stamp = |row: &TextLine| {
        row.fields()
            .next()
            .and_then(parse_stamp)
            .is_some_and(|stamp| stamp.is_nanoseconds)
    };
    let is_w_first = w_comes_first(file);
    let has_commas = first.text().contains(',');
    match count {
        7 => Ok(columns(PoseFileFormat::Unstamped, Some(7), 0)),
        8 if is_w_first.unwrap_or(has_commas && has_stamp(first)) => {
            Ok(columns(PoseFileFormat::EurocCsv, Some(8), 0))
        }
        8 => Ok(columns(PoseFileFormat::Tum, Some(8), 0)),
        9 if is_running_index(&rows) && !is_w_first.unwrap_or(false) => {
            Ok(columns(PoseFileFormat::Tum, Some(9), 1))
        }
        12 => Ok(columns(PoseFileFormat::Kitti, Some(12), 0)),
        16 => Ok(columns(PoseFileFormat::Matrices, Some(16), 0)),
        17.. if has_commas || is_w_first == Some(true) => {
            Ok(columns(PoseFileFormat::EurocCsv, None, 0))
        }
        _ => Err(first.error(format!(
            "{count} fields match no known trajectory format (TUM 8, EuRoC 8 or 17, KITTI 12, 4x4 matrices 16, \
             tx ty tz qx qy qz qw 7, Open3D .log 3 and then 4)"
        ))),
    }
}

/// Whether w is the first quaternion component according to the head line; `None` if it does not say.
fn w_comes_first(file: &TextFile) -> Option<bool> {
    let head = file
        .text()
        .lines()
        .find(|line| !line.trim().is_empty())?
        .to_ascii_lowercase();
    let position = |names: &[&str]| names.iter().find_map(|name| head.find(name));
    let w = position(&["q_rs_w", "qw", "q_w", "quat_w", "rotation_w"])?;
    let x = position(&["q_rs_x", "qx", "q_x", "quat_x", "rotation_x"])?;
    Some(w < x)
}

/// Whether the first field is a running index.
fn is_running_index(rows: &[TextLine]) -> bool {
    let index = |row: &TextLine| {
        row.fields()
            .next()
            .and_then(|field| field.parse::<u64>().ok())
    };
    rows.windows(2).all(|pair| {
        index(&pair[0])
            .zip(index(&pair[1]))
            .is_some_and(|(a, b)| b > a && b - a < 1000)
    }) && rows
        .first()
        .is_some_and(|row| index(row).is_some_and(|i| i < 1_000_000))
}

fn read_rows(file: &TextFile, path: &Path, columns: Columns) -> Result<PoseFile, SequenceError> {
    let mut stamped = Vec::new();
    let mut in_order = Vec::new();
    let (mut not_finite, mut not_rigid, mut total) =
        (WarningCounter::default(), WarningCounter::default(), 0);
    for row in file.rows() {
        if total == 0 && is_head(&row) {
            continue;
        }
        total += 1;
        let found = row.fields().count();
        if let Some(count) = columns.count
            && found != count
        {
            return Err(row.error(format!("expected {count} numbers, found {found}")));
        }
        let location = format!("line {}", row.number());
        let mut note = |problem: rigid::RigidTransformError, location: String| match problem {
            rigid::RigidTransformError::NotFinite => not_finite.add(location),
            problem => not_rigid.add(format!("{location} {problem}")),
        };
        let pose = pose_of(&row, columns)?;
        if !matches!(
            columns.format,
            PoseFileFormat::Tum | PoseFileFormat::EurocCsv
        ) {
            in_order.push(pose.map_err(|problem| note(problem, location)).ok());
            continue;
        }
        let field = row.fields().nth(columns.skipped).unwrap_or_default();
        let Some(stamp) = parse_stamp(field) else {
            if parse_number(field).is_none_or(f64::is_finite) {
                return Err(row.error(format!("'{}' is not a time stamp", shorten(field))));
            }
            note(rigid::RigidTransformError::NotFinite, shorten(field));
            continue;
        };
        match pose {
            Ok(pose) => stamped.push((stamp, pose)),
            Err(problem) => note(problem, shorten(field)),
        }
    }
    let mut warnings = Vec::new();
    warnings.extend(not_finite.into_warning(total, "poses are not finite and were skipped"));
    warnings
        .extend(not_rigid.into_warning(total, "poses are not rigid transforms and were skipped"));
    let poses = if in_order.is_empty() {
        Poses::Stamped(stamped)
    } else {
        Poses::InOrder(in_order)
    };
    if columns.skipped > 0 {
        warnings.push(Warning::statement(format!(
            "{}: the first field of each line is read as a running index",
            path.display()
        )));
    }
    Ok(PoseFile {
        format: columns.format,
        poses,
        warnings,
    })
}

/// The pose of a line. The inner error is an invalid pose, which is skipped.
fn pose_of(
    row: &TextLine,
    columns: Columns,
) -> Result<Result<Isometry3<f64>, rigid::RigidTransformError>, SequenceError> {
    let skipped = columns.skipped;
    let from_rows = |values: &[f64]| {
        let mut rows = [
            [0.0, 0.0, 0.0, 0.0],
            [0.0; 4],
            [0.0; 4],
            [0.0, 0.0, 0.0, 1.0],
        ];
        for (slot, value) in rows.iter_mut().flatten().zip(values) {
            *slot = *value;
        }
        rigid::from_matrix(&rows)
    };
    Ok(match columns.format {
        PoseFileFormat::Tum => {
            let [tx, ty, tz, qx, qy, qz, qw] = row.numbers_from(skipped + 1)?;
            rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
        }
        PoseFileFormat::EurocCsv => {
            let [tx, ty, tz, qw, qx, qy, qz] = row.numbers_from(skipped + 1)?;
            rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
        }
        PoseFileFormat::Unstamped => {
            let [tx, ty, tz, qx, qy, qz, qw] = row.numbers_from(skipped)?;
            rigid::from_translation_quaternion([tx, ty, tz], [qx, qy, qz, qw])
        }
        PoseFileFormat::Kitti => from_rows(&row.numbers_from::<12>(skipped)?),
        PoseFileFormat::Matrices | PoseFileFormat::Open3dLog => {
            from_rows(&row.numbers_from::<16>(skipped)?)
        }
    })
}
