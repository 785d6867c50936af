//! The plan of a sequence: its keyframes in groups for the front end, and the intake that makes the plan of the tiles.
//!
//! ```text
//! sequence.json            the recording as it was opened, and the numbers of tasks
//! .linecarve/              what the front end found, one file a keyframe, as in a run that can be resumed
//! keyframes/NNNNNN.json    manifest of a group of keyframes
//! intake/000000.json       manifest of the intake, which wrote plan.json and plan/
//! ```

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use linecarve_mesh::TriangleMesh;
use linecarve_mesh::files::{remove_unfinished, write_atomically};
use linecarve_tiles::{Manifest, PlanOptions, TilesError, Work};
use serde::{Deserialize, Serialize};

use super::{Finish, ProjectError, Split};
use crate::front_end::Arrival;
use crate::options::{LabelKind, Options};
use crate::reconstruction::{Reconstruction, RunOptions, front_end};
use crate::recording::{Input, PreparedRecording, Recording};
use crate::run::{CHECKPOINT_FOLDER, CancelToken, Checkpoint, CheckpointError, checksum, peak_mb};

/// Keyframes of one task of the front end.
pub const KEYFRAMES_OF_TASK: usize = 64;
/// Keyframes of a tile when the number of tiles is not given: about a million points of depth from images.
const KEYFRAMES_OF_TILE: usize = 2000;

const FILE: &str = "sequence.json";

/// What all tasks of a sequence know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Contents {
    /// Version of the program that made it.
    program: String,
    recording: PreparedRecording,
    keyframes_of_task: usize,
    tiles: usize,
    halo: u32,
}

/// An opened plan of a sequence.
#[derive(Debug)]
pub struct SequencePlan {
    folder: PathBuf,
    contents: Contents,
    /// Digest of the file, in hexadecimal.
    digest: String,
}

fn program() -> String {
    format!("{} (sequences 1)", env!("CARGO_PKG_VERSION"))
}

impl SequencePlan {
    /// Plans a recording that was opened from an input. The same plan into the same folder changes nothing.
    ///
    /// # Errors
    /// When the recording needs more than its images and poses, the folder holds another plan or cannot be written.
    pub(crate) fn create(
        recording: &Recording,
        input: &Input,
        split: Split,
        folder: &Path,
    ) -> Result<Self, ProjectError> {
        if split.keyframes_of_task == 0 {
            return Err(ProjectError::NoKeyframesOfTask);
        }
        let prepared = PreparedRecording::of(recording, input)?;
        let count = prepared.keyframe_count();
        let contents = Contents {
            program: program(),
            recording: prepared,
            keyframes_of_task: split.keyframes_of_task,
            tiles: split
                .tiles
                .unwrap_or(count.div_ceil(KEYFRAMES_OF_TILE))
                .max(1),
            halo: split.halo,
        };
        let text = serde_json::to_vec_pretty(&contents)?;
        let planned = || {
            let path = folder.to_owned();
            ProjectError::from(TilesError::Planned { path })
        };
        if let Some(found) = Self::open(folder)? {
            return match found.contents == contents {
                true => Ok(found),
                false => Err(planned()),
            };
        }
        if folder.join("plan.json").exists() {
            return Err(planned());
        }
        let description = recording.description();
        if contents.recording.open()?.description() != description {
            let path = input.path.clone();
            return Err(ProjectError::NotRepeatable { path });
        }
        Checkpoint::open(folder, &description, false)?;
        write_atomically(&folder.join(FILE), |out| out.write_all(&text))?;
        Ok(Self {
            folder: folder.to_owned(),
            digest: digest(&text),
            contents,
        })
    }

    /// Opens the plan of a folder; `None` when there is none of a sequence.
    ///
    /// # Errors
    /// When another version of the program made it, or it is damaged.
    pub(crate) fn open(folder: &Path) -> Result<Option<Self>, ProjectError> {
        let path = folder.join(FILE);
        let bytes = match std::fs::read(&path) {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(None),
            Err(error) => return Err(ProjectError::file(&path)(error)),
        };
        let damaged = |fault| {
            let path = path.clone();
            ProjectError::Damaged { path, fault }
        };
        let value: serde_json::Value = serde_json::from_slice(&bytes).map_err(damaged)?;
        let (found, expected) = (value["program"].as_str().unwrap_or_default(), program());
        if found != expected {
            let found = found.to_owned();
            return Err(TilesError::OtherProgram {
                path,
                found,
                expected,
            }
            .into());
        }
        Ok(Some(Self {
            folder: folder.to_owned(),
            contents: serde_json::from_value(value).map_err(damaged)?,
            digest: digest(&bytes),
        }))
    }

