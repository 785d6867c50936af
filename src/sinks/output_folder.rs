//! The folder that results go to: only what this program wrote there is replaced or removed.
//!
//! A list in the folder names what was written. A folder that holds anything else, and no list, is refused. The list is locked while a run
//! writes, so that two runs do not write to one folder.

mod stale;

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use linecarve_mesh::files::remove_unfinished;
use stale::remove_numbered;

/// Name of the list.
pub(super) const LIST: &str = linecarve_sequence::RESULTS_FILE;
/// First line of the list.
const LIST_HEAD: &str = "# Written here by linecarve, which replaces and removes nothing else.\n";
/// Longest list that is read, in bytes.
const MOST_LISTED: u64 = 1 << 24;
/// Endings of numbered files, which the list does not name one by one.
const NUMBERED: [&str; 3] = ["glb", "delta", "jpg"];
/// Endings of images of recordings.
const IMAGES: [&str; 7] = ["png", "jpg", "jpeg", "ppm", "pgm", "tif", "tiff"];

/// Why a folder or file is not written to.
#[derive(Debug, thiserror::Error)]
pub(crate) enum OutputError {
    /// The folder holds files of another origin.
    #[error(
        "the output folder {} holds files that linecarve did not write ({name}): give a new or an empty folder with --out, such as {}",
        folder.display(), folder.join("out").display()
    )]
    Foreign {
        /// The folder.
        folder: PathBuf,
        /// One of the files.
        name: String,
    },
    /// The folder is the input, holds it, or lies among its images.
    #[error(
        "the output folder {} {relation} {}, whose files are not to be changed: give another folder with --out",
        folder.display(), input.display()
    )]
    Input {
        /// The folder.
        folder: PathBuf,
        /// How the two lie to each other.
        relation: &'static str,
        /// What is read.
        input: PathBuf,
    },
    /// Another run writes to the folder.
    #[error(
        "another run of linecarve writes to {}: wait until it has ended, or give another folder with --out",
        .0.display()
    )]
    Busy(PathBuf),
    /// A file or folder inside is of another origin.
    #[error("linecarve did not write {}: move it away, or give another folder with --out", .0.display())]
    ForeignFile(PathBuf),
    /// The folder or a file in it cannot be used.
    #[error(
        "cannot write to the output folder {}: {source} (choose another with --out, or make it writable)",
        folder.display()
    )]
    Unusable {
        /// The folder.
        folder: PathBuf,
        /// Error of the operating system.
        source: std::io::Error,
    },
}

/// A folder that results go to, and the names of the files that went there.
pub(crate) struct OutputFolder {
    root: PathBuf,
    /// Open and locked as long as the run.
    list: File,
    /// What the list names; folders end in `/`, and their numbered files are not named.
    listed: BTreeSet<String>,
    /// Folders inside that this run uses, as the list names them.
    used: BTreeSet<String>,
    written: Vec<String>,
}

impl OutputFolder {
    /// Makes the folder when it is missing, and proves that it may be written to and can be, before any work is spent. `inputs` are
    /// what the run reads.
    ///
    /// # Errors
    /// When the folder holds files of another origin, is, holds or lies among the inputs, is in use by another run, or is not writable.
    pub(crate) fn create(root: &Path, inputs: &[&Path]) -> Result<Self, OutputError> {
        for input in inputs {
            keep_apart(root, input)?;
        }
        let failed = |source| OutputError::Unusable {
            folder: root.to_owned(),
            source,
        };
        std::fs::create_dir_all(root).map_err(failed)?;
        let path = root.join(LIST);
        let found = path.symlink_metadata();
        if found.as_ref().is_ok_and(|found| !found.is_file()) {
            return Err(OutputError::ForeignFile(path));
        }
        if found.is_err()
            && let Some(name) = foreign_entry(root).map_err(failed)?
        {
            let folder = root.to_owned();
            return Err(OutputError::Foreign { folder, name });
        }
        let mut list = lock_folder(root)?;
        let mut text = Vec::new();
        (&list)
            .take(MOST_LISTED)
            .read_to_end(&mut text)
            .map_err(failed)?;
        let text = String::from_utf8_lossy(&text);
        let lines = text.lines().filter(|line| !line.starts_with('#'));
        let mut listed = BTreeSet::new();
        for line in lines {
            match line.strip_prefix('-') {
                Some(removed) => listed.remove(removed),
                None => listed.insert(line.to_owned()),
            };
        }
        if text.is_empty() {
            let begun = list.write_all(LIST_HEAD.as_bytes());
            begun.and_then(|()| list.sync_all()).map_err(failed)?;
        }
        remove_unfinished(root).map_err(failed)?;
        Ok(Self {
            root: root.to_owned(),
            list,
            listed,
            used: BTreeSet::new(),
            written: Vec::new(),
        })
    }

