//! Trajectories of Open3D and Redwood: entries of five lines, three whole numbers and a 4x4 matrix.

use std::path::Path;

use nalgebra::Isometry3;

use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, rigid};
use super::{PoseFile, PoseFileFormat, Poses};

/// An entry of a trajectory: its own number and its pose.
pub(in super::super) struct LogEntry {
    pub(in super::super) number: u64,
    pub(in super::super) pose: Result<Isometry3<f64>, rigid::RigidTransformError>,
}

/// Reads the entries of a file.
///
/// # Errors
/// When the file cannot be read, is malformed or holds no entry.
pub(in super::super) fn read_log(path: &Path) -> Result<Vec<LogEntry>, SequenceError> {
    entries(&TextFile::read(path)?, path)
}

pub(super) fn entries(file: &TextFile, path: &Path) -> Result<Vec<LogEntry>, SequenceError> {
    let mut rows = file.rows();
    let mut entries: Vec<LogEntry> = Vec::new();
    while let Some(head) = rows.next() {
        let number = head
            .fields()
            .next()
            .and_then(|field| field.parse::<u64>().ok())
            .filter(|_| head.fields().count() == 3)
            .ok_or_else(|| {
                head.error(format!(
                    "the head of entry {} expected: three whole numbers 'i i i+1', then four rows of a matrix",
                    entries.len()
                ))
            })?;
        let mut matrix = [[0.0; 4]; 4];
        for (r, slot) in matrix.iter_mut().enumerate() {
            let row = rows.next().ok_or_else(|| {
                head.error(format!(
                    "the matrix of this entry has {r} rows instead of 4 (cut off?)"
                ))
            })?;
            *slot = row.numbers()?;
        }
        entries.push(LogEntry {
            number,
            pose: rigid::from_matrix(&matrix),
        });
    }
    if entries.is_empty() {
        return Err(SequenceError::Content {
            path: path.to_owned(),
            problem: "holds no pose: entries of five lines expected, 'i i i+1' and a 4x4 matrix"
                .to_owned(),
        });
    }
    Ok(entries)
}

/// Entries as a trajectory of numbered poses.
pub(super) fn trajectory(entries: Vec<LogEntry>) -> PoseFile {
    let (mut not_finite, mut not_rigid) = (WarningCounter::default(), WarningCounter::default());
    let total = entries.len();
    let poses = entries
        .into_iter()
        .map(|entry| {
            let pose = entry.pose.map_err(|problem| match problem {
                rigid::RigidTransformError::NotFinite => not_finite.add(entry.number.to_string()),
                problem => not_rigid.add(format!("{} {problem}", entry.number)),
            });
            (entry.number, pose.ok())
        })
        .collect();
    let mut warnings = Vec::new();
    warnings.extend(not_finite.into_warning(total, "poses are not finite and were left out"));
    warnings.extend(not_rigid.into_warning(total, "poses are not rigid motions and were left out"));
    PoseFile {
        format: PoseFileFormat::Open3dLog,
        poses: Poses::Numbered(poses),
        warnings,
    }
}
