//! Trajectories of Open3D and Redwood: entries of three integers and a 4x4 matrix.

use std::path::Path;

use nalgebra::Isometry3;

use super::super::text::TextFile;
use super::super::warning::WarningCounter;
use super::super::{SequenceError, rigid};
use super::{PoseFile, PoseFileFormat, Poses};

/// An entry of a trajectory: its image number and its pose.
pub(in super::super) struct LogEntry {
    pub(in super::super) number: u64,
    pub(in super::super) pose: Result<Isometry3<f64>, rigid::RigidTransformError>,
}

/// Reads the entries of a file.
///
/// # Errors
/// If the file cannot be read, is malformed or has no entry.
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
                    "expected the head of entry {}: three integers 'i i i+1', then a 4x4 matrix",
                    entries.len()
                ))
            })?;
        let mut matrix = [[0.0; 4]; 4];
        for (r, slot) in matrix.iter_mut().enumerate() {
            let row = rows.next().ok_or_else(|| {
                head.error(format!(
                    "the matrix of this entry has {r} rows instead of 4 (truncated?)"
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
            problem: "has no poses: expected entries of five lines, 'i i i+1' and a 4x4 matrix"
                .to_owned(),
        });
    }
    Ok(entries)
}

/// Converts entries to a trajectory of numbered poses.
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
    warnings.extend(not_finite.into_warning(total, "poses are not finite and were skipped"));
    warnings
        .extend(not_rigid.into_warning(total, "poses are not rigid transforms and were skipped"));
    PoseFile {
        format: PoseFileFormat::Open3dLog,
        poses: Poses::Numbered(poses),
        warnings,
    }
}