    fn failed(&self) -> impl Fn(std::io::Error) -> OutputError + use<> {
        let folder = self.root.clone();
        move |source| OutputError::Unusable {
            folder: folder.clone(),
            source,
        }
    }

    /// Puts a name on the list before anything of that name is made.
    fn list(&mut self, name: &str) -> Result<(), OutputError> {
        let failed = self.failed();
        let line = format!("{name}\n");
        let written = self.list.write_all(line.as_bytes());
        written
            .and_then(|()| self.list.sync_data())
            .map_err(failed)?;
        self.listed.insert(name.to_owned());
        Ok(())
    }

    /// A folder inside for files that only this program writes, made when it is missing.
    ///
    /// # Errors
    /// When there is one of that name that this program did not make, or it cannot be made.
    pub(crate) fn subfolder(&mut self, name: &str) -> Result<PathBuf, OutputError> {
        let path = self.root.join(name);
        let failed = self.failed();
        let entry = format!("{name}/");
        let is_listed = self.listed.contains(&entry);
        match path.symlink_metadata() {
            // A link leads to a folder of another origin.
            Ok(found) if !found.is_dir() => return Err(OutputError::ForeignFile(path)),
            Ok(_) if !is_listed => {
                if let Some(inside) = foreign_entry(&path).map_err(&failed)? {
                    return Err(OutputError::ForeignFile(path.join(inside)));
                }
            }
            _ => {}
        }
        if !is_listed {
            self.list(&entry)?;
        }
        self.used.insert(entry);
        std::fs::create_dir_all(&path).map_err(&failed)?;
        remove_unfinished(&path).map_err(failed)?;
        Ok(path)
    }

    /// A folder inside for numbered files with these endings, those of an earlier run removed: a shorter run would leave a mixture.
    ///
    /// # Errors
    /// As [`subfolder`](Self::subfolder).
    pub(crate) fn numbered(
        &mut self,
        name: &str,
        endings: &[&str],
    ) -> Result<PathBuf, OutputError> {
        let path = self.subfolder(name)?;
        let failed = self.failed();
        remove_numbered(&path, endings).map_err(failed)?;
        Ok(path)
    }

    /// The path of a file that is about to be written; `name` is remembered.
    ///
    /// # Errors
    /// When there is a file of that name that this program did not write.
    pub(crate) fn file(&mut self, name: &str) -> Result<PathBuf, OutputError> {
        let path = self.root.join(name);
        let folder = name.split_inclusive('/').next().unwrap_or_default();
        let is_in_folder = self.listed.contains(folder) && folder != name;
        let is_known = is_in_folder && is_numbered(&path, &NUMBERED);
        if !is_known && !self.listed.contains(name) {
            if !is_in_folder && path.symlink_metadata().is_ok() {
                return Err(OutputError::ForeignFile(path));
            }
            self.list(name)?;
        }
        self.written.push(name.to_owned());
        Ok(path)
    }

    /// Removes a file of an earlier run, when this program wrote it.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub(crate) fn remove(&self, name: &str) -> Result<(), OutputError> {
        if !self.listed.contains(name) {
            return Ok(());
        }
        match std::fs::remove_file(self.root.join(name)) {
            Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(self.failed()(error)),
            _ => Ok(()),
        }
    }

    /// The folder itself.
    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    /// Names of the files so far, in the order of writing.
    pub(crate) fn written(&self) -> &[String] {
        &self.written
    }
}

