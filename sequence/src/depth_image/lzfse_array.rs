//! Little-endian `f32`, row by row, packed with Apple's LZFSE, as in recordings of Record3D. The files do not say their size.

use std::io::Read;

use lzfse_rust::LzfseRingDecoder;

use super::ImageSize;

/// Why such a file alone is no image.
pub(super) const NO_SIZE: &str = "values packed with LZFSE, which do not say width and height: give the recording of Record3D as a whole";

/// Whether a file begins with a block of LZFSE.
pub(super) fn is_one(bytes: &[u8]) -> bool {
    [b"bvx-", b"bvx1", b"bvx2", b"bvxn"]
        .iter()
        .any(|magic| bytes.starts_with(*magic))
}

/// Unpacks at most `most` bytes.
///
/// # Errors
/// When the data are damaged, or hold more.
pub(in super::super) fn unpack(bytes: &[u8], most: usize) -> Result<Vec<u8>, String> {
    let mut decoder = LzfseRingDecoder::default();
    let mut out = Vec::new();
    decoder
        .reader_bytes(bytes)
        .take(most as u64 + 1)
        .read_to_end(&mut out)
        .map_err(|error| format!("the LZFSE data are damaged or truncated ({error})"))?;
    match out.len() <= most {
        true => Ok(out),
        false => Err(format!(
            "the LZFSE data hold more than the {most} bytes of an image"
        )),
    }
}

/// The values of an image.
pub(super) fn samples(bytes: &[u8], size: ImageSize) -> Result<Vec<f32>, String> {
    let count = size.width as usize * size.height as usize;
    let bytes = unpack(bytes, 4 * count)?;
    let (values, _) = bytes.as_chunks::<4>();
    Ok(values
        .iter()
        .map(|&value| f32::from_le_bytes(value))
        .collect())
}
