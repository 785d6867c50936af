//! Boxes and numbers of an index, each with its position in the file.

use std::path::Path;

use crate::video::VideoError;

/// Part of the index, with its position in the file.
#[derive(Debug, Clone, Copy)]
pub(super) struct Part<'a> {
    pub(super) path: &'a Path,
    pub(super) bytes: &'a [u8],
    pub(super) offset: u64,
}

impl<'a> Part<'a> {
    pub(super) fn error(&self, at: usize, problem: impl Into<String>) -> VideoError {
        VideoError::content(self.path, self.offset + at as u64, problem)
    }

    /// A part of `count` bytes at a position.
    pub(super) fn take(&self, at: usize, count: usize) -> Result<Self, VideoError> {
        let bytes = at
            .checked_add(count)
            .and_then(|end| self.bytes.get(at..end))
            .ok_or_else(|| {
                self.error(
                    at,
                    "the index ends too early (damaged file?): copy it again",
                )
            })?;
        Ok(Self {
            path: self.path,
            bytes,
            offset: self.offset + at as u64,
        })
    }

    pub(super) fn u32(&self, at: usize) -> Result<u32, VideoError> {
        let bytes = self.take(at, 4)?.bytes;
        Ok(bytes
            .iter()
            .fold(0, |sum, byte| (sum << 8) | u32::from(*byte)))
    }

    pub(super) fn u64(&self, at: usize) -> Result<u64, VideoError> {
        Ok((u64::from(self.u32(at)?) << 32) | u64::from(self.u32(at + 4)?))
    }

    /// Whether a box is of version 1, with times of eight bytes.
    pub(super) fn is_long(&self) -> Result<bool, VideoError> {
        Ok(self.take(0, 1)?.bytes[0] == 1)
    }

    /// The contents of the boxes in this part, with their types.
    pub(super) fn boxes(&self) -> Result<Vec<([u8; 4], Self)>, VideoError> {
        let mut found = Vec::new();
        let mut at = 0;
        while at + 8 <= self.bytes.len() {
            let mut head = 8;
            let size = match self.u32(at)? {
                0 => self.bytes.len() - at,
                1 => {
                    head = 16;
                    usize::try_from(self.u64(at + 8)?).unwrap_or(usize::MAX)
                }
                size => size as usize,
            };
            let name = self.take(at + 4, 4)?.bytes;
            if size < head {
                return Err(self.error(at, "a box is shorter than its head (damaged file?)"));
            }
            let whole = self.take(at, size)?;
            found.push((
                [name[0], name[1], name[2], name[3]],
                whole.take(head, size - head)?,
            ));
            at += size;
        }
        Ok(found)
    }

    pub(super) fn find(&self, name: &[u8; 4]) -> Result<Option<Self>, VideoError> {
        let found = self.boxes()?.into_iter().find(|(other, _)| other == name);
        Ok(found.map(|(_, part)| part))
    }

    pub(super) fn need(&self, name: &[u8; 4]) -> Result<Self, VideoError> {
        self.find(name)?.ok_or_else(|| {
            self.error(
                0,
                format!("the box {} is missing (damaged file?)", name.escape_ascii()),
            )
        })
    }

    /// Entries of a table: `count` at a position, then as many rows of `width` bytes.
    pub(super) fn rows(
        &self,
        at: usize,
        width: usize,
    ) -> Result<impl Iterator<Item = Self>, VideoError> {
        let count = self.u32(at)? as usize;
        let table = count
            .checked_mul(width)
            .ok_or_else(|| self.error(at, "the table is too long (damaged file?)"))
            .and_then(|size| self.take(at + 4, size))?;
        Ok((0..count).filter_map(move |row| table.take(row * width, width).ok()))
    }
}
