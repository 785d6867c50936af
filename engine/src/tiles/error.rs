//! Why a plan of a model or a sequence cannot be made or carried out.

use std::path::{Path, PathBuf};

use linecarve_mesh::MeshFileError;
use linecarve_mesh::files::WriteError;
use linecarve_sequence::SequenceError;
use linecarve_tiles::TilesError;

use super::Task;
use crate::error::Error;
use crate::front_end::FrontEndError;
use crate::map::MapError;
use crate::options::OptionsError;
use crate::recording::RecordingError;
use crate::run::CheckpointError;

/// Why a plan of a model or a sequence cannot be made or carried out. Texts name the file and the remedy.
#[derive(Debug, thiserror::Error)]
pub enum ProjectError {
    /// A plan of tiles or a task of them.
    #[error(transparent)]
    Tiles(#[from] TilesError),
    /// The input cannot be used.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// A file of the input cannot be read.
    #[error(transparent)]
    Sequence(#[from] SequenceError),
    /// A parameter is out of range.
    #[error(transparent)]
    Options(#[from] OptionsError),
    /// A keyframe cannot be read.
    #[error(transparent)]
    FrontEnd(#[from] FrontEndError),
    /// The map refuses the input.
    #[error(transparent)]
    Map(#[from] MapError),
    /// The keyframes cannot be fused.
    #[error(transparent)]
    Run(#[from] Error),
    /// What the front end found cannot be kept.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The mesh cannot be written.
    #[error(transparent)]
    Mesh(#[from] MeshFileError),
    /// A plan or a manifest cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A plan or a manifest cannot be read or written as JSON.
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    /// A file cannot be read or written.
    #[error("{}: {fault}", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// Error of the operating system.
        fault: std::io::Error,
    },
    /// A file without a name cannot be written or read.
    #[error("a temporary file in {}: {fault}", folder.display())]
    Temporary {
        /// The folder.
        folder: PathBuf,
        /// Error of the operating system.
        fault: std::io::Error,
    },
    /// A plan is not what was written.
    #[error("{}: damaged; plan again into another folder: {fault}", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: serde_json::Error,
    },
    /// The options ask for a simplified mesh.
    #[error(
        "tiles are not simplified: leave the tolerance out of the configuration, and use `linecarve simplify` on the mesh"
    )]
    Simplified,
    /// Tasks have no keyframes.
    #[error("--keyframes-per-task 0: give at least one")]
    NoKeyframesOfTask,
    /// The input cannot be opened a second time with the same result.
    #[error("{}: cannot be opened again as it was", path.display())]
    NotRepeatable {
        /// The input.
        path: PathBuf,
    },
    /// The input is no longer what was planned.
    #[error(
        "{}: no longer what was planned ({difference}): plan again into another folder than {}",
        path.display(), folder.display()
    )]
    Changed {
        /// The input.
        path: PathBuf,
        /// The folder of the plan.
        folder: PathBuf,
        /// What differs.
        difference: String,
    },
    /// A file of the plan is missing.
    #[error("{}: .linecarve/run.txt is missing: plan again into another folder", folder.display())]
    NoCheckpoint {
        /// The folder of the plan.
        folder: PathBuf,
    },
    /// Points depend on the surfaces of earlier keyframes.
    #[error("the surface of every keyframe is needed")]
    NeedsEverySurface,
    /// There are no tiles yet.
    #[error("the intake has not been made: run the stages in order (`linecarve tiles run`)")]
    NoIntake,
    /// There is no such task.
    #[error("there is no task {task}: `linecarve tiles stages` lists them")]
    NoTask {
        /// The task.
        task: Task,
    },
    /// What a task needs has not been made.
    #[error(
        "{task} needs {needed}, which has not been made: run the stages in order (`linecarve tiles run`)"
    )]
    NotReady {
        /// The task.
        task: Task,
        /// What it needs.
        needed: Task,
    },
}

impl ProjectError {
    /// Whether a file of the plan is damaged or missing.
    pub fn is_damaged_plan(&self) -> bool {
        matches!(
            self,
            Self::Damaged { .. } | Self::Tiles(TilesError::DamagedPlan { .. })
        )
    }

    /// An error of the operating system about a file without a name in a folder.
    pub(super) fn temporary(folder: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |fault| Self::Temporary {
            folder: folder.to_owned(),
            fault,
        }
    }

    /// An error of the operating system about a file or folder.
    pub(super) fn file(path: &Path) -> impl FnOnce(std::io::Error) -> Self + '_ {
        move |fault| Self::File {
            path: path.to_owned(),
            fault,
        }
    }
}
