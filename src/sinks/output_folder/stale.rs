//! What earlier runs left in an output folder, and the inputs that lie there.

use std::collections::BTreeSet;
use std::io::{ErrorKind, Write};
use std::path::Path;

use super::{NUMBERED, OutputError, OutputFolder, is_numbered};

impl OutputFolder {
    /// Refuses inputs that this program wrote here: the run could replace or remove them.
    ///
    /// # Errors
    /// When an input is one of the files of an earlier run.
    pub(crate) fn keep_inputs<'a>(
        &self,
        inputs: impl IntoIterator<Item = &'a Path>,
    ) -> Result<(), OutputError> {
        let Ok(root) = self.root.canonicalize() else {
            return Ok(());
        };
        let is_own = |input: &&Path| {
            let real = input.canonicalize().ok();
            let inside = real
                .as_deref()
                .and_then(|real| real.strip_prefix(&root).ok());
            let name = inside.and_then(Path::to_str).unwrap_or_default();
            let folder = name.split_inclusive('/').next().unwrap_or_default();
            self.listed.contains(name) || self.listed.contains(folder)
        };
        match inputs.into_iter().find(is_own) {
            Some(input) => Err(OutputError::Input {
                folder: self.root.clone(),
                relation: "holds the input",
                input: input.to_owned(),
            }),
            None => Ok(()),
        }
    }

    /// Removes the results of earlier runs that this run did not write, at its end: beside the new ones they would look like its own. What
    /// the list does not name stays.
    ///
    /// # Errors
    /// When a file cannot be removed.
    pub(crate) fn remove_stale(&mut self) -> Result<(), OutputError> {
        let written: BTreeSet<&str> = self.written.iter().map(String::as_str).collect();
        let is_stale =
            |name: &&String| !written.contains(name.as_str()) && !self.used.contains(*name);
        let stale = self.listed.iter().filter(is_stale).cloned();
        let stale: Vec<String> = stale.collect();
        // The files of a folder come before the folder.
        for name in stale.iter().rev() {
            let is_gone = self.remove_listed(name).map_err(self.failed())?;
            if is_gone {
                self.unlist(name)?;
            }
        }
        Ok(())
    }

    /// Removes a file, or the numbered files of a folder and then the folder. Says whether nothing of this program is left of that name.
    fn remove_listed(&self, name: &str) -> std::io::Result<bool> {
        let path = self.root.join(name);
        // A link leads to files of another origin.
        let mut folders = path.ancestors().skip(1);
        let is_link = |folder: &Path| folder.symlink_metadata().is_ok_and(|it| it.is_symlink());
        let inside = folders.by_ref().take_while(|folder| *folder != self.root);
        if inside.into_iter().any(is_link) {
            return Ok(true);
        }
        let path = self.root.join(name.trim_end_matches('/'));
        let Ok(found) = path.symlink_metadata() else {
            return Ok(true);
        };
        match (name.ends_with('/'), found.is_dir()) {
            (true, true) => {
                remove_numbered(&path, &NUMBERED)?;
                // The user's files stay, and the folder with them.
                Ok(std::fs::remove_dir(&path).is_ok())
            }
            (false, false) if found.is_file() => std::fs::remove_file(&path).map(|()| true),
            _ => Ok(true),
        }
    }

    /// Takes a name off the list.
    fn unlist(&mut self, name: &str) -> Result<(), OutputError> {
        let line = format!("-{name}\n");
        let failed = self.failed();
        self.list.write_all(line.as_bytes()).map_err(failed)?;
        self.listed.remove(name);
        Ok(())
    }
}

/// Removes the numbered files in a folder that have one of these endings.
pub(super) fn remove_numbered(folder: &Path, endings: &[&str]) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)?.flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && is_numbered(&entry.path(), endings) {
            match std::fs::remove_file(entry.path()) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => {}
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(output: &mut OutputFolder, names: &[&str]) {
        for name in names {
            std::fs::write(output.file(name).unwrap(), "result").unwrap();
        }
    }

    #[test]
    fn results_of_an_earlier_run_go_and_files_of_the_user_stay() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("out");
        let at = |name: &str| root.join(name);
        let mut first = OutputFolder::create(&root, &[]).unwrap();
        first.numbered("keyframes", &["glb"]).unwrap();
        first.subfolder("lines").unwrap();
        first.subfolder("points").unwrap();
        let results = [
            "mesh.ply",
            "mesh.glb",
            "keyframes/000001.glb",
            "lines/mesh.ply",
        ];
        write(&mut first, &results);
        write(&mut first, &["points/a.ply", "points/b.ply"]);
        drop(first);
        for name in ["notes.txt", "lines/notes.txt", "keyframes/notes.glb"] {
            std::fs::write(at(name), "mine").unwrap();
        }
        let mut second = OutputFolder::create(&root, &[]).unwrap();
        second.subfolder("points").unwrap();
        write(&mut second, &["mesh.ply", "points/a.ply"]);
        second.remove_stale().unwrap();
        for name in [
            "mesh.glb",
            "keyframes/000001.glb",
            "lines/mesh.ply",
            "points/b.ply",
        ] {
            assert!(!at(name).exists(), "{name}");
        }
        for name in [
            "mesh.ply",
            "points/a.ply",
            "notes.txt",
            "lines/notes.txt",
            "keyframes/notes.glb",
        ] {
            assert!(at(name).exists(), "{name}");
        }
        drop(second);

        // A name that was taken off the list is free for the user.
        std::fs::write(at("mesh.glb"), "mine").unwrap();
        let mut third = OutputFolder::create(&root, &[]).unwrap();
        assert!(third.file("mesh.glb").is_err());
        third.remove_stale().unwrap();
        assert!(at("mesh.glb").exists() && !at("mesh.ply").exists() && !at("points").exists());
    }

    #[test]
    #[cfg(unix)]
    fn results_behind_a_link_stay() {
        let folder = tempfile::tempdir().unwrap();
        let [root, other] = ["out", "other"].map(|name| folder.path().join(name));
        let mut first = OutputFolder::create(&root, &[]).unwrap();
        first.subfolder("lines").unwrap();
        write(&mut first, &["lines/mesh.ply", "mesh.ply"]);
        drop(first);
        std::fs::rename(root.join("lines"), &other).unwrap();
        std::os::unix::fs::symlink(&other, root.join("lines")).unwrap();
        let mut second = OutputFolder::create(&root, &[]).unwrap();
        second.remove_stale().unwrap();
        assert!(other.join("mesh.ply").exists() && !root.join("mesh.ply").exists());
    }

    #[test]
    fn inputs_of_an_earlier_run_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut first = OutputFolder::create(folder.path(), &[]).unwrap();
        write(&mut first, &["poses.txt"]);
        std::fs::write(folder.path().join("mine.toml"), "").unwrap();
        let input = |name: &str| folder.path().join(name);
        assert!(first.keep_inputs([input("mine.toml").as_path()]).is_ok());
        let refused = first.keep_inputs([input("poses.txt").as_path()]);
        assert!(refused.unwrap_err().to_string().contains("holds the input"));
    }
}
