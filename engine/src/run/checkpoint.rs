//! Checkpoint of a run: keyframes stored so that the run can be resumed.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use linecarve_mesh::files::{WriteError, write_atomically};

/// Folder inside the output folder.
pub const FOLDER: &str = ".linecarve";

/// File with the description of the run.
const RUN: &str = "run.txt";

/// A run cannot be resumed or stored.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// There is no checkpoint.
    #[error(
        "{} holds no run to resume: leave out --resume to start one", folder.display()
    )]
    Nothing {
        /// The output folder.
        folder: PathBuf,
    },
    /// The checkpoint belongs to another run.
    #[error(
        "the run in {} was started with other inputs or options ({difference}): repeat it with the \
         same ones, or leave out --resume to start again",
        folder.display()
    )]
    Different {
        /// The output folder.
        folder: PathBuf,
        /// The first line that differs.
        difference: String,
    },
    /// A file cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A file or folder cannot be read, created or removed.
    #[error("cannot use {}: {source}", path.display())]
    Folder {
        /// Its path.
        path: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

/// The stored keyframes of a run.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    folder: PathBuf,
    /// Keyframes that were read from the files of an interrupted run.
    reused: Arc<AtomicUsize>,
}

impl Checkpoint {
    /// Creates a checkpoint, or opens one to resume. `description` identifies the run by lines; a run is resumed only when it
    /// is equal.
    ///
    /// # Errors
    /// When there is no checkpoint to resume, it belongs to another run, or the folder is not writable.
    pub fn open(output: &Path, description: &str, resume: bool) -> Result<Self, CheckpointError> {
        let folder = output.join(FOLDER);
        let failed = |path: &Path| {
            let path = path.to_owned();
            move |source| CheckpointError::Folder { path, source }
        };
        let run = folder.join(RUN);
        if resume {
            let found = match std::fs::read(&run) {
                Ok(bytes) => String::from_utf8_lossy(&bytes).into_owned(),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                    return Err(CheckpointError::Nothing {
                        folder: output.to_owned(),
                    });
                }
                Err(error) => return Err(failed(&run)(error)),
            };
            if let Some(difference) = difference(&found, description) {
                return Err(CheckpointError::Different {
                    folder: output.to_owned(),
                    difference,
                });
            }
            return Ok(Self::new(folder));
        }
        if folder.exists() {
            std::fs::remove_dir_all(&folder).map_err(failed(&folder))?;
        }
        std::fs::create_dir_all(&folder).map_err(failed(&folder))?;
        write_atomically(&run, |out| out.write_all(description.as_bytes()))?;
        Ok(Self::new(folder))
    }

    /// The checkpoint of an output folder, whatever run it belongs to.
    pub(crate) fn of(output: &Path) -> Self {
        Self::new(output.join(FOLDER))
    }

    fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            reused: Arc::default(),
        }
    }

    /// Number of keyframes that were taken from an interrupted run instead of being computed.
    pub fn reused(&self) -> usize {
        self.reused.load(Ordering::Relaxed)
    }

    /// Counts a keyframe that was taken from an interrupted run.
    pub(crate) fn count_reused(&self) {
        self.reused.fetch_add(1, Ordering::Relaxed);
    }

    fn path(&self, keyframe: usize) -> PathBuf {
        self.folder.join(format!("{keyframe:06}.keyframe"))
    }

    /// Loads a stored value; `None` when it is missing or damaged.
    pub fn load<T: DeserializeOwned>(&self, keyframe: usize) -> Option<T> {
        let bytes = self.read(keyframe)?;
        rmp_serde::from_slice(&bytes).ok()
    }

    fn read(&self, keyframe: usize) -> Option<Vec<u8>> {
        let mut bytes = std::fs::read(self.path(keyframe)).ok()?;
        let at = bytes.len().checked_sub(8)?;
        let sum = u64::from_le_bytes(bytes[at..].try_into().ok()?);
        bytes.truncate(at);
        (checksum(&bytes) == sum).then_some(bytes)
    }

    /// Numbers of the keyframes that are stored and whole.
    pub(crate) fn stored(&self, keyframes: Range<usize>) -> Vec<usize> {
        let is_whole = |keyframe: &usize| self.read(*keyframe).is_some();
        keyframes.filter(is_whole).collect()
    }

    /// Stores a value for a keyframe. Numbers are kept bit by bit.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn store<T: Serialize>(&self, keyframe: usize, value: &T) -> Result<(), WriteError> {
        write_atomically(&self.path(keyframe), |out| {
            let bytes = rmp_serde::to_vec(value).map_err(std::io::Error::other)?;
            out.write_all(&bytes)?;
            out.write_all(&checksum(&bytes).to_le_bytes())
        })
    }

    /// Loads the value of a keyframe, or computes and stores it. Without a checkpoint it is always computed.
    ///
    /// # Errors
    /// When `compute` fails, or the file cannot be written.
    pub fn load_or<T, E>(
        checkpoint: Option<&Self>,
        keyframe: usize,
        compute: impl FnOnce() -> Result<T, E>,
    ) -> Result<T, E>
    where
        T: Serialize + DeserializeOwned,
        E: From<WriteError>,
    {
        let Some(checkpoint) = checkpoint else {
            return compute();
        };
        if let Some(stored) = checkpoint.load(keyframe) {
            checkpoint.count_reused();
            return Ok(stored);
        }
        let computed = compute()?;
        checkpoint.store(keyframe, &computed)?;
        Ok(computed)
    }

    /// Removes the checkpoint of a complete run.
    ///
    /// # Errors
    /// When the folder cannot be removed.
    pub fn finish(self) -> Result<(), CheckpointError> {
        let path = self.folder;
        std::fs::remove_dir_all(&path).map_err(|source| CheckpointError::Folder { path, source })
    }
}

