//! Atomic writing of files, and reading of regular files.

use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::{Path, PathBuf};

/// Why a file could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source} (check that the folder exists, is writable and has space left)", path.display())]
pub struct WriteError {
    /// The file.
    pub path: PathBuf,
    /// Error of the operating system.
    pub source: std::io::Error,
}

/// Opens a file for reading. Pipes and devices may never end, and are refused.
///
/// # Errors
/// When it cannot be opened, or is a pipe or a device.
pub fn open_regular(path: &Path) -> std::io::Result<File> {
    let found = std::fs::metadata(path)?;
    match found.is_file() || found.is_dir() {
        true => File::open(path),
        false => Err(std::io::Error::other(
            "not a regular file: a pipe or a device may have no end",
        )),
    }
}

/// The bytes of a regular file.
///
/// # Errors
/// As [`open_regular`], and when it cannot be read.
pub fn read_regular(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut file = open_regular(path)?;
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Prefix of the names of unfinished files.
const UNFINISHED: &str = ".linecarve-unfinished-";

/// Writes a temporary file beside `path` and renames it, so that readers see either the old or the complete new file, also after a power
/// failure.
///
/// # Errors
/// When the folder does not exist or is not writable, or the disk is full. An existing file at `path` is unchanged.
pub fn write_atomically(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), WriteError> {
    write_renamed(path, true, fill)
}

/// As [`write_atomically`], but after a power failure the file may be damaged: for many files that are written again then. To wait for
/// the disk for each takes as long as a tenth of a keyframe, or more.
///
/// # Errors
/// As [`write_atomically`].
pub fn write_unsynced(
    path: &Path,
    fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), WriteError> {
    write_renamed(path, false, fill)
}

fn write_renamed(
    path: &Path,
    is_synced: bool,
    fill: impl FnOnce(&mut dyn Write) -> std::io::Result<()>,
) -> Result<(), WriteError> {
    let attempt = || -> std::io::Result<()> {
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let mut file = tempfile::Builder::new()
            .prefix(UNFINISHED)
            .tempfile_in(folder)?;
        {
            let mut buffered = BufWriter::new(file.as_file_mut());
            fill(&mut buffered)?;
            buffered.flush()?;
        }
        set_usual_permissions(file.as_file())?;
        if is_synced {
            // The content before the name.
            file.as_file().sync_all()?;
        }
        file.persist(path).map_err(|failure| failure.error)?;
        match is_synced {
            true => sync_folder(folder),
            false => Ok(()),
        }
    };
    attempt().map_err(|source| WriteError {
        path: path.to_owned(),
        source,
    })
}

/// Makes new names in a folder outlast a power failure, where the system can.
#[cfg(unix)]
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    // A folder that may be written to and not read, and file systems that do not know this, have no such promise.
    let Ok(folder) = File::open(folder) else {
        return Ok(());
    };
    match folder.sync_all() {
        Err(error) if error.kind() == std::io::ErrorKind::InvalidInput => Ok(()),
        outcome => outcome,
    }
}

#[cfg(not(unix))]
fn sync_folder(_folder: &Path) -> std::io::Result<()> {
    Ok(())
}

/// Whether a file name is that of an unfinished file of [`write_atomically`].
pub fn is_unfinished(name: &str) -> bool {
    name.starts_with(UNFINISHED)
}

/// Removes the unfinished files in a folder that a killed process left in [`write_atomically`], including those that
/// a running process is writing.
///
/// # Errors
/// When the folder cannot be read or a file cannot be removed.
pub fn remove_unfinished(folder: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if is_unfinished(&entry.file_name().to_string_lossy()) {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Temporary files are private to their owner; results are readable by all.
#[cfg(unix)]
fn set_usual_permissions(file: &File) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    file.set_permissions(std::fs::Permissions::from_mode(0o644))
}

#[cfg(not(unix))]
fn set_usual_permissions(_file: &File) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_beside_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.obj");
        std::fs::write(&path, "old").unwrap();
        let outcome = write_atomically(&path, |out| {
            out.write_all(b"half")?;
            Err(std::io::Error::other("disk full"))
        });
        assert!(outcome.unwrap_err().to_string().contains("mesh.obj"));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn what_may_have_no_end_is_not_read() {
        let error = read_regular(Path::new("/dev/zero")).unwrap_err();
        assert!(error.to_string().contains("a device"), "{error}");
    }

    #[test]
    fn a_write_replaces_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mesh.obj");
        write_atomically(&path, |out| out.write_all(b"one")).unwrap();
        write_atomically(&path, |out| out.write_all(b"two")).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two");
    }
}
