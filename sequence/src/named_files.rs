//! Files that a file of the recording names, maybe as they were called on another machine.

use std::cell::RefCell;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Entries of a folder, by their names in lower case; the first of those that differ by case only.
type Listing = HashMap<String, String>;

/// The files of a folder, which others name by paths. Folders are listed once.
pub(super) struct NamedFiles<'a> {
    folder: &'a Path,
    extensions: &'static [&'static str],
    listed: RefCell<HashMap<PathBuf, Listing>>,
}

/// A file that was found.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct NamedFile {
    pub(super) path: PathBuf,
    /// Whether a part of its path was left out, so that other names may lead to the same file.
    pub(super) is_shortened: bool,
}

impl<'a> NamedFiles<'a> {
    /// Files of a folder whose names may lack one of some extensions.
    pub(super) fn new(folder: &'a Path, extensions: &'static [&'static str]) -> Self {
        Self {
            folder,
            extensions,
            listed: RefCell::default(),
        }
    }

    /// The file of a name: as it stands there, else the longest end of its path that leads to a file in the folder, in upper or lower case.
    /// `\` counts as `/`.
    pub(super) fn find(&self, name: &str) -> Option<NamedFile> {
        let name = name.replace('\\', "/");
        let as_named = self.folder.join(&name);
        if as_named.is_file() {
            return Some(NamedFile {
                path: as_named,
                is_shortened: false,
            });
        }
        let parts: Vec<&str> = name
            .split('/')
            .filter(|part| !part.is_empty() && *part != ".")
            .collect();
        (0..parts.len()).find_map(|from| {
            let path = self.inside(&parts[from..])?;
            Some(NamedFile {
                path,
                is_shortened: from > 0,
            })
        })
    }

    /// A file below the folder.
    fn inside(&self, parts: &[&str]) -> Option<PathBuf> {
        let (file, folders) = parts.split_last()?;
        if parts.contains(&"..") {
            return None;
        }
        let mut path = self.folder.to_owned();
        for part in folders {
            path = self.entry(&path, part)?;
        }
        let with_extension = |extension: &&str| self.entry(&path, &format!("{file}.{extension}"));
        self.entry(&path, file)
            .filter(|path| path.is_file())
            .or_else(|| self.extensions.iter().find_map(with_extension))
    }

    /// An entry of a folder by its name, or that in another case.
    fn entry(&self, folder: &Path, name: &str) -> Option<PathBuf> {
        let as_named = folder.join(name);
        if as_named.exists() {
            return Some(as_named);
        }
        let mut listed = self.listed.borrow_mut();
        let listing = listed
            .entry(folder.to_owned())
            .or_insert_with(|| listing(folder));
        Some(folder.join(listing.get(&name.to_lowercase())?))
    }
}

fn listing(folder: &Path) -> Listing {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.file_name().into_string().ok())
        .collect();
    names.sort_unstable_by(|a, b| b.cmp(a));
    names
        .into_iter()
        .map(|name| (name.to_lowercase(), name))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_machines_lead_to_files_of_the_folder() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("images")).unwrap();
        for name in ["images/a.PNG", "images/b.jpg", "c.png"] {
            std::fs::write(folder.path().join(name), name).unwrap();
        }
        let files = NamedFiles::new(folder.path(), &["png", "jpg"]);
        let found = |name: &str| {
            let file = files.find(name)?;
            let path = file.path.strip_prefix(folder.path()).unwrap().to_owned();
            Some((path.to_str().unwrap().to_owned(), file.is_shortened))
        };
        for (name, expected) in [
            ("images/b.jpg", Some(("images/b.jpg", false))),
            ("./images/b", Some(("images/b.jpg", false))),
            ("Images\\A.png", Some(("images/a.PNG", false))),
            ("/scans/room/images/b.jpg", Some(("images/b.jpg", true))),
            ("../room/images/a.png", Some(("images/a.PNG", true))),
            ("C:\\room\\c", Some(("c.png", true))),
            ("/scans/images/d.png", None),
            ("images", None),
            ("..", None),
            ("", None),
        ] {
            let expected = expected.map(|(path, is_shortened)| (path.to_owned(), is_shortened));
            assert_eq!(found(name), expected, "{name}");
        }
    }
}