/// Opens the list of a folder, which is made when missing, and locks it until it is closed.
///
/// # Errors
/// When another run has locked it, or it cannot be opened.
pub(crate) fn lock_folder(folder: &Path) -> Result<File, OutputError> {
    let mut options = OpenOptions::new();
    let options = options.read(true).append(true).create(true);
    let list = options.open(folder.join(LIST));
    let list = list.map_err(|source| OutputError::Unusable {
        folder: folder.to_owned(),
        source,
    })?;
    match list.try_lock() {
        Err(TryLockError::WouldBlock) => Err(OutputError::Busy(folder.to_owned())),
        // Some network file systems have no locks.
        Err(TryLockError::Error(_)) | Ok(()) => Ok(list),
    }
}

/// Refuses an output folder that is the input or holds it, or that lies among the images of the input.
///
/// # Errors
/// When it does.
pub(crate) fn keep_apart(root: &Path, input: &Path) -> Result<(), OutputError> {
    // An input that is not there is reported by what opens it, and a folder that is not there holds nothing.
    let Ok(real_input) = input.canonicalize() else {
        return Ok(());
    };
    let refused = |relation| {
        Err(OutputError::Input {
            folder: root.to_owned(),
            relation,
            input: input.to_owned(),
        })
    };
    let nearest = std::path::absolute(root).ok().and_then(|path| {
        let there = path.ancestors().find(|folder| folder.is_dir())?;
        Some((there.canonicalize().ok()?, there == path))
    });
    let Some((nearest, is_there)) = nearest else {
        return Ok(());
    };
    if is_there && nearest == real_input {
        return refused("is the input");
    }
    if is_there && real_input.starts_with(&nearest) {
        return refused("holds the input");
    }
    let inside = nearest.ancestors();
    let mut inside = inside.take_while(|folder| *folder != real_input);
    if nearest.starts_with(&real_input) && inside.any(holds_images) {
        return refused("lies among the images of");
    }
    Ok(())
}

fn holds_images(folder: &Path) -> bool {
    std::fs::read_dir(folder).is_ok_and(|entries| {
        entries.flatten().any(|entry| {
            let path = entry.path();
            let ending = path.extension().and_then(|ending| ending.to_str());
            ending.is_some_and(|ending| IMAGES.contains(&ending.to_lowercase().as_str()))
        })
    })
}

/// The first name, in the order of the alphabet, of anything in a folder that is not hidden or an empty one's.
fn foreign_entry(folder: &Path) -> std::io::Result<Option<String>> {
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder)? {
        let name = entry?.file_name().to_string_lossy().into_owned();
        // The root of a file system has the latter.
        if !name.starts_with('.') && name != "lost+found" {
            names.push(name);
        }
    }
    Ok(names.into_iter().min())
}

