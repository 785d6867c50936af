//! Arrays in files of numpy: the header, and values of a few types.
//!
//! # Reference
//! numpy.lib.format, versions 1 to 3.

use std::io::{self, Read};

/// Begins every file.
pub(super) const MAGIC: &[u8] = b"\x93NUMPY";

/// Longest header: those of arrays without fields take less than 200 bytes.
const MAX_HEADER: u64 = 1 << 16;

/// What the header of an array says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct NpyHeader {
    /// Type of the values as written, as `'<f4'`.
    pub(super) descr: String,
    /// Whether the first index changes fastest.
    pub(super) is_fortran: bool,
    pub(super) shape: Vec<u64>,
    /// Where the values begin.
    data: usize,
}

/// A type of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NpyType {
    U8,
    U16,
    F16,
    F32,
    F64,
}

impl NpyHeader {
    /// Reads the header of a file.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub(super) fn read(bytes: &[u8]) -> Result<Self, String> {
        let truncated = || "the header is truncated".to_owned();
        let rest = bytes.strip_prefix(MAGIC).ok_or("no array of numpy")?;
        let (length, at) = match *rest {
            [1, _, a, b, ..] => (u32::from(u16::from_le_bytes([a, b])), 4),
            [2 | 3, _, a, b, c, d, ..] => (u32::from_le_bytes([a, b, c, d]), 6),
            [1..=3, ..] | [] => return Err(truncated()),
            [major, ..] => return Err(format!("version {major} of the format is unknown")),
        };
        let header = rest[at..].get(..length as usize).ok_or_else(truncated)?;
        let header = std::str::from_utf8(header).map_err(|error| error.to_string())?;
        let wrong = |key: &str| format!("the header has no valid {key}");
        let value = |key: &str| value_of(header, key).ok_or_else(|| wrong(key));
        let descr = value("descr")?;
        let is_fortran = value("fortran_order")?;
        let shape = value("shape")?;
        Ok(Self {
            descr: quoted(descr).unwrap_or("of several fields").to_owned(),
            is_fortran: match (
                is_fortran.starts_with("True"),
                is_fortran.starts_with("False"),
            ) {
                (true, _) => true,
                (_, true) => false,
                _ => return Err(wrong("fortran_order")),
            },
            shape: tuple(shape).ok_or_else(|| wrong("shape"))?,
            data: MAGIC.len() + at + length as usize,
        })
    }

    /// The type of the values; `None` when it is another than those that depth may have.
    pub(super) fn npy_type(&self) -> Option<NpyType> {
        match self.descr.trim_matches(['\'', '"']).get(1..)? {
            "u1" => Some(NpyType::U8),
            "u2" => Some(NpyType::U16),
            "f2" => Some(NpyType::F16),
            "f4" => Some(NpyType::F32),
            "f8" => Some(NpyType::F64),
            _ => None,
        }
    }

    /// Reads the header at the beginning of a stream, and no more.
    ///
    /// # Errors
    /// When it is no array, or its values cannot be read one item after the other.
    pub(super) fn read_from(reader: &mut impl Read) -> io::Result<Self> {
        let mut bytes = vec![0; MAGIC.len() + 6];
        let no_array = |error: io::Error| match error.kind() {
            io::ErrorKind::UnexpectedEof => io::Error::other("no array of numpy"),
            _ => error,
        };
        reader
            .read_exact(&mut bytes[..MAGIC.len() + 4])
            .map_err(no_array)?;
        let (length, at) = match bytes[MAGIC.len()] {
            1 => (u64::from(bytes[8]) | u64::from(bytes[9]) << 8, 10),
            _ => {
                reader.read_exact(&mut bytes[10..]).map_err(no_array)?;
                let length = u32::from_le_bytes([bytes[8], bytes[9], bytes[10], bytes[11]]);
                (u64::from(length), 12)
            }
        };
        bytes.truncate(at);
        if !bytes.starts_with(MAGIC) || length > MAX_HEADER {
            return Err(io::Error::other("no array of numpy"));
        }
        reader.take(length).read_to_end(&mut bytes)?;
        let header = Self::read(&bytes).map_err(io::Error::other)?;
        header.check_order().map_err(io::Error::other)?;
        Ok(header)
    }

    /// Refuses objects, and columns one after the other.
    fn check_order(&self) -> Result<(), String> {
        if self.descr.contains('O') {
            return Err("the array holds Python objects, which are not read: save each array with numpy.savez and a type of numbers"
                .to_owned());
        }
        if self.is_fortran && self.shape.len() > 1 {
            return Err(
                "the array has columns one after the other: save numpy.ascontiguousarray(array)"
                    .to_owned(),
            );
        }
        Ok(())
    }

    /// Bytes of a value.
    fn value_bytes(&self) -> Option<u64> {
        self.descr.trim_matches(['\'', '"']).get(2..)?.parse().ok()
    }

    /// Bytes of an item along the first axis.
    pub(super) fn item_bytes(&self) -> Option<u64> {
        let inner = self.shape.get(1..).unwrap_or_default();
        let count = inner.iter().try_fold(1u64, |all, &n| all.checked_mul(n))?;
        count.checked_mul(self.value_bytes()?)
    }

    /// What an item along the first axis has before its values, as a file of its own.
    pub(super) fn item_header(&self) -> Result<Vec<u8>, String> {
        let inner = self.shape.get(1..).ok_or("the array has no axes")?;
        Ok(header_bytes(&self.descr, inner))
    }

    /// The values of `N` bytes each that the file has, at most as many as the shape says; `convert` gets little-endian bytes.
    pub(super) fn values<T, const N: usize>(
        &self,
        bytes: &[u8],
        convert: impl Fn([u8; N]) -> T,
    ) -> Vec<T> {
        let is_big = self.descr.contains('>');
        let count = self
            .shape
            .iter()
            .try_fold(1u64, |all, &n| all.checked_mul(n));
        let count = count.and_then(|count| usize::try_from(count).ok());
        let data = bytes.get(self.data..).unwrap_or_default();
        let (values, _) = data.as_chunks::<N>();
        let values = values.iter().take(count.unwrap_or(usize::MAX));
        let ordered = values.map(|&value| {
            let mut value = value;
            if is_big {
                value.reverse();
            }
            convert(value)
        });
        ordered.collect()
    }
}

