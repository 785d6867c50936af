//! Little-endian binary files, with errors that name file and byte.

use std::path::Path;

use super::{SequenceError, container};

/// A binary file in memory and a read position.
pub(super) struct ByteReader<'a> {
    path: &'a Path,
    bytes: &'a [u8],
    at: usize,
}

impl<'a> ByteReader<'a> {
    pub(super) fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Self { path, bytes, at: 0 }
    }

    /// An error at the current position.
    pub(super) fn error(&self, problem: impl Into<String>) -> SequenceError {
        SequenceError::Byte {
            path: self.path.to_owned(),
            offset: self.at as u64,
            problem: problem.into(),
        }
    }

    /// Whether the whole file is read.
    pub(super) fn is_at_end(&self) -> bool {
        self.at == self.bytes.len()
    }

    /// The next `count` bytes.
    pub(super) fn take(&mut self, count: usize) -> Result<&'a [u8], SequenceError> {
        let rest = &self.bytes[self.at..];
        let taken = rest.get(..count).ok_or_else(|| {
            self.error(format!(
                "the file ends {} bytes too early (truncated?): copy it again",
                count - rest.len()
            ))
        })?;
        self.at += count;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], SequenceError> {
        let mut out = [0; N];
        out.copy_from_slice(self.take(N)?);
        Ok(out)
    }

    pub(super) fn u8(&mut self) -> Result<u8, SequenceError> {
        self.array::<1>().map(|[byte]| byte)
    }

    pub(super) fn u32(&mut self) -> Result<u32, SequenceError> {
        self.array().map(u32::from_le_bytes)
    }

    pub(super) fn u64(&mut self) -> Result<u64, SequenceError> {
        self.array().map(u64::from_le_bytes)
    }

    pub(super) fn f32(&mut self) -> Result<f32, SequenceError> {
        self.array().map(f32::from_le_bytes)
    }

    pub(super) fn f64(&mut self) -> Result<f64, SequenceError> {
        self.array().map(f64::from_le_bytes)
    }

    pub(super) fn f64s<const N: usize>(&mut self) -> Result<[f64; N], SequenceError> {
        let mut out = [0.0; N];
        for slot in &mut out {
            *slot = self.f64()?;
        }
        Ok(out)
    }

    /// Reads a count of items of at least `bytes_each` bytes. A count that the rest of the file cannot hold is refused,
    /// so that corrupt files allocate nothing.
    pub(super) fn count(&mut self, items: &str, bytes_each: usize) -> Result<usize, SequenceError> {
        let offset = self.at;
        let count = self.u64()?;
        let most = ((self.bytes.len() - self.at) / bytes_each.max(1)) as u64;
        if count > most {
            return Err(SequenceError::Byte {
                path: self.path.to_owned(),
                offset: offset as u64,
                problem: format!(
                    "{count} {items} are announced, the rest of the file holds at most {most} (truncated, or another format?)"
                ),
            });
        }
        // At most the length of the file.
        Ok(count as usize)
    }

    /// Zero-terminated UTF-8 text.
    pub(super) fn text_to_zero(&mut self) -> Result<String, SequenceError> {
        let rest = &self.bytes[self.at..];
        let length = rest
            .iter()
            .position(|&byte| byte == 0)
            .ok_or_else(|| self.error("a name has no terminating zero byte"))?;
        let name = self.text_of(length)?;
        self.at += 1;
        Ok(name)
    }

    /// UTF-8 text of `length` bytes.
    pub(super) fn text_of(&mut self, length: usize) -> Result<String, SequenceError> {
        let offset = self.at;
        let bytes = self.take(length)?;
        std::str::from_utf8(bytes)
            .map(str::to_owned)
            .map_err(|_| SequenceError::Byte {
                path: self.path.to_owned(),
                offset: offset as u64,
                problem: "a name is not UTF-8".to_owned(),
            })
    }
}

/// Reads a whole file.
pub(super) fn read_file(path: &Path) -> Result<Vec<u8>, SequenceError> {
    container::read(path).map_err(|source| SequenceError::Unreadable {
        path: path.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_and_huge_counts_are_named() {
        let mut bytes = 3_u32.to_le_bytes().to_vec();
        bytes.extend(u64::MAX.to_le_bytes());
        let mut reader = ByteReader::new(Path::new("m.bin"), &bytes);
        assert_eq!(reader.u32().unwrap(), 3);
        let error = reader.count("points", 8).unwrap_err().to_string();
        assert!(
            error.starts_with("m.bin, byte 4: 18446744073709551615 points"),
            "{error}"
        );
        assert!(reader.is_at_end());
        let error = reader.f64().unwrap_err().to_string();
        assert_eq!(
            error,
            "m.bin, byte 12: the file ends 8 bytes too early (truncated?): copy it again"
        );
    }

    #[test]
    fn unterminated_names_are_refused() {
        let mut reader = ByteReader::new(Path::new("x"), b"a.png\0rest");
        assert_eq!(reader.text_to_zero().unwrap(), "a.png");
        assert!(reader.text_to_zero().is_err());
        let mut reader = ByteReader::new(Path::new("x"), b"\xFF\0");
        assert!(reader.text_to_zero().is_err());
    }
}
