//! Files of sections, each with a checksum.
//!
//! ```text
//! header   64 bytes: magic, kind, format, digest of the plan, number of sections, length of the file, checksum of the table,
//!          checksum of the header
//! sections one after another
//! table    length and checksum of each section
//! ```
//!
//! A file is written under a temporary name and renamed, so it is whole or absent.

use std::fs::File;
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;
use xxhash_rust::xxh3::xxh3_64;

use crate::error::TilesError;
use crate::record::{Record, decode, encode};
use crate::stage::Stage;

const MAGIC: u64 = u64::from_le_bytes(*b"LCTILES\n");
/// Changes with the meaning of any file.
pub(crate) const FORMAT: u32 = 4;
const HEADER: usize = 64;
/// Begins the names of files that are being written.
pub(crate) const UNFINISHED: &str = ".linecarve-unfinished-";

/// What a file holds.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[repr(u32)]
pub(crate) enum Kind {
    Views = 1,
    Sample = 2,
    Points = 3,
    Rays = 4,
    Frame = 5,
    Carve = 6,
    Giants = 7,
    Network = 8,
    Label = 9,
    Settle = 10,
    Surface = 11,
    Merge = 12,
}

impl Kind {
    /// Whether the plan has such files, which no item makes.
    fn is_of_plan(self) -> bool {
        matches!(self, Self::Views | Self::Sample | Self::Points | Self::Rays)
    }

    /// The error about a damaged file of this kind.
    fn damaged(self, path: &Path, what: &str) -> TilesError {
        match self.is_of_plan() {
            true => TilesError::damaged_plan(path, format!("damaged ({what})")),
            false => TilesError::damaged(path, what),
        }
    }
}

impl From<Stage> for Kind {
    fn from(stage: Stage) -> Self {
        match stage {
            Stage::Frame => Kind::Frame,
            Stage::Carve => Kind::Carve,
            Stage::Giants => Kind::Giants,
            Stage::Network => Kind::Network,
            Stage::Label => Kind::Label,
            Stage::Settle => Kind::Settle,
            Stage::Surface => Kind::Surface,
            Stage::Merge => Kind::Merge,
        }
    }
}

/// Writes a file section by section.
pub(crate) struct Writer {
    path: PathBuf,
    file: BufWriter<NamedTempFile>,
    kind: Kind,
    plan: u64,
    table: Vec<[u64; 2]>,
    length: u64,
}

impl Writer {
    pub(crate) fn create(path: &Path, kind: Kind, plan: u64) -> Result<Self, TilesError> {
        let folder = path.parent().unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder).map_err(TilesError::io(folder))?;
        let file = tempfile::Builder::new()
            .prefix(UNFINISHED)
            .tempfile_in(folder)
            .map_err(TilesError::io(folder))?;
        let mut writer = Self {
            path: path.to_owned(),
            file: BufWriter::new(file),
            kind,
            plan,
            table: Vec::new(),
            length: HEADER as u64,
        };
        writer.write(&[0; HEADER])?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<(), TilesError> {
        let path = &self.path;
        self.file.write_all(bytes).map_err(TilesError::io(path))
    }

    pub(crate) fn section<T: Record>(&mut self, records: &[T]) -> Result<(), TilesError> {
        let bytes = encode(records);
        self.table.push([bytes.len() as u64, xxh3_64(&bytes)]);
        self.length += bytes.len() as u64;
        self.write(&bytes)
    }

    /// Completes the file; returns its digest.
    pub(crate) fn finish(mut self) -> Result<u64, TilesError> {
        let table = encode(&self.table);
        self.write(&table)?;
        let digest = xxh3_64(&table);
        let mut header = Vec::with_capacity(HEADER);
        MAGIC.put(&mut header);
        [self.kind as u32, FORMAT].put(&mut header);
        let length = self.length + table.len() as u64;
        [self.plan, self.table.len() as u64, length, digest, 0].put(&mut header);
        xxh3_64(&header).put(&mut header);
        let Self { path, mut file, .. } = self;
        let written = file
            .seek(SeekFrom::Start(0))
            .and_then(|_| file.write_all(&header))
            .and_then(|()| file.into_inner().map_err(|error| error.into_error()))
            .and_then(|file| persist(file, &path));
        written.map_err(TilesError::io(&path))?;
        Ok(digest)
    }
}

/// A file whose header and table have been verified.
#[derive(Debug)]
pub(crate) struct Reader {
    path: PathBuf,
    kind: Kind,
    /// Where each section begins, its length and its checksum.
    sections: Vec<[u64; 3]>,
    digest: u64,
}