/// The bytes before the values of a file of rows; `descr` has its quotes.
pub(super) fn header_bytes(descr: &str, shape: &[u64]) -> Vec<u8> {
    let sides: Vec<String> = shape.iter().map(|side| format!("{side},")).collect();
    let mut text = format!(
        "{{'descr': {descr}, 'fortran_order': False, 'shape': ({}), }}",
        sides.join(" ")
    );
    // Values begin at a multiple of 64 bytes.
    let filled = (MAGIC.len() + 4 + text.len() + 1).next_multiple_of(64);
    text += &" ".repeat(filled - MAGIC.len() - 4 - text.len() - 1);
    text.push('\n');
    let length = u16::try_from(text.len()).unwrap_or(u16::MAX);
    [MAGIC, &[1, 0], &length.to_le_bytes(), text.as_bytes()].concat()
}

/// Shape and values of a small array of floating-point numbers.
///
/// # Errors
/// Says what else the file holds.
pub(super) fn numbers(bytes: &[u8]) -> Result<(Vec<u64>, Vec<f64>), String> {
    let header = NpyHeader::read(bytes)?;
    header.check_order()?;
    let values: Vec<f64> = match header.npy_type() {
        Some(NpyType::F32) => header.values(bytes, |value| f64::from(f32::from_le_bytes(value))),
        Some(NpyType::F64) => header.values(bytes, f64::from_le_bytes),
        _ => {
            return Err(format!(
                "the array has values of type {} in place of floating-point numbers",
                header.descr
            ));
        }
    };
    let count = header
        .shape
        .iter()
        .try_fold(1u64, |all, &n| all.checked_mul(n));
    if count != Some(values.len() as u64) {
        return Err(format!(
            "the array of shape {:?} has {} values (truncated?): copy it again",
            header.shape,
            values.len()
        ));
    }
    Ok((header.shape, values))
}

/// What follows a key of the dictionary.
fn value_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let after = |quote: char| {
        let key = format!("{quote}{key}{quote}");
        header.find(&key).map(|at| &header[at + key.len()..])
    };
    let rest = after('\'').or_else(|| after('"'))?;
    Some(rest.trim_start().strip_prefix(':')?.trim_start())
}

/// A string with its quotes.
fn quoted(text: &str) -> Option<&str> {
    let quote = text
        .chars()
        .next()
        .filter(|first| ['\'', '"'].contains(first))?;
    let end = text[1..].find(quote)?;
    Some(&text[..end + 2])
}

fn tuple(text: &str) -> Option<Vec<u64>> {
    let inside = text.strip_prefix('(')?.split_once(')')?.0.trim();
    let inside = inside.strip_suffix(',').unwrap_or(inside);
    if inside.is_empty() {
        return Some(Vec::new());
    }
    // Python 2 wrote `480L`.
    let number = |part: &str| part.trim().trim_end_matches('L').parse().ok();
    inside.split(',').map(number).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(version: u8, header: &str, data: &[u8]) -> Vec<u8> {
        let mut bytes = [MAGIC, &[version, 0]].concat();
        match version {
            1 => bytes.extend((header.len() as u16).to_le_bytes()),
            _ => bytes.extend((header.len() as u32).to_le_bytes()),
        }
        [&bytes, header.as_bytes(), data].concat()
    }

    #[test]
    fn headers_of_all_versions_are_read() {
        let header = "{'descr': '>f4', 'fortran_order': False, 'shape': (2, 3), }  \n";
        for version in [1, 2, 3] {
            let data: Vec<u8> = (0..6).flat_map(|i| (i as f32).to_be_bytes()).collect();
            let bytes = file(version, header, &data);
            let read = NpyHeader::read(&bytes).unwrap();
            assert_eq!(read.shape, [2, 3]);
            assert!(!read.is_fortran && read.npy_type() == Some(NpyType::F32));
            let values = read.values(&bytes, f32::from_le_bytes);
            assert_eq!(values, [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
            assert_eq!(
                read.values(&bytes[..bytes.len() - 1], f32::from_le_bytes)
                    .len(),
                5
            );
            for cut in 0..bytes.len() - data.len() {
                assert!(NpyHeader::read(&bytes[..cut]).is_err(), "{cut}");
            }
        }
        let python_2 = "{\"shape\":(4L,),\"fortran_order\":True,\"descr\":\"|u1\"}";
        let read = NpyHeader::read(&file(1, python_2, &[])).unwrap();
        assert_eq!((&read.shape[..], read.is_fortran), (&[4][..], true));
        assert_eq!(read.npy_type(), Some(NpyType::U8));
        let fields = "{'descr': [('shape', '<f4')], 'fortran_order': False, 'shape': (), }";
        let read = NpyHeader::read(&file(1, fields, &[]));
        assert!(read.is_err() || read.unwrap().npy_type().is_none());
    }

    #[test]
    fn other_headers_are_refused() {
        for header in [
            "",
            "{}",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (2,), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (2, x), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-2,), }",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 3",
        ] {
            assert!(NpyHeader::read(&file(1, header, &[])).is_err(), "{header}");
        }
        assert!(NpyHeader::read(&file(4, "{}", &[])).is_err());
    }
}
