//! What is asked before the work begins: whether all files were read that matter, and whether the images contradict them.

use std::path::PathBuf;

use linecarve_sequence::{FileRole, FrameError, Sequence, check_images};

/// The files that a surface needs.
pub(crate) const ROLES_OF_SURFACE: [FileRole; 3] =
    [FileRole::Poses, FileRole::Depth, FileRole::Calibration];

/// The files that tracking needs.
pub(crate) const ROLES_OF_TRACKING: [FileRole; 2] = [FileRole::Depth, FileRole::Calibration];

/// What would make the result wrong in silence, and the remedy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{}: {problem}\n--accept-as-is goes on without that", folder.display())]
pub struct Doubt {
    /// The folder of the sequence.
    pub folder: PathBuf,
    /// What is doubtful, and the remedy.
    pub problem: String,
}

/// Why the questions have no good answer.
#[derive(Debug, thiserror::Error)]
pub enum QuestionError {
    /// Something would make the result wrong.
    #[error(transparent)]
    Doubt(#[from] Doubt),
    /// An image makes the whole sequence unusable.
    #[error(transparent)]
    Frame(#[from] FrameError),
}

/// Asks about a sequence as it was read, for a run that needs files of some roles. Returns warnings; with `accept_as_is` the doubts are among
/// them.
///
/// # Errors
/// The first doubt, and if an image makes the whole sequence unusable.
pub(crate) fn ask(
    sequence: &Sequence,
    roles: &[FileRole],
    accept_as_is: bool,
) -> Result<Vec<String>, QuestionError> {
    let missed = sequence
        .unread_files()
        .iter()
        .filter(|file| file.is_missed && roles.contains(&file.role))
        .map(|file| file.problem(sequence.folder()));
    let mut doubts: Vec<String> = missed.collect();
    let mut warnings = Vec::new();
    if doubts.is_empty() || accept_as_is {
        let check = check_images(sequence)?;
        doubts.extend(check.contradiction);
        warnings.extend(check.warning);
    }
    if accept_as_is || doubts.is_empty() {
        doubts.extend(warnings);
        return Ok(doubts);
    }
    Err(Doubt {
        folder: sequence.folder().to_owned(),
        problem: doubts.join("\n"),
    }
    .into())
}
