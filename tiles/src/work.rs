//! The folder of a plan: where files lie, and what is done.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use xxhash_rust::xxh3::xxh3_64;

use crate::error::TilesError;
use crate::file::{Kind, Reader, UNFINISHED, Writer, program, write_whole};
use crate::plan::Plan;
use crate::stage::{Item, Stage};

/// An opened plan.
#[derive(Debug)]
pub struct Work {
    folder: PathBuf,
    plan: Plan,
    digest: u64,
}

/// What an item left behind beside its file; renamed into place last.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// Digest of the plan, in hexadecimal.
    pub plan: String,
    /// Digest of the file, in hexadecimal.
    pub file: String,
    /// What was counted.
    pub counts: Vec<(String, u64)>,
    /// Seconds that it took.
    pub seconds: f64,
    /// Peak memory of the process, MB (10^6 bytes), where the system tells.
    pub peak_mb: Option<f64>,
}

impl Work {
    /// Opens a folder with a plan.
    ///
    /// # Errors
    /// When there is no plan, or another version of the program made it.
    pub fn open(folder: &Path) -> Result<Self, TilesError> {
        let path = folder.join("plan.json");
        let bytes = std::fs::read(&path).map_err(|fault| match fault.kind() {
            std::io::ErrorKind::NotFound => TilesError::NoPlan {
                path: folder.to_owned(),
            },
            _ => TilesError::io(&path)(fault),
        })?;
        let damaged = |what: &str| TilesError::damaged_plan(&path, format!("damaged ({what})"));
        let text: serde_json::Value =
            serde_json::from_slice(&bytes).map_err(|error| damaged(&error.to_string()))?;
        let found = text["program"].as_str().unwrap_or("unknown").to_owned();
        let expected = program();
        if found != expected {
            return Err(TilesError::OtherProgram {
                path,
                found,
                expected,
            });
        }
        let plan: Plan =
            serde_json::from_slice(&bytes).map_err(|error| damaged(&error.to_string()))?;
        if plan.seal() != plan.sealed {
            return Err(damaged("it was changed by hand"));
        }
        Ok(Self {
            folder: folder.to_owned(),
            plan,
            digest: xxh3_64(&bytes),
        })
    }

    pub(crate) fn new(folder: &Path, plan: Plan, digest: u64) -> Self {
        Self {
            folder: folder.to_owned(),
            plan,
            digest,
        }
    }

    /// Whether the plan is this text.
    pub(crate) fn is(&self, text: &[u8]) -> bool {
        self.digest == xxh3_64(text)
    }

    /// The plan.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// The stages of the plan.
    pub fn stages(&self) -> Vec<Stage> {
        Stage::of_labels(self.plan.is_cut())
    }

    /// The items of a stage.
    pub fn items(&self, stage: Stage) -> impl Iterator<Item = Item> + use<> {
        stage.items_of(self.plan.tiles.len())
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// The file of an item.
    pub fn path(&self, item: Item) -> PathBuf {
        let name = format!("{:06}.tile", item.number);
        self.folder.join(item.stage.name()).join(name)
    }

    /// The manifest of an item.
    pub fn manifest_path(&self, item: Item) -> PathBuf {
        self.path(item).with_extension("json")
    }

    pub(crate) fn plan_file(&self, name: &str) -> PathBuf {
        self.folder.join("plan").join(name)
    }

    pub(crate) fn open_plan_file(&self, name: &str, kind: Kind) -> Result<Reader, TilesError> {
        Reader::open(&self.plan_file(name), kind, self.digest)
    }

    pub(crate) fn open_tile(
        &self,
        folder: &str,
        tile: usize,
        kind: Kind,
    ) -> Result<Reader, TilesError> {
        self.open_plan_file(&format!("{folder}/{tile:06}.tile"), kind)
    }

    pub(crate) fn create_plan_file(&self, name: &str, kind: Kind) -> Result<Writer, TilesError> {
        Writer::create(&self.plan_file(name), kind, self.digest)
    }

    /// The result of an item, which another one needs.
    pub(crate) fn open_result(&self, needed: Item, item: Item) -> Result<Reader, TilesError> {
        if !self.manifest_path(needed).exists() {
            return Err(TilesError::NotReady { item, needed });
        }
        Reader::open(&self.path(needed), needed.stage.into(), self.digest)
    }

    pub(crate) fn create_result(&self, item: Item) -> Result<Writer, TilesError> {
        Writer::create(&self.path(item), item.stage.into(), self.digest)
    }

    /// Completes an item: its file, then its manifest.
    pub(crate) fn finish(
        &self,
        item: Item,
        writer: Writer,
        (counts, seconds, peak_mb): (Vec<(String, u64)>, f64, Option<f64>),
    ) -> Result<(), TilesError> {
        let digest = writer.finish()?;
        let manifest = Manifest {
            plan: format!("{:016x}", self.digest),
            file: format!("{digest:016x}"),
            counts,
            seconds,
            peak_mb,
        };
        let path = self.manifest_path(item);
        let text = serde_json::to_vec_pretty(&manifest).unwrap_or_default();
        write_whole(&path, &text)
    }

    /// The manifest of an item that is done; `None` when it is not, or its file is not that of the manifest.
    pub fn done(&self, item: Item) -> Option<Manifest> {
        let bytes = std::fs::read(self.manifest_path(item)).ok()?;
        let manifest: Manifest = serde_json::from_slice(&bytes).ok()?;
        let reader = Reader::open(&self.path(item), item.stage.into(), self.digest).ok()?;
        let is_same = manifest.plan == format!("{:016x}", self.digest)
            && manifest.file == format!("{:016x}", reader.digest());
        is_same.then_some(manifest)
    }

    /// Verifies every checksum of the file of an item that is done; removes the manifest of a damaged one, so that it is not
    /// done any more, and returns whether it was damaged.
    ///
    /// # Errors
    /// When the manifest cannot be removed.
    pub fn verify(&self, item: Item) -> Result<bool, TilesError> {
        let path = self.manifest_path(item);
        if !path.exists() {
            return Ok(false);
        }
        let is_whole = self.done(item).is_some()
            && Reader::open(&self.path(item), item.stage.into(), self.digest)
                .and_then(|reader| reader.verify())
                .is_ok();
        if !is_whole {
            std::fs::remove_file(&path).map_err(TilesError::io(&path))?;
        }
        Ok(!is_whole)
    }

    /// Verifies every checksum of the files of the plan itself.
    ///
    /// # Errors
    /// Names the damaged file; the same input has to be planned again.
    pub fn verify_plan(&self) -> Result<(), TilesError> {
        self.open_plan_file("views", Kind::Views)?.verify()?;
        self.open_plan_file("sample", Kind::Sample)?.verify()?;
        (0..self.plan.tiles.len()).try_for_each(|tile| {
            self.open_tile("points", tile, Kind::Points)?.verify()?;
            self.open_tile("rays", tile, Kind::Rays)?.verify()
        })
    }

    /// Removes what interrupted writers left behind. No other process may be writing.
    pub fn remove_unfinished(&self) {
        let names = Stage::ALL.map(Stage::name).into_iter();
        for name in names.chain(["", "plan", "plan/points", "plan/rays"]) {
            let Ok(entries) = std::fs::read_dir(self.folder.join(name)) else {
                continue;
            };
            for entry in entries.flatten() {
                if entry.file_name().to_string_lossy().starts_with(UNFINISHED) {
                    // A file that stays does no harm.
                    let _ = match entry.path().is_dir() {
                        true => std::fs::remove_dir_all(entry.path()),
                        false => std::fs::remove_file(entry.path()),
                    };
                }
            }
        }
    }
}
