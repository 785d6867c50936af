//! A hidden folder for temporary files. It goes with the command or with a signal; that of a killed command goes with the next one.

use std::fs::File;
use std::path::Path;

use anyhow::Context;
use tempfile::TempDir;

use super::output_folder::{LIST, lock_folder};
use crate::process::on_signal;

/// How the names begin.
const PREFIX: &str = ".linecarve-work-";
/// Exit status of a program ended by Ctrl-C.
const INTERRUPTED: i32 = 130;
/// Another command may take a folder that is not locked yet for one of a killed command.
const TRIES: usize = 10;

/// A folder that is removed when this is dropped, and on a signal, which ends the program.
pub(crate) struct TemporaryFolder {
    /// Tells other commands that this one is at work.
    _lock: File,
    folder: TempDir,
}

impl TemporaryFolder {
    /// Makes a folder inside another, and removes those of commands that were killed.
    ///
    /// # Errors
    /// When it cannot be made, or signals cannot be handled.
    pub(crate) fn create(inside: &Path) -> anyhow::Result<Self> {
        remove_abandoned(inside);
        let attempt = || -> anyhow::Result<Self> {
            let folder = tempfile::Builder::new().prefix(PREFIX).tempdir_in(inside)?;
            let _lock = lock_folder(folder.path())?;
            Ok(Self { _lock, folder })
        };
        let mut made = attempt();
        for _ in 1..TRIES {
            if made.is_err() {
                made = attempt();
            }
        }
        let made = made.with_context(|| format!("{}: a temporary folder", inside.display()))?;
        let path = made.path().to_owned();
        on_signal(move || {
            remove(&path);
            std::process::exit(INTERRUPTED);
        })
        .context("cannot install the handler for Ctrl-C")?;
        Ok(made)
    }

    /// The folder.
    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// Removes a folder that other threads still write to.
fn remove(folder: &Path) {
    for _ in 0..TRIES {
        let _ = std::fs::remove_dir_all(folder);
        if !folder.exists() {
            return;
        }
    }
}

/// Removes the temporary folders of commands that were killed, which nothing locks any more.
fn remove_abandoned(inside: &Path) {
    let Ok(entries) = std::fs::read_dir(inside) else {
        return;
    };
    for entry in entries.flatten() {
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        if !is_folder || !entry.file_name().to_string_lossy().starts_with(PREFIX) {
            continue;
        }
        let folder = entry.path();
        match File::open(folder.join(LIST)) {
            // A file system without locks does not say whether the command is at work.
            Ok(list) if list.try_lock().is_ok() => remove(&folder),
            Ok(_) => {}
            // Nothing but an empty folder is removed.
            Err(_) => drop(std::fs::remove_dir(&folder)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_killed_commands_go_with_the_next_one() {
        let inside = tempfile::tempdir().unwrap();
        let at = |name: &str| inside.path().join(name);
        let running = TemporaryFolder::create(inside.path()).unwrap();
        let killed = at(".linecarve-work-killed");
        std::fs::create_dir_all(killed.join("tiles")).unwrap();
        std::fs::write(killed.join(LIST), "").unwrap();
        std::fs::create_dir(at(".linecarve-work-empty")).unwrap();
        std::fs::create_dir_all(at(".linecarve-work-mine/photos")).unwrap();
        let next = TemporaryFolder::create(inside.path()).unwrap();
        assert!(!killed.exists() && !at(".linecarve-work-empty").exists());
        assert!(running.path().exists() && next.path().exists());
        assert!(at(".linecarve-work-mine/photos").exists());
        drop((running, next));
        assert_eq!(std::fs::read_dir(inside.path()).unwrap().count(), 1);
    }
}