    /// Number of keyframes.
    pub fn keyframe_count(&self) -> usize {
        self.contents.recording.keyframe_count()
    }

    /// Number of tasks of the front end.
    pub fn task_count(&self) -> usize {
        let contents = &self.contents;
        self.keyframe_count().div_ceil(contents.keyframes_of_task)
    }

    /// Number of tiles.
    pub fn tile_count(&self) -> usize {
        self.contents.tiles
    }

    /// Whether labels are those of a minimum cut.
    pub(crate) fn is_cut(&self) -> bool {
        self.options().carving.labels == LabelKind::Cut
    }

    fn options(&self) -> Options {
        self.contents.recording.configuration().options()
    }

    fn keyframes(&self, task: usize) -> Range<usize> {
        let size = self.contents.keyframes_of_task;
        let end = self.keyframe_count();
        (task * size).min(end)..((task + 1) * size).min(end)
    }

    /// The recording as it was planned, and what the front end found of it so far.
    fn recording(&self) -> Result<(Recording, Checkpoint), ProjectError> {
        let recording = self.contents.recording.open()?;
        let folder = self.folder.clone();
        match Checkpoint::open(&self.folder, &recording.description(), true) {
            Ok(checkpoint) => Ok((recording, checkpoint)),
            Err(CheckpointError::Different { difference, .. }) => Err(ProjectError::Changed {
                path: recording.sequence.folder().to_owned(),
                folder,
                difference,
            }),
            Err(CheckpointError::Nothing { .. }) => Err(ProjectError::NoCheckpoint { folder }),
            Err(error) => Err(error.into()),
        }
    }

    /// Lets the front end store the keyframes of a task.
    ///
    /// # Errors
    /// When a fault is not limited to one image, or a file cannot be written.
    pub(crate) fn prepare(&self, task: usize) -> Result<(), ProjectError> {
        let start = Instant::now();
        let (recording, checkpoint) = self.recording()?;
        let range = self.keyframes(task);
        let front_end = front_end(&recording, Some(&checkpoint), false)?;
        let arrivals = front_end.prepare_range(
            &recording.sequence,
            &recording.keyframes,
            range.clone(),
            &checkpoint,
        );
        for (_, arrival) in arrivals {
            match arrival {
                // The intake meets and counts it again.
                Arrival::Final(Err(fault)) if !fault.is_limited_to_frame() => {
                    return Err(fault.into());
                }
                Arrival::Final(_) | Arrival::Provisional { .. } => {}
            }
        }
        let stored = checkpoint.stored(range.clone());
        let counts = vec![
            ("keyframes".to_owned(), stored.len() as u64),
            ("skipped".to_owned(), (range.len() - stored.len()) as u64),
        ];
        let file = digest(&bytes_of(&stored));
        self.write_manifest("keyframes", task, file, counts, start)
    }

    /// Fuses all keyframes, and plans the tiles of their points.
    ///
    /// # Errors
    /// When a keyframe cannot be read, there are no points, or a file cannot be written.
    pub(crate) fn take_in(&self) -> Result<Work, ProjectError> {
        let start = Instant::now();
        let run = self.fuse()?;
        let map = run.map();
        let carver = map.carver();
        let mut options = PlanOptions::default();
        options.tiles = self.contents.tiles;
        options.halo = self.contents.halo;
        options.keeps_neighbors = self.contents.recording.is_of_lines();
        let finish = Finish::text(
            run.recording().origin.into(),
            &run.recording().options,
            None,
        )?;
        let export = map.export_options();
        let work = linecarve_tiles::plan(&self.folder, carver, &export, &options, finish)?;
        let counts = vec![
            ("keyframes".to_owned(), run.numbers().len() as u64),
            ("skipped".to_owned(), run.skipped().len() as u64),
            ("points".to_owned(), carver.point_count() as u64),
        ];
        let file = digest(&self.read_plan()?);
        self.write_manifest("intake", 0, file, counts, start)?;
        Ok(work)
    }

    /// All keyframes in a map that carves nothing.
    fn fuse(&self) -> Result<Reconstruction, ProjectError> {
        let (recording, checkpoint) = self.recording()?;
        let run = RunOptions {
            checkpoint: Some(checkpoint),
            ..RunOptions::default()
        };
        let mut run = Reconstruction::new(recording, run)?;
        if !run.leave_carving() {
            return Err(ProjectError::NeedsEverySurface);
        }
        run.run(CancelToken::default(), &mut [])?;
        Ok(run)
    }

