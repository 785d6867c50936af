//! Lists of records in a file without a name, which goes when the process ends.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::error::TilesError;
use crate::record::{Record, decode, encode};

/// The file.
pub(super) struct Scratch {
    folder: PathBuf,
    file: File,
}

impl Scratch {
    pub(super) fn new(folder: &Path) -> Result<Self, TilesError> {
        std::fs::create_dir_all(folder).map_err(TilesError::io(folder))?;
        Ok(Self {
            folder: folder.to_owned(),
            file: tempfile::tempfile_in(folder).map_err(TilesError::io(folder))?,
        })
    }

    /// Writes records from a place on, which is counted in records.
    pub(super) fn write<T: Record>(&mut self, at: usize, records: &[T]) -> Result<(), TilesError> {
        let at = SeekFrom::Start((at * T::BYTES) as u64);
        (self.file.seek(at))
            .and_then(|_| self.file.write_all(&encode(records)))
            .map_err(TilesError::io(&self.folder))
    }

    /// Reads records from a place on.
    pub(super) fn read<T: Record>(
        &mut self,
        at: usize,
        count: usize,
    ) -> Result<Vec<T>, TilesError> {
        let at = SeekFrom::Start((at * T::BYTES) as u64);
        let mut bytes = vec![0; count * T::BYTES];
        (self.file.seek(at))
            .and_then(|_| self.file.read_exact(&mut bytes))
            .map_err(TilesError::io(&self.folder))?;
        Ok(decode(&bytes).unwrap_or_default())
    }
}
