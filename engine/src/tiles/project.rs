//! The folder of a plan with all its tasks: those of a sequence, if it is one, and those of the tiles.

use std::path::Path;

use linecarve_mesh::TriangleMesh;
use linecarve_tiles::{Item, Manifest, Stage, TilesError, Work, run_item, run_pending};

use super::cloud::read_kept;
use super::sequence::SequencePlan;
use super::task::{Task, TaskStage};
use super::{Finish, ProjectError};
use crate::run::peak_mb;

/// An opened folder.
pub struct Project {
    sequence: Option<SequencePlan>,
    /// `None` before the intake of a sequence.
    work: Option<Work>,
}

impl Project {
    /// Opens a folder with a plan.
    ///
    /// # Errors
    /// When there is no plan, it is damaged, or another version of the program made it.
    pub fn open(folder: &Path) -> Result<Self, ProjectError> {
        let sequence = SequencePlan::open(folder)?;
        let work = match &sequence {
            Some(sequence) => sequence
                .taken_in()
                .map(|_| Work::open(folder))
                .transpose()?,
            None => Some(Work::open(folder)?),
        };
        Ok(Self { sequence, work })
    }

    /// The plan of the tiles, when there is one.
    ///
    /// # Errors
    /// Before the intake of a sequence.
    pub fn work(&self) -> Result<&Work, ProjectError> {
        self.work.as_ref().ok_or(ProjectError::NoIntake)
    }

    /// The surface of all stages, where it is not just that of the tiles.
    ///
    /// # Errors
    /// When a stage is not done, or a keyframe cannot be read.
    pub fn surface(&self) -> Result<Option<TriangleMesh>, ProjectError> {
        match &self.sequence {
            Some(sequence) => sequence.surface(self.work()?),
            None => Ok(None),
        }
    }

    /// The stages in order.
    pub fn stages(&self) -> Vec<TaskStage> {
        let mut stages = Vec::new();
        if self.sequence.is_some() {
            stages.extend([TaskStage::Keyframes, TaskStage::Intake]);
        }
        let is_cut = match (&self.sequence, &self.work) {
            (Some(sequence), _) => sequence.is_cut(),
            (None, Some(work)) => work.plan().is_cut(),
            (None, None) => false,
        };
        stages.extend(Stage::of_labels(is_cut).into_iter().map(TaskStage::Tiles));
        stages
    }

    /// The tasks of a stage.
    pub fn tasks(&self, stage: TaskStage) -> impl Iterator<Item = Task> + use<> {
        let sequence = self.sequence.as_ref();
        let count = match stage {
            TaskStage::Keyframes => sequence.map_or(0, SequencePlan::task_count),
            TaskStage::Intake => sequence.map_or(0, |_| 1),
            TaskStage::Tiles(stage) => {
                let of_work = || self.work.as_ref().map_or(0, |work| work.plan().tiles.len());
                let tiles = sequence.map_or_else(of_work, SequencePlan::tile_count);
                stage.items_of(tiles).count()
            }
        };
        (0..count).map(move |number| Task { stage, number })
    }

    /// The manifest of a task that is done.
    pub fn done(&self, task: Task) -> Option<Manifest> {
        match task.stage {
            TaskStage::Keyframes => self.sequence.as_ref()?.prepared(task.number),
            TaskStage::Intake => self.sequence.as_ref()?.taken_in(),
            TaskStage::Tiles(_) => self.work.as_ref()?.done(item(task)?),
        }
    }

    /// Verifies the files of a task that is done; takes back damaged ones, and returns whether they were.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub fn verify(&self, task: Task) -> Result<bool, ProjectError> {
        match (task.stage, &self.sequence, &self.work) {
            (TaskStage::Keyframes, Some(sequence), _) => sequence.verify_prepared(task.number),
            (TaskStage::Intake, Some(sequence), _) => sequence.verify_taken_in(),
            (TaskStage::Tiles(_), _, Some(work)) => {
                let item = item(task);
                Ok(item.map_or(Ok(false), |item| work.verify(item))?)
            }
            _ => Ok(false),
        }
    }

    /// Verifies the files of a model's plan, which no task can make again.
    ///
    /// # Errors
    /// Names the damaged file.
    pub fn verify_plan(&self) -> Result<(), ProjectError> {
        match (&self.sequence, &self.work) {
            (None, Some(work)) => {
                work.verify_plan()?;
                verify_cloud(work)
            }
            _ => Ok(()),
        }
    }

    /// Carries out a task that is not done yet.
    ///
    /// # Errors
    /// When there is no such task, something that it needs is missing or damaged, or its files cannot be written.
    pub fn carry_out(&self, task: Task) -> Result<(), ProjectError> {
        // Schedulers start tasks twice.
        if self.done(task).is_some() {
            return Ok(());
        }
        let known = match (task.stage, &self.sequence) {
            (TaskStage::Tiles(_), None) => true,
            (stage, _) => self.tasks(stage).any(|other| other == task),
        };
        if !known {
            return Err(ProjectError::NoTask { task });
        }
        match (item(task), &self.sequence) {
            (Some(item), _) => Ok(run_item(self.work()?, item, peak_mb)?),
            (None, Some(sequence)) if task.stage == TaskStage::Keyframes => {
                sequence.prepare(task.number)
            }
            (None, Some(sequence)) => {
                let undone = self
                    .tasks(TaskStage::Keyframes)
                    .find(|task| self.done(*task).is_none());
                match undone {
                    Some(needed) => Err(ProjectError::NotReady { task, needed }),
                    None => sequence.take_in().map(drop),
                }
            }
            (None, None) => Ok(()),
        }
    }
}

/// Verifies what the mesh of a dense cloud needs of its points.
fn verify_cloud(work: &Work) -> Result<(), ProjectError> {
    let finish: Finish = serde_json::from_str(&work.plan().caller)?;
    match finish.dense {
        Some(_) => read_kept(work.folder()).map(drop),
        None => Ok(()),
    }
}

/// The item of a task of the tiles.
fn item(task: Task) -> Option<Item> {
    match task.stage {
        TaskStage::Tiles(stage) => Some(Item {
            stage,
            number: task.number,
        }),
        TaskStage::Keyframes | TaskStage::Intake => None,
    }
}

/// Carries out what is left of a plan, stage by stage, with `jobs` calls of `execute` at a time. Files of tasks that are done are verified
/// first; damaged ones are made again. Returns the project and the number of tasks carried out.
///
/// # Errors
/// The first error of a task; others of its stage that had begun are waited for.
pub fn carry_out_all<E: From<ProjectError> + From<TilesError> + Send>(
    folder: &Path,
    jobs: usize,
    execute: impl Fn(Task) -> Result<(), E> + Sync,
) -> Result<(Project, usize), E> {
    let mut project = Project::open(folder)?;
    let mut carried_out = 0;
    if let Some(sequence) = &project.sequence {
        sequence.remove_unfinished();
        for stage in [TaskStage::Keyframes, TaskStage::Intake] {
            let mut pending = Vec::new();
            for task in project.tasks(stage) {
                if project.verify(task)? || project.done(task).is_none() {
                    pending.push(task);
                }
            }
            carried_out += pending.len();
            run_pending(&pending, jobs, &execute)?;
        }
        project = Project::open(folder)?;
    }
    let work = project.work()?;
    verify_cloud(work)?;
    let of_tiles = |Item { stage, number }| {
        let stage = TaskStage::Tiles(stage);
        execute(Task { stage, number })
    };
    carried_out += linecarve_tiles::run(work, jobs, of_tiles)?;
    Ok((project, carried_out))
}
