//! Checkpoint of a run: keyframes stored so that the run can be resumed.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use serde::Serialize;
use serde::de::DeserializeOwned;

use linecarve_mesh::files::{WriteError, is_unfinished, write_atomically, write_unsynced};

use super::RunDescription;

/// Folder inside the output folder.
pub const FOLDER: &str = ".linecarve";

/// File with the description of the run.
const RUN: &str = "run.txt";

/// Ending of the files of keyframes.
const ENDING: &str = ".keyframe";

/// Length of the end of such a file, in bytes.
const TRAILER: usize = 24;

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
    /// The folder is a link to another folder.
    #[error("{} is a symbolic link: remove it, or give another output folder", .0.display())]
    Link(PathBuf),
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
    /// Digest of the description of the run, which each file has.
    run: u64,
    /// Keyframes that were read from the files of an interrupted run.
    reused: Arc<AtomicUsize>,
}

impl Checkpoint {
    /// Creates a checkpoint, or opens one to resume. A run is resumed only when its description is equal and its files have not changed.
    ///
    /// # Errors
    /// When there is no checkpoint to resume, it belongs to another run, or the folder is not writable.
    pub fn open(
        output: &Path,
        description: &RunDescription,
        resume: bool,
    ) -> Result<Self, CheckpointError> {
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
            if let Some(difference) = description.difference(&found) {
                return Err(CheckpointError::Different {
                    folder: output.to_owned(),
                    difference,
                });
            }
            return Ok(Self::new(folder, &description.text));
        }
        clear(&folder)?;
        std::fs::create_dir_all(&folder).map_err(failed(&folder))?;
        let text = description.written();
        write_atomically(&run, |out| out.write_all(text.as_bytes()))?;
        Ok(Self::new(folder, &description.text))
    }

    /// The checkpoint of an output folder, whatever run it belongs to.
    pub(crate) fn of(output: &Path) -> Self {
        let folder = output.join(FOLDER);
        let written = std::fs::read(folder.join(RUN)).unwrap_or_default();
        let text = RunDescription::text_of(&String::from_utf8_lossy(&written));
        Self::new(folder, &text)
    }

    fn new(folder: PathBuf, description: &str) -> Self {
        Self {
            folder,
            run: checksum(description.as_bytes()),
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
        self.folder.join(format!("{keyframe:06}{ENDING}"))
    }

    /// Loads a stored value; `None` when it is missing, damaged, or that of another keyframe or run.
    pub fn load<T: DeserializeOwned>(&self, keyframe: usize) -> Option<T> {
        let bytes = self.read(keyframe)?;
        rmp_serde::from_slice(&bytes).ok()
    }

    fn read(&self, keyframe: usize) -> Option<Vec<u8>> {
        let mut bytes = std::fs::read(self.path(keyframe)).ok()?;
        let at = bytes.len().checked_sub(TRAILER)?;
        let trailer = self.trailer(keyframe, &bytes[..at]);
        let is_own = bytes[at..] == trailer;
        bytes.truncate(at);
        is_own.then_some(bytes)
    }

    /// The end of a file: which keyframe of which run it is, and a checksum.
    fn trailer(&self, keyframe: usize, bytes: &[u8]) -> [u8; TRAILER] {
        let mut trailer = [0; TRAILER];
        let numbers = [keyframe as u64, self.run, checksum(bytes)];
        for (place, number) in trailer.chunks_exact_mut(8).zip(numbers) {
            place.copy_from_slice(&number.to_le_bytes());
        }
        trailer
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
        // A file that a power failure damages is recognised, and counts as missing.
        write_unsynced(&self.path(keyframe), |out| {
            let bytes = rmp_serde::to_vec(value).map_err(std::io::Error::other)?;
            out.write_all(&bytes)?;
            out.write_all(&self.trailer(keyframe, &bytes))
        })
    }

    /// Loads the value of a keyframe, or computes and stores it. Without a checkpoint it is always computed.
    ///
    /// # Errors
    /// When `compute` fails, or the file cannot be written.
    pub(crate) fn load_or<T, E>(
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
    /// When a file of it cannot be removed.
    pub fn finish(self) -> Result<(), CheckpointError> {
        clear(&self.folder)
    }
}

/// Removes the files of a checkpoint, and the folder when nothing else is in it.
fn clear(folder: &Path) -> Result<(), CheckpointError> {
    let failed = |path: &Path| {
        let path = path.to_owned();
        move |source| CheckpointError::Folder { path, source }
    };
    match folder.symlink_metadata() {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(error) => return Err(failed(folder)(error)),
        Ok(found) if found.is_symlink() => return Err(CheckpointError::Link(folder.to_owned())),
        Ok(_) => {}
    }
    let mut is_empty = true;
    for entry in std::fs::read_dir(folder).map_err(failed(folder))? {
        let path = entry.map_err(failed(folder))?.path();
        let is_file = path.symlink_metadata().is_ok_and(|found| found.is_file());
        if is_file && is_own_name(&path) {
            std::fs::remove_file(&path).map_err(failed(&path))?;
        } else {
            is_empty = false;
        }
    }
    match is_empty {
        true => std::fs::remove_dir(folder).map_err(failed(folder)),
        false => Ok(()),
    }
}

/// Whether a file is named as this module names its files.
fn is_own_name(path: &Path) -> bool {
    let name = path
        .file_name()
        .and_then(|name| name.to_str())
        .unwrap_or_default();
    let number = name.strip_suffix(ENDING);
    name == RUN
        || is_unfinished(name)
        || number.is_some_and(|number| {
            number.len() >= 6 && number.bytes().all(|byte| byte.is_ascii_digit())
        })
}

/// FNV-1a of 64 bits. Detects damage, not tampering.
pub(crate) fn checksum(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |sum, byte| {
        (sum ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn described(text: &str) -> RunDescription {
        RunDescription {
            text: text.to_owned(),
            files: Vec::new(),
        }
    }

    #[test]
    fn stored_values_are_loaded_until_the_run_is_complete() {
        let folder = tempfile::tempdir().unwrap();
        let begun = Checkpoint::open(folder.path(), &described("a\nb\n"), false).unwrap();
        // Values that need every bit, and one that JSON cannot hold.
        let kept = vec![0.1 + 0.2, f64::MIN_POSITIVE, -0.0, f64::INFINITY];
        begun.store(3, &kept).unwrap();
        let resumed = Checkpoint::open(folder.path(), &described("a\nb\n"), true).unwrap();
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
        let error = Checkpoint::open(folder.path(), &described("a\nb\n"), true).unwrap_err();
        assert!(matches!(error, CheckpointError::Nothing { .. }));
    }

    #[test]
    fn another_run_is_rejected_and_a_new_one_starts_empty() {
        let folder = tempfile::tempdir().unwrap();
        Checkpoint::open(folder.path(), &described("every 2\n"), false)
            .unwrap()
            .store(0, &"old")
            .unwrap();
        let error = Checkpoint::open(folder.path(), &described("every 3\n"), true).unwrap_err();
        assert!(
            error
                .to_string()
                .contains("then \"every 2\", now \"every 3\""),
            "{error}"
        );
        let anew = Checkpoint::open(folder.path(), &described("every 3\n"), false).unwrap();
        assert_eq!(anew.load::<String>(0), None);
    }

    #[test]
    fn damaged_files_count_as_missing() {
        let folder = tempfile::tempdir().unwrap();
        let run = Checkpoint::open(folder.path(), &described(""), false).unwrap();
        run.store(0, &vec![7_u32; 4]).unwrap();
        let path = run.path(0);
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[2] ^= 1;
        std::fs::write(&path, &bytes).unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
        std::fs::write(&path, b"cut").unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
        // Undamaged, but of another keyframe.
        run.store(0, &vec![7_u32; 4]).unwrap();
        std::fs::copy(&path, run.path(1)).unwrap();
        assert_eq!(run.load::<Vec<u32>>(1), None);
        assert_eq!(run.stored(0..2), [0]);
        // Of another run.
        let other = Checkpoint::open(folder.path(), &described("other\n"), false).unwrap();
        other.store(0, &vec![7_u32; 4]).unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
        // Undamaged, but of another type.
        run.store(0, &"text").unwrap();
        assert_eq!(run.load::<Vec<u32>>(0), None);
    }

    #[test]
    fn files_of_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let run = Checkpoint::open(folder.path(), &described(""), false).unwrap();
        run.store(0, &1_u32).unwrap();
        let inside = folder.path().join(FOLDER);
        for name in ["notes.txt", "1.keyframe"] {
            std::fs::write(inside.join(name), "mine").unwrap();
        }
        std::fs::write(inside.join(".linecarve-unfinished-ab"), "half").unwrap();
        run.finish().unwrap();
        let mut left: Vec<_> = std::fs::read_dir(&inside)
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        left.sort();
        assert_eq!(left, ["1.keyframe", "notes.txt"]);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_not_followed() {
        let [folder, other] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        std::fs::write(other.path().join(RUN), "mine").unwrap();
        std::os::unix::fs::symlink(other.path(), folder.path().join(FOLDER)).unwrap();
        let error = Checkpoint::open(folder.path(), &described(""), false).unwrap_err();
        assert!(matches!(error, CheckpointError::Link(_)), "{error}");
        assert!(other.path().join(RUN).exists());
    }
}
