//! Items along the first axis of an array, one at a time.

use std::fmt;
use std::io::{self, BufReader, Read};
use std::path::{Path, PathBuf};

use linecarve_mesh::files::open_regular;

use super::archive::Archive;
use super::{MAX_BYTES, file_above, inside, too_large};
use crate::npy::NpyHeader;

/// An array and a position in it.
pub(super) struct Stack {
    path: PathBuf,
    reader: Box<dyn Read + Send>,
    header: NpyHeader,
    /// What begins an item as a file of its own.
    item_header: Vec<u8>,
    /// Bytes of an item.
    item_bytes: u64,
    /// The item at the position.
    next: u64,
}

impl fmt::Debug for Stack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at {}", self.path.display(), self.next)
    }
}

impl Stack {
    /// Opens an array of a file or of an archive.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let mut reader: Box<dyn Read + Send> = match file_above(path) {
            Some(archive) if !path.is_file() => {
                let name = inside(path, archive)
                    .ok_or_else(|| io::Error::other("the name of the array is not UTF-8"))?;
                Archive::open(archive)?.into_reader(&name)?
            }
            _ => Box::new(BufReader::new(open_regular(path)?)),
        };
        let header = NpyHeader::read_from(&mut reader)?;
        let item_header = header.item_header().map_err(io::Error::other)?;
        let item_bytes = header.item_bytes().ok_or_else(|| {
            io::Error::other(format!(
                "an item of the array of shape {:?} has no size",
                header.shape
            ))
        })?;
        if item_bytes > MAX_BYTES {
            return Err(too_large("an item of the array"));
        }
        Ok(Self {
            path: path.to_owned(),
            reader,
            header,
            item_header,
            item_bytes,
            next: 0,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn header(&self) -> &NpyHeader {
        &self.header
    }

    /// The item at the position.
    pub(super) fn next(&self) -> u64 {
        self.next
    }

    /// An item at the position or behind it, as a file of its own.
    pub(super) fn item(&mut self, item: u64) -> io::Result<Vec<u8>> {
        let count = self.header.shape.first().copied().unwrap_or(0);
        if item >= count {
            return Err(io::Error::other(format!(
                "the array has {count} items, and no item {item}"
            )));
        }
        let truncated = || {
            io::Error::other(format!(
                "the array ends within its {count} items (truncated?): copy it again"
            ))
        };
        let skipped = (item - self.next).saturating_mul(self.item_bytes);
        let found = io::copy(&mut (&mut self.reader).take(skipped), &mut io::sink())?;
        if found < skipped {
            return Err(truncated());
        }
        let mut bytes = self.item_header.clone();
        let found = (&mut self.reader)
            .take(self.item_bytes)
            .read_to_end(&mut bytes)?;
        if (found as u64) < self.item_bytes {
            return Err(truncated());
        }
        self.next = item + 1;
        Ok(bytes)
    }
}
