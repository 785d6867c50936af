//! Arrays of numpy in archives.

use std::io::Write;

use zip::ZipWriter;
use zip::write::{SimpleFileOptions, StreamWriter};

use super::source::Failure;
use crate::npy::header_bytes;

/// An archive that is written from the front to the back.
pub(super) type ArchiveWriter<'a> = ZipWriter<StreamWriter<&'a mut dyn Write>>;

/// Begins an array; its values follow, row by row.
pub(super) fn begin_array(
    archive: &mut ArchiveWriter<'_>,
    name: &str,
    descr: &str,
    shape: &[u64],
) -> Result<(), Failure> {
    archive.start_file(format!("{name}.npy"), packed())?;
    archive.write_all(&header_bytes(&format!("'{descr}'"), shape))?;
    Ok(())
}

/// Members are deflated; their date is that of the format, so that the bytes depend on the content alone.
pub(super) fn packed() -> SimpleFileOptions {
    SimpleFileOptions::default()
        .compression_method(zip::CompressionMethod::Deflated)
        .last_modified_time(zip::DateTime::default())
        .large_file(true)
}

/// Members that are compressed already.
pub(super) fn stored() -> SimpleFileOptions {
    packed().compression_method(zip::CompressionMethod::Stored)
}

/// Writes single-precision numbers.
pub(super) fn write_f32(archive: &mut ArchiveWriter<'_>, values: &[f32]) -> Result<(), Failure> {
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    Ok(archive.write_all(&bytes)?)
}

/// Writes double-precision numbers.
pub(super) fn write_f64(archive: &mut ArchiveWriter<'_>, values: &[f64]) -> Result<(), Failure> {
    let bytes: Vec<u8> = values
        .iter()
        .flat_map(|value| value.to_le_bytes())
        .collect();
    Ok(archive.write_all(&bytes)?)
}