/// FNV-1a of 64 bits. Detects damage, not tampering.
pub(crate) fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |sum, byte| {
        (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The first line that differs between two descriptions.
fn difference(found: &str, asked: &str) -> Option<String> {
    if found == asked {
        return None;
    }
    let (mut before, mut now) = (found.lines(), asked.lines());
    loop {
        match (before.next(), now.next()) {
            (Some(a), Some(b)) if a == b => {}
            (None, None) => return Some("line endings".to_owned()),
            (a, b) => {
                let text = |line: Option<&str>| line.unwrap_or("nothing").to_owned();
                return Some(format!("then \"{}\", now \"{}\"", text(a), text(b)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stored_values_are_loaded_until_the_run_is_complete() {
        let folder = tempfile::tempdir().unwrap();
        let begun = Checkpoint::open(folder.path(), "a\nb\n", false).unwrap();
        // Values that need every bit, and one that JSON cannot hold.
        let kept = vec![0.1 + 0.2, f64::MIN_POSITIVE, -0.0, f64::INFINITY];
        begun.store(3, &kept).unwrap();
        let resumed = Checkpoint::open(folder.path(), "a\nb\n", true).unwrap();
        let back: Vec<f64> = resumed.load(3).unwrap();
        assert!(
            kept.iter()
                .zip(&back)
                .all(|(a, b)| a.to_bits() == b.to_bits())
        );
        assert_eq!(resumed.load::<Vec<f64>>(4), None);
        let made = Checkpoint::load_or(Some(&resumed), 4, || Ok::<_, WriteError>(vec![1.5]));
        assert_eq!(resumed.load(4), made.ok());
        resumed.finish().unwrap();
        assert!(!folder.path().join(FOLDER).exists());
        let error = Checkpoint::open(folder.path(), "a\nb\n", true).unwrap_err();
        assert!(matches!(error, CheckpointError::Nothing { .. }));
    }

    #[test]
    fn another_run_is_rejected_and_a_new_one_starts_empty() {
        let folder = tempfile::tempdir().unwrap();
        Checkpoint::open(folder.path(), "every 2\n", false)
            .unwrap()
            .store(0, &"old")
            .unwrap();
        let error = Checkpoint::open(folder.path(), "every 3\n", true).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("then \"every 2\", now \"every 3\""),
            "{error}"
        );
        let anew = Checkpoint::open(folder.path(), "every 3\n", false).unwrap();
        assert_eq!(anew.load::<String>(0), None);
    }

    #[test]
    fn damaged_files_count_as_missing() {
        let folder = tempfile::tempdir().unwrap();
        let run = Checkpoint::open(folder.path(), "", false).unwrap();
        run.store(0, &vec![7_u32; 4]).unwrap();
        let path = run.path(0);
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[2] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
        std::fs::write(&path, b"cut").unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
        // Undamaged, but of another type.
        run.store(0, &"text").unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
    }
}