impl Reader {
    pub(crate) fn open(path: &Path, kind: Kind, plan: u64) -> Result<Self, TilesError> {
        let damaged = |what: &str| kind.damaged(path, what);
        let mut file = File::open(path).map_err(|fault| match fault.kind() {
            std::io::ErrorKind::NotFound if kind.is_of_plan() => {
                TilesError::damaged_plan(path, "missing")
            }
            _ => TilesError::io(path)(fault),
        })?;
        let length = file.metadata().map_err(TilesError::io(path))?.len();
        let mut header = [0; HEADER];
        if length < HEADER as u64 {
            return Err(damaged("too short"));
        }
        file.read_exact(&mut header).map_err(TilesError::io(path))?;
        if xxh3_64(&header[..HEADER - 8]) != u64::get(&header[HEADER - 8..]) {
            return Err(damaged("checksum of the header"));
        }
        let [found_kind, format] = <[u32; 2]>::get(&header[8..]);
        let [found_plan, count, whole, digest] = <[u64; 4]>::get(&header[16..]);
        if u64::get(&header) != MAGIC || format != FORMAT || found_kind != kind as u32 {
            return Err(damaged("not a file of this kind"));
        }
        if found_plan != plan {
            let path = path.to_owned();
            return Err(TilesError::OtherPlan { path });
        }
        let table_bytes = count.checked_mul(16).filter(|&bytes| bytes <= length);
        let Some(table_bytes) = table_bytes.filter(|_| whole == length) else {
            return Err(damaged("it is truncated"));
        };
        let mut table = vec![0; table_bytes as usize];
        file.seek(SeekFrom::Start(length - table_bytes))
            .and_then(|_| file.read_exact(&mut table))
            .map_err(TilesError::io(path))?;
        if xxh3_64(&table) != digest {
            return Err(damaged("checksum of the table"));
        }
        let mut start = HEADER as u64;
        let sections = decode::<[u64; 2]>(&table).unwrap_or_default();
        let sections = sections.into_iter().map(|[length, checksum]| {
            let section = [start, length, checksum];
            start += length;
            section
        });
        Ok(Self {
            path: path.to_owned(),
            kind,
            sections: sections.collect(),
            digest,
        })
    }

    /// Digest of the contents.
    pub(crate) fn digest(&self) -> u64 {
        self.digest
    }

    /// Bytes of a section; 0 when there is none.
    pub(crate) fn length(&self, section: usize) -> usize {
        self.sections
            .get(section)
            .map_or(0, |section| section[1] as usize)
    }

    pub(crate) fn section_count(&self) -> usize {
        self.sections.len()
    }

    /// The bytes of a section, verified.
    pub(crate) fn bytes(&self, section: usize) -> Result<Vec<u8>, TilesError> {
        let Some(&[start, length, checksum]) = self.sections.get(section) else {
            return Err(self.kind.damaged(&self.path, "a section is missing"));
        };
        let mut bytes = vec![0; length as usize];
        // Opened for each section: a plan may have more tiles than a process may have files open.
        let mut file = File::open(&self.path).map_err(TilesError::io(&self.path))?;
        file.seek(SeekFrom::Start(start))
            .and_then(|_| file.read_exact(&mut bytes))
            .map_err(TilesError::io(&self.path))?;
        if xxh3_64(&bytes) != checksum {
            let what = format!("checksum of section {section}");
            return Err(self.kind.damaged(&self.path, &what));
        }
        Ok(bytes)
    }

    pub(crate) fn records<T: Record>(&self, section: usize) -> Result<Vec<T>, TilesError> {
        decode(&self.bytes(section)?)
            .ok_or_else(|| self.kind.damaged(&self.path, "a record is incomplete"))
    }

    /// Verifies all sections.
    pub(crate) fn verify(&self) -> Result<(), TilesError> {
        (0..self.sections.len()).try_for_each(|section| self.bytes(section).map(drop))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

/// Writes a file under a temporary name and renames it.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), TilesError> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let write = || {
        std::fs::create_dir_all(folder)?;
        let mut file = tempfile::Builder::new()
            .prefix(UNFINISHED)
            .tempfile_in(folder)?;
        file.write_all(bytes)?;
        persist(file, path)
    };
    write().map_err(TilesError::io(path))
}

/// Gives a temporary file its name. In this order a power failure leaves the file whole or absent, and after this function has returned,
/// whole.
fn persist(file: NamedTempFile, path: &Path) -> std::io::Result<()> {
    file.as_file().sync_all()?;
    file.persist(path).map_err(|error| error.error)?;
    #[cfg(unix)]
    if let Some(Ok(folder)) = path.parent().map(File::open) {
        // Some file systems do not know this.
        let _ = folder.sync_all();
    }
    Ok(())
}

/// Version of the program and of its files.
pub(crate) fn program() -> String {
    format!("{} (files {FORMAT})", env!("CARGO_PKG_VERSION"))
}