/// Whether the name of a file is at least six digits and one of the endings, as this program writes them.
fn is_numbered(path: &Path, endings: &[&str]) -> bool {
    let part = |part: Option<&std::ffi::OsStr>| part.and_then(|it| it.to_str().map(str::to_owned));
    let ending = part(path.extension()).unwrap_or_default();
    let stem = part(path.file_stem()).unwrap_or_default();
    endings.contains(&ending.as_str())
        && stem.len() >= 6
        && stem.bytes().all(|byte| byte.is_ascii_digit())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GROWTH: [&str; 2] = ["glb", "delta"];

    fn message<T>(result: Result<T, OutputError>) -> String {
        result.err().expect("it is refused").to_string()
    }

    #[test]
    fn numbered_files_of_an_earlier_run_go_and_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("out");
        let mut output = OutputFolder::create(&root, &[]).unwrap();
        let inside = output.numbered("keyframes", &GROWTH).unwrap();
        let unfinished = ".linecarve-unfinished-aB3";
        for name in [
            "000041.glb",
            "000041.delta",
            "notes.txt",
            "1.glb",
            unfinished,
        ] {
            std::fs::write(inside.join(name), "old").unwrap();
        }
        drop(output);
        let mut output = OutputFolder::create(&root, &[]).unwrap();
        output.numbered("keyframes", &GROWTH).unwrap();
        for name in ["000041.glb", "000041.delta", unfinished] {
            assert!(!inside.join(name).exists(), "{name}");
        }
        assert!(inside.join("notes.txt").exists() && inside.join("1.glb").exists());
    }

    #[test]
    fn nothing_that_others_wrote_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("out");
        let mut output = OutputFolder::create(&root, &[]).unwrap();
        let mesh = output.file("mesh.ply").unwrap();
        std::fs::write(&mesh, "ours").unwrap();
        drop(output);
        std::fs::write(root.join("mesh.obj"), "mine").unwrap();
        std::fs::write(root.join("notes.txt"), "mine").unwrap();
        std::fs::create_dir(root.join("images")).unwrap();
        std::fs::write(root.join("images/000999.jpg"), "mine").unwrap();

        let mut output = OutputFolder::create(&root, &[]).unwrap();
        assert_eq!(output.file("mesh.ply").unwrap(), mesh);
        assert!(message(output.file("mesh.obj")).contains("mesh.obj: move it away"));
        let refused = message(output.numbered("images", &["jpg"]));
        assert!(refused.contains("000999.jpg"), "{refused}");
        output.remove("notes.txt").unwrap();
        output.remove("mesh.ply").unwrap();
        assert!(root.join("notes.txt").exists() && !mesh.exists());
        assert_eq!(output.written(), ["mesh.ply"]);
    }

    #[test]
    #[cfg(unix)]
    fn links_are_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let [root, other] = ["out", "other"].map(|name| folder.path().join(name));
        std::fs::create_dir(&other).unwrap();
        std::fs::write(other.join("000001.glb"), "mine").unwrap();
        let mut output = OutputFolder::create(&root, &[]).unwrap();
        output.numbered("keyframes", &GROWTH).unwrap();
        std::fs::remove_dir(root.join("keyframes")).unwrap();
        std::os::unix::fs::symlink(&other, root.join("keyframes")).unwrap();
        assert!(message(output.numbered("keyframes", &GROWTH)).contains("keyframes"));
        std::os::unix::fs::symlink(other.join("000001.glb"), root.join("mesh.glb")).unwrap();
        assert!(message(output.file("mesh.glb")).contains("mesh.glb"));
        assert!(other.join("000001.glb").exists());
    }

    #[test]
    fn folders_of_others_and_of_the_input_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("sequence/rgb")).unwrap();
        std::fs::write(at("sequence/rgb/1.png"), "image").unwrap();
        let sequence = at("sequence");
        let refused =
            |root: &Path, input: &Path| message(OutputFolder::create(root, &[input]).map(drop));
        for (root, expected) in [
            (at("sequence"), "is the input"),
            (folder.path().to_owned(), "holds the input"),
            (at("sequence/rgb"), "lies among the images"),
            (at("sequence/rgb/out"), "lies among the images"),
        ] {
            let text = refused(&root, &sequence);
            assert!(text.contains(expected) && text.contains("--out"), "{text}");
        }
        assert!(!at("sequence/rgb/out").exists());
        // Without knowing of the input.
        let text = message(OutputFolder::create(&sequence, &[]).map(drop));
        assert!(
            text.contains("(rgb)") && text.contains("sequence/out"),
            "{text}"
        );
        OutputFolder::create(&at("sequence/out"), &[&sequence]).unwrap();
    }

    #[test]
    fn two_runs_do_not_write_to_one_folder() {
        let folder = tempfile::tempdir().unwrap();
        let first = OutputFolder::create(folder.path(), &[]).unwrap();
        let refused = message(OutputFolder::create(folder.path(), &[]).map(drop));
        assert!(refused.contains("another run of linecarve"), "{refused}");
        drop(first);
        OutputFolder::create(folder.path(), &[]).unwrap();
    }
}