    /// The surface of all stages, where keyframes have a say in it; `None` where it is that of the tiles.
    ///
    /// # Errors
    /// As [`take_in`](Self::take_in), and when a stage is not done.
    pub(crate) fn surface(&self, work: &Work) -> Result<Option<TriangleMesh>, ProjectError> {
        if !self.contents.recording.is_of_lines() {
            return Ok(None);
        }
        let merged = linecarve_tiles::merged_surface(work)?;
        Ok(self.fuse()?.surface_of(&merged))
    }

    fn read_plan(&self) -> Result<Vec<u8>, ProjectError> {
        let path = self.folder.join("plan.json");
        std::fs::read(&path).map_err(ProjectError::file(&path))
    }

    fn manifest_path(&self, stage: &str, task: usize) -> PathBuf {
        self.folder.join(stage).join(format!("{task:06}.json"))
    }

    fn write_manifest(
        &self,
        stage: &str,
        task: usize,
        file: String,
        counts: Vec<(String, u64)>,
        start: Instant,
    ) -> Result<(), ProjectError> {
        let manifest = Manifest {
            plan: self.digest.clone(),
            file,
            counts,
            seconds: start.elapsed().as_secs_f64(),
            peak_mb: peak_mb(),
        };
        let path = self.manifest_path(stage, task);
        let folder = self.folder.join(stage);
        std::fs::create_dir_all(&folder).map_err(ProjectError::file(&folder))?;
        let text = serde_json::to_vec_pretty(&manifest)?;
        write_atomically(&path, |out| out.write_all(&text))?;
        Ok(())
    }

    fn manifest(&self, stage: &str, task: usize) -> Option<Manifest> {
        let bytes = std::fs::read(self.manifest_path(stage, task)).ok()?;
        let manifest: Manifest = serde_json::from_slice(&bytes).ok()?;
        (manifest.plan == self.digest).then_some(manifest)
    }

    /// Removes what interrupted tasks of the front end and the intake left behind. No other process may be writing.
    pub(crate) fn remove_unfinished(&self) {
        for name in [CHECKPOINT_FOLDER, "keyframes", "intake"] {
            // A folder that no task has made yet holds none, and a file that stays does no harm.
            let _ = remove_unfinished(&self.folder.join(name));
        }
    }

    /// The manifest of a task of the front end that is done.
    pub(crate) fn prepared(&self, task: usize) -> Option<Manifest> {
        self.manifest("keyframes", task)
    }

    /// The manifest of the intake, when it is done.
    pub(crate) fn taken_in(&self) -> Option<Manifest> {
        let manifest = self.manifest("intake", 0)?;
        (manifest.file == digest(&self.read_plan().ok()?)).then_some(manifest)
    }

    /// Verifies the files of a task of the front end that is done; removes the manifest of damaged ones, and returns whether they were.
    ///
    /// # Errors
    /// When the manifest cannot be removed.
    pub(crate) fn verify_prepared(&self, task: usize) -> Result<bool, ProjectError> {
        let checkpoint = Checkpoint::of(&self.folder);
        let is_whole = |manifest: Manifest| {
            let stored = checkpoint.stored(self.keyframes(task));
            manifest.file == digest(&bytes_of(&stored))
        };
        self.retire("keyframes", task, |plan| {
            plan.prepared(task).is_some_and(is_whole)
        })
    }

    /// Verifies what the intake wrote, when it is done; takes back what is damaged, and returns whether it was.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub(crate) fn verify_taken_in(&self) -> Result<bool, ProjectError> {
        let is_whole = |plan: &Self| {
            let work = plan.taken_in().and_then(|_| Work::open(&self.folder).ok());
            work.is_some_and(|work| work.verify_plan().is_ok())
        };
        let was_damaged = self.retire("intake", 0, is_whole)?;
        let path = self.folder.join("plan.json");
        if was_damaged && path.exists() {
            // The intake would take it for a whole plan.
            std::fs::remove_file(&path).map_err(ProjectError::file(&path))?;
        }
        Ok(was_damaged)
    }

    fn retire(
        &self,
        stage: &str,
        task: usize,
        is_whole: impl FnOnce(&Self) -> bool,
    ) -> Result<bool, ProjectError> {
        let path = self.manifest_path(stage, task);
        if !path.exists() || is_whole(self) {
            return Ok(false);
        }
        std::fs::remove_file(&path).map_err(ProjectError::file(&path))?;
        Ok(true)
    }
}

fn digest(bytes: &[u8]) -> String {
    format!("{:016x}", checksum(bytes))
}

/// Which keyframes are stored; each file has a checksum of its own, and durations in it differ from run to run.
fn bytes_of(stored: &[usize]) -> Vec<u8> {
    let numbers = stored.iter().map(|&keyframe| keyframe as u64);
    numbers.flat_map(u64::to_le_bytes).collect()
}
