//! Members of a ZIP archive.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use flate2::read::DeflateDecoder;
use linecarve_mesh::files::open_regular;
use zip::result::ZipError;
use zip::{CompressionMethod, ZipArchive};

use super::{MAX_BYTES, read_bounded, too_large};

/// An open archive.
#[derive(Debug)]
pub(super) struct Archive {
    path: PathBuf,
    zip: ZipArchive<BufReader<File>>,
}

impl Archive {
    /// Opens an archive and reads its list of members.
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        let file = BufReader::new(open_regular(path)?);
        let zip = ZipArchive::new(file).map_err(|error| {
            io::Error::other(format!(
                "not a complete ZIP archive ({error}): copy it again"
            ))
        })?;
        Ok(Self {
            path: path.to_owned(),
            zip,
        })
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the members, sorted. Names that are not UTF-8 are left out.
    pub(super) fn names(&self) -> io::Result<Vec<String>> {
        let names = self.zip.file_names().filter_map(Result::ok);
        let mut names: Vec<String> = names.map(Cow::into_owned).collect();
        names.sort_unstable();
        names.dedup();
        Ok(names)
    }

    /// The bytes of a member.
    pub(super) fn member(&mut self, name: &str) -> io::Result<Vec<u8>> {
        let member = self
            .zip
            .by_name(name)
            .map_err(|error| missing(name, &error))?;
        if member.size() > MAX_BYTES {
            return Err(too_large(name));
        }
        read_bounded(member, name)
    }

    /// A reader of a member that owns its file. The checksum is not looked at.
    pub(super) fn into_reader(mut self, name: &str) -> io::Result<Box<dyn Read + Send>> {
        let member = self
            .zip
            .by_name(name)
            .map_err(|error| missing(name, &error))?;
        let (packed, method) = (member.compressed_size(), member.compression());
        let start = member
            .data_start()
            .ok_or_else(|| io::Error::other(format!("{name} has no place in the archive")))?;
        drop(member);
        let mut file = BufReader::new(open_regular(&self.path)?);
        file.seek(SeekFrom::Start(start))?;
        let packed = file.take(packed);
        match method {
            CompressionMethod::Stored => Ok(Box::new(packed)),
            CompressionMethod::Deflated => Ok(Box::new(DeflateDecoder::new(packed))),
            other => Err(io::Error::other(format!(
                "{name} is packed with {other}, which is not read: pack it with Deflate"
            ))),
        }
    }
}

fn missing(name: &str, error: &ZipError) -> io::Error {
    let kind = match error {
        ZipError::FileNotFound => io::ErrorKind::NotFound,
        _ => io::ErrorKind::Other,
    };
    io::Error::new(kind, format!("{name} in the archive: {error}"))
}
