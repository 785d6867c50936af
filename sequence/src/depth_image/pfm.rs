//! Portable float maps of one channel: `Pf`, size, scale, then rows from the bottom up.
//!
//! A negative scale means little-endian values. Its size is a unit that readers leave alone, and so does this one.

use super::{ImageSize, size};

/// What begins a file.
pub(super) struct Header {
    pub(super) size: ImageSize,
    is_big: bool,
    /// Where the values begin.
    data: usize,
}

/// Whether a file is a float map, of any number of channels.
pub(super) fn is_one(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'f' | b'F', space, ..] if space.is_ascii_whitespace())
}

impl Header {
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        if bytes.starts_with(b"PF") {
            return Err("a float map of three channels, not of one".to_owned());
        }
        let mut at = 2;
        let width = number(bytes, &mut at)?;
        let height = number(bytes, &mut at)?;
        let scale = number(bytes, &mut at)?;
        let side = |value: f64| match value.fract() == 0.0 && (1.0..=1e9).contains(&value) {
            true => value as u64,
            false => 0,
        };
        if !scale.is_finite() || scale == 0.0 {
            return Err(format!(
                "the scale {scale}, whose sign gives the byte order"
            ));
        }
        Ok(Self {
            size: size(side(width), side(height))?,
            is_big: scale > 0.0,
            // One blank ends the header.
            data: at + 1,
        })
    }
}

/// The next number of the header.
fn number(bytes: &[u8], at: &mut usize) -> Result<f64, String> {
    /// Numbers are shorter.
    const LONGEST: usize = 32;
    let rest = bytes.get(*at..).unwrap_or_default();
    let blank = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
    let rest = &rest[blank..];
    let length = rest
        .iter()
        .take(LONGEST)
        .position(u8::is_ascii_whitespace)
        .ok_or("a header that ends too early")?;
    let text = std::str::from_utf8(&rest[..length]).unwrap_or_default();
    *at += blank + length;
    text.parse()
        .map_err(|_| format!("'{text}' in place of a number in the header"))
}

/// The values, rows from the top down; as many whole rows as the file has.
pub(super) fn samples(bytes: &[u8]) -> Result<Vec<f32>, String> {
    let header = Header::read(bytes)?;
    let width = header.size.width as usize;
    let data = bytes.get(header.data..).unwrap_or_default();
    let (values, _) = data.as_chunks::<4>();
    let rows = values.chunks_exact(width).take(header.size.height as usize);
    let convert = match header.is_big {
        true => f32::from_be_bytes,
        false => f32::from_le_bytes,
    };
    let rows = rows.rev().flatten().map(|&value| convert(value));
    Ok(rows.collect())
}
