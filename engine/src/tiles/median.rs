//! The median of more numbers than memory should hold.

use std::fs::File;
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::Path;

/// Numbers in a file without a name.
pub(super) struct Medians {
    file: BufWriter<File>,
    count: u64,
}

impl Medians {
    /// None yet; the file is on the disk of a folder.
    pub(super) fn new(folder: &Path) -> std::io::Result<Self> {
        let file = tempfile::tempfile_in(folder)?;
        Ok(Self {
            file: BufWriter::with_capacity(1 << 20, file),
            count: 0,
        })
    }

    pub(super) fn add(&mut self, values: &[f64]) -> std::io::Result<()> {
        for value in values {
            let bytes = key(*value).to_le_bytes();
            self.file.write_all(&bytes)?;
        }
        self.count += values.len() as u64;
        Ok(())
    }

    /// The number in the middle, the greater of two; `None` without numbers. Exact, in four passes.
    pub(super) fn upper_median(mut self) -> std::io::Result<Option<f64>> {
        self.file.flush()?;
        if self.count == 0 {
            return Ok(None);
        }
        let mut below = self.count / 2;
        let mut prefix = 0u64;
        for digit in (0..4).rev() {
            let shift = 16 * digit;
            let mut counts = vec![0u64; 1 << 16];
            let file = self.file.get_mut();
            file.seek(SeekFrom::Start(0))?;
            let mut reader = BufReader::with_capacity(1 << 20, file);
            let mut bytes = [0; 8];
            for _ in 0..self.count {
                reader.read_exact(&mut bytes)?;
                let key = u64::from_le_bytes(bytes);
                // The digits before are those of the median.
                if key.checked_shr(shift + 16).unwrap_or(0) == prefix {
                    counts[(key >> shift) as usize & 0xffff] += 1;
                }
            }
            let mut value = 0;
            while below >= counts[value] {
                below -= counts[value];
                value += 1;
            }
            prefix = prefix << 16 | value as u64;
        }
        Ok(Some(number(prefix)))
    }
}

/// Bits in the order of [`f64::total_cmp`].
fn key(value: f64) -> u64 {
    let bits = value.to_bits();
    match bits >> 63 {
        0 => bits | 1 << 63,
        _ => !bits,
    }
}

fn number(key: u64) -> f64 {
    f64::from_bits(match key >> 63 {
        0 => !key,
        _ => key & !(1 << 63),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_is_that_of_sorted_numbers() {
        let folder = tempfile::tempdir().unwrap();
        let mut values: Vec<f64> = Vec::new();
        for i in 0..200u64 {
            let median = {
                let mut medians = Medians::new(folder.path()).unwrap();
                medians.add(&values).unwrap();
                medians.upper_median().unwrap()
            };
            let mut sorted = values.clone();
            sorted.sort_unstable_by(f64::total_cmp);
            let expected = sorted.get(sorted.len() / 2).copied();
            assert_eq!(median.map(f64::to_bits), expected.map(f64::to_bits));
            let mixed = i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
            values.push((mixed as f64 - 8e6) / if i % 3 == 0 { 1e7 } else { 3.0 });
        }
    }
}
