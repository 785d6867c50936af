//! Depth maps of COLMAP's dense workspace: `width&height&channels&`, then little-endian `f32`, columns changing fastest.

use super::{ImageSize, size};

/// What begins a file.
pub(super) struct Header {
    pub(super) size: ImageSize,
    /// Where the values begin.
    data: usize,
}

/// Whether a file begins as one.
pub(super) fn is_one(bytes: &[u8]) -> bool {
    parts(bytes).is_some()
}

/// Width, height and channels, and where the values begin.
fn parts(bytes: &[u8]) -> Option<([u64; 3], usize)> {
    /// Sides have fewer digits.
    const LONGEST: usize = 10;
    let mut at = 0;
    let mut numbers = [0; 3];
    for number in &mut numbers {
        let rest = bytes.get(at..)?;
        let length = rest.iter().take(LONGEST + 1).position(|&b| b == b'&')?;
        let digits = &rest[..length];
        if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
            return None;
        }
        *number = std::str::from_utf8(digits).ok()?.parse().ok()?;
        at += length + 1;
    }
    Some((numbers, at))
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        let ([width, height, channels], data) =
            parts(bytes).ok_or("no header width&height&channels&")?;
        if channels != 1 {
            return Err(format!(
                "{channels} channels: a depth map has one, and a map of normals three"
            ));
        }
        Ok(Self {
            size: size(width, height)?,
            data,
        })
    }
}

/// The values that the file has, at most as many as the header says.
pub(super) fn samples(bytes: &[u8]) -> Result<Vec<f32>, String> {
    let header = Header::read(bytes)?;
    let count = header.size.width as usize * header.size.height as usize;
    let data = bytes.get(header.data..).unwrap_or_default();
    let (values, _) = data.as_chunks::<4>();
    let values = values.iter().take(count);
    Ok(values.map(|&value| f32::from_le_bytes(value)).collect())
}
