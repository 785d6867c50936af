//! Reading of trajectory files; the format is detected from the first lines.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use super::super::layout::Folder;
use super::super::text::{TextFile, TextLine, parse_number, parse_stamp, shorten};
use super::super::warning::WarningCounter;
use super::super::{SequenceError, Warning, rigid};
use super::columns::{Columns, Key, fields, is_head};
use super::{PoseFile, Poses, log};

/// The formats, for messages.
const KNOWN: &str = "supported are TUM (stamp tx ty tz qx qy qz qw, and more fields), EuRoC (stamp, px, py, pz, qw, qx, qy, qz, ...), KITTI \
                     (12 numbers), 4x4 matrices (16 numbers), both also after a stamp or an image name, tx ty tz qx qy qz qw, rotation vector \
                     and translation after a stamp, tables whose head names the columns, and Open3D .log";

/// Reads a trajectory of any known format.
///
/// # Errors
/// If the file cannot be read, has no known format, or its lines differ in format.
pub(in super::super) fn read_pose_file(path: &Path) -> Result<PoseFile, SequenceError> {
    let file = TextFile::read(path)?;
    let rows: Vec<TextLine> = file
        .rows()
        .enumerate()
        .filter(|(at, row)| *at > 0 || !is_head(row))
        .map(|(_, row)| row)
        .take(3)
        .collect();
    let counts: Vec<usize> = rows.iter().map(|row| row.fields().count()).collect();
    if counts.starts_with(&[3, 4]) {
        return Ok(log::trajectory(log::entries(&file, path)?));
    }
    let first = rows.first().ok_or_else(|| SequenceError::Content {
        path: path.to_owned(),
        problem: format!("has no poses; {KNOWN}"),
    })?;
    let columns = Columns::detect(&file, &rows).ok_or_else(|| {
        first.error(format!(
            "{} fields match no known trajectory; {KNOWN}",
            counts[0]
        ))
    })?;
    read_rows(&file, path, columns)
}

/// Reads a trajectory in TUM format, `stamp tx ty tz qx qy qz qw`.
pub(in super::super) fn read_stamped_quaternions(path: &Path) -> Result<PoseFile, SequenceError> {
    let file = TextFile::read(path)?;
    read_rows(&file, path, Columns::tum())
}

/// Files of a folder that are trajectories, for suggestions in error messages.
pub(in super::super) fn candidates(folder: &Folder) -> Vec<PathBuf> {
    const MAX_TRIED: usize = 40;
    folder
        .names()
        .iter()
        .take(MAX_TRIED)
        .map(|name| folder.path().join(name))
        .filter(|path| is_trajectory(path))
        .collect()
}

/// Whether a file has the content of a trajectory: several poses, most of them valid.
pub(in super::super) fn is_trajectory(path: &Path) -> bool {
    const MAX_BYTES: u64 = 64 << 20;
    std::fs::metadata(path).is_ok_and(|meta| meta.is_file() && meta.len() < MAX_BYTES)
        && begins_with_text(path)
        && read_pose_file(path).is_ok_and(|found| {
            let (all, valid) = (found.poses.len(), found.poses.valid());
            valid > 1 && 2 * valid > all
        })
}

/// Whether a file begins as text: images and models are not read to the end.
fn begins_with_text(path: &Path) -> bool {
    const HEAD: u64 = 1024;
    let mut head = Vec::new();
    let file = File::open(path).map(|file| file.take(HEAD));
    if file
        .and_then(|mut file| file.read_to_end(&mut head))
        .is_err()
    {
        return false;
    }
    // Text of 16 bits has a zero byte in each letter, and a mark before all.
    let is_wide = head.starts_with(&[0xFF, 0xFE]) || head.starts_with(&[0xFE, 0xFF]);
    is_wide || !head.iter().any(|&byte| byte == 0 || byte > 0xF7)
}

fn read_rows(file: &TextFile, path: &Path, columns: Columns) -> Result<PoseFile, SequenceError> {
    let mut stamped = Vec::new();
    let (mut in_order, mut named) = (Vec::new(), Vec::new());
    let (mut not_finite, mut not_rigid, mut total) =
        (WarningCounter::default(), WarningCounter::default(), 0);
    for row in file.rows() {
        if total == 0 && is_head(&row) {
            continue;
        }
        total += 1;
        let cells = fields(&row);
        let found = cells.len();
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
        let pose = columns.pose(&row)?;
        if let Err(problem @ rigid::RigidTransformError::LastRow { .. }) = pose {
            return Err(row.error(format!(
                "the 4x4 matrix {problem}: write it row by row, world from camera"
            )));
        }
        let at = match columns.key {
            Key::Order => {
                in_order.push(pose.map_err(|problem| note(problem, location)).ok());
                continue;
            }
            Key::Name => {
                let name = cells.first().copied().unwrap_or_default();
                match pose {
                    Ok(pose) => named.push((name.trim_matches('"').to_owned(), pose)),
                    Err(problem) => note(problem, shorten(name)),
                }
                continue;
            }
            Key::Stamp(at) => at,
        };
        let field = cells.get(at).copied().unwrap_or_default();
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
    let poses = match columns.key {
        Key::Order => Poses::InOrder(in_order),
        Key::Name => Poses::Named(named),
        Key::Stamp(_) => Poses::Stamped(stamped),
    };
    if columns.has_index {
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
