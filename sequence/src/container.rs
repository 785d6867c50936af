//! Files inside of files, addressed as if the file were a folder: members of ZIP archives, and single items of stacked NumPy arrays.
//!
//! `scan.r3d/rgbd/3.jpg` is a member of an archive. `results.npz/depth.npy/3` is the fourth item along the first axis of an array in one,
//! and `depth.npy/3` of an array in a file; items are read as NPY files of their own. A path to a file that exists is that file.
//!
//! # Guarantees
//! A member takes at most [`MAX_BYTES`] of memory, whatever an archive announces, and an array no more than one item.

mod archive;
mod stack;

use std::io::{self, Read};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use linecarve_mesh::files::read_regular;

use archive::Archive;
use stack::Stack;

use super::npy::NpyHeader;

/// Most bytes of a member, and of an item of an array: 16 bytes for each of 4096 x 4096 pixels.
const MAX_BYTES: u64 = 1 << 28;

/// Most archives, and most positions in stacks, that are kept open.
const MAX_OPEN: usize = 8;

/// Files, and what lies in them. Archives stay open, and so do positions in deflated arrays, so that reading all items in
/// order inflates an array once.
#[derive(Debug, Default)]
pub(super) struct Containers {
    archives: Mutex<Vec<Archive>>,
    stacks: Mutex<Vec<Stack>>,
}

/// A path, split at the file that exists.
#[derive(Debug, PartialEq, Eq)]
enum Place<'a> {
    File,
    /// In the archive of the first path: a member.
    Member(&'a Path, String),
    /// Of the array at the first path: an item.
    Item(&'a Path, u64),
}

impl<'a> Place<'a> {
    fn of(path: &'a Path) -> Self {
        if std::fs::metadata(path).is_ok() {
            return Self::File;
        }
        if let Some((array, item)) = item_of(path) {
            return Self::Item(array, item);
        }
        let Some(file) = file_above(path) else {
            return Self::File;
        };
        match inside(path, file) {
            Some(name) => Self::Member(file, name),
            None => Self::File,
        }
    }
}

/// The array and the number in `depth.npy/3`.
fn item_of(path: &Path) -> Option<(&Path, u64)> {
    let item = path.file_name()?.to_str()?.parse().ok()?;
    let array = path.parent()?;
    (array.extension()? == "npy").then_some((array, item))
}

/// The file that a path leads through.
fn file_above(path: &Path) -> Option<&Path> {
    path.ancestors()
        .skip(1)
        .take_while(|above| !above.as_os_str().is_empty())
        .find(|above| std::fs::metadata(above).is_ok())
        .filter(|above| above.is_file())
}

/// The name of a member, with slashes.
fn inside(path: &Path, archive: &Path) -> Option<String> {
    let parts = path.strip_prefix(archive).ok()?.components();
    let parts: Option<Vec<&str>> = parts.map(|part| part.as_os_str().to_str()).collect();
    Some(parts?.join("/"))
}

/// The file on disk that holds a path.
pub(super) fn file_of(path: &Path) -> PathBuf {
    match std::fs::metadata(path) {
        Ok(_) => path.to_owned(),
        Err(_) => file_above(path).unwrap_or(path).to_owned(),
    }
}

/// Reads a file, a member or an item, once.
pub(super) fn read(path: &Path) -> io::Result<Vec<u8>> {
    Containers::default().read(path)
}

/// Names of the members of an archive, sorted.
pub(super) fn names(archive: &Path) -> io::Result<Vec<String>> {
    Archive::open(archive)?.names()
}

/// The header of an array, in a file or in an archive.
pub(super) fn array_header(path: &Path) -> io::Result<NpyHeader> {
    Ok(Stack::open(path)?.header().clone())
}

impl Containers {
    /// Reads a file, a member or an item.
    pub(super) fn read(&self, path: &Path) -> io::Result<Vec<u8>> {
        match Place::of(path) {
            Place::File => read_regular(path),
            Place::Member(archive, name) => self.member(archive, &name),
            Place::Item(array, item) => self.item(array, item),
        }
    }

    fn member(&self, path: &Path, name: &str) -> io::Result<Vec<u8>> {
        let mut archives = self.archives.lock().map_err(poisoned)?;
        if let Some(archive) = archives.iter_mut().find(|one| one.path() == path) {
            return archive.member(name);
        }
        let mut archive = Archive::open(path)?;
        let bytes = archive.member(name)?;
        keep(&mut archives, archive);
        Ok(bytes)
    }

    /// Continues at the nearest position before the item, or begins anew.
    fn item(&self, path: &Path, item: u64) -> io::Result<Vec<u8>> {
        let taken = {
            let mut stacks = self.stacks.lock().map_err(poisoned)?;
            let before = stacks.iter().enumerate();
            let before = before.filter(|(_, stack)| stack.path() == path && stack.next() <= item);
            let nearest = before.max_by_key(|(at, stack)| (stack.next(), *at));
            nearest.map(|(at, _)| at).map(|at| stacks.remove(at))
        };
        let mut stack = match taken {
            Some(stack) => stack,
            None => Stack::open(path)?,
        };
        let bytes = stack.item(item)?;
        keep(&mut *self.stacks.lock().map_err(poisoned)?, stack);
        Ok(bytes)
    }
}

/// Adds the newest, and closes the oldest of too many.
fn keep<T>(all: &mut Vec<T>, newest: T) {
    if all.len() >= MAX_OPEN {
        all.remove(0);
    }
    all.push(newest);
}

fn poisoned<T>(_: T) -> io::Error {
    io::Error::other("another thread failed while it read the same archive")
}

/// Reads all that is left, up to the bound.
fn read_bounded(reader: impl Read, name: &str) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    match bytes.len() as u64 <= MAX_BYTES {
        true => Ok(bytes),
        false => Err(too_large(name)),
    }
}

fn too_large(name: &str) -> io::Error {
    io::Error::other(format!(
        "{name} takes more than {} MB, which no image does: give the archive as the app or the model wrote it",
        MAX_BYTES >> 20
    ))
}

#[cfg(test)]
mod tests;
