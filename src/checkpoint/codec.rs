//! Numbers to bytes and back, bit for bit.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

/// Bytes that end too early, go on for too long, or say what cannot be.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("damaged at byte {offset}")]
pub struct Damaged {
    /// Where reading stopped.
    pub offset: usize,
}

/// Collects numbers, little-endian.
#[derive(Debug, Default)]
pub struct Writer {
    bytes: Vec<u8>,
}

impl Writer {
    /// Adds bytes as they are.
    pub fn raw(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// Adds one byte.
    pub fn u8(&mut self, value: u8) {
        self.raw(&[value]);
    }

    /// Adds a number of 32 bits.
    pub fn u32(&mut self, value: u32) {
        self.raw(&value.to_le_bytes());
    }

    /// Adds a number of 64 bits.
    pub fn u64(&mut self, value: u64) {
        self.raw(&value.to_le_bytes());
    }

    /// Adds the bits of a number.
    pub fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    /// Adds numbers one by one, without their count.
    pub fn f64s<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        for value in values {
            self.f64(*value);
        }
    }

    /// Adds the bits of a number.
    pub fn f32(&mut self, value: f32) {
        self.u32(value.to_bits());
    }

    /// Adds a rotation and a translation.
    pub fn pose(&mut self, pose: &Isometry3<f64>) {
        self.f64s(pose.rotation.coords.iter());
        self.f64s(pose.translation.vector.iter());
    }

    /// All bytes.
    pub fn finish(self) -> Vec<u8> {
        self.bytes
    }
}

/// Takes numbers off bytes.
#[derive(Debug)]
pub struct Reader<'a> {
    bytes: &'a [u8],
    offset: usize,
}

impl<'a> Reader<'a> {
    /// Reads from the beginning.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, offset: 0 }
    }

    /// The next bytes.
    ///
    /// # Errors
    /// When there are fewer.
    pub fn raw(&mut self, count: usize) -> Result<&'a [u8], Damaged> {
        let damaged = Damaged {
            offset: self.offset,
        };
        let end = self.offset.checked_add(count).ok_or(damaged)?;
        let taken = self.bytes.get(self.offset..end).ok_or(damaged)?;
        self.offset = end;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], Damaged> {
        let mut array = [0; N];
        array.copy_from_slice(self.raw(N)?);
        Ok(array)
    }

    /// One byte.
    ///
    /// # Errors
    /// At the end.
    pub fn u8(&mut self) -> Result<u8, Damaged> {
        self.array::<1>().map(|[byte]| byte)
    }

    /// A number of 32 bits.
    ///
    /// # Errors
    /// At the end.
    pub fn u32(&mut self) -> Result<u32, Damaged> {
        self.array().map(u32::from_le_bytes)
    }

    /// A number of 64 bits.
    ///
    /// # Errors
    /// At the end.
    pub fn u64(&mut self) -> Result<u64, Damaged> {
        self.array().map(u64::from_le_bytes)
    }

    /// A number by its bits.
    ///
    /// # Errors
    /// At the end.
    pub fn f64(&mut self) -> Result<f64, Damaged> {
        self.u64().map(f64::from_bits)
    }

    /// Several numbers.
    ///
    /// # Errors
    /// At the end.
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], Damaged> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// A number by its bits.
    ///
    /// # Errors
    /// At the end.
    pub fn f32(&mut self) -> Result<f32, Damaged> {
        self.u32().map(f32::from_bits)
    }

    /// A count of things of `size` bytes each, which must be there.
    ///
    /// # Errors
    /// When they are not.
    pub fn count(&mut self, size: usize) -> Result<usize, Damaged> {
        let count = self.u32()? as usize;
        let left = self.bytes.len() - self.offset;
        if count.saturating_mul(size) > left {
            return Err(Damaged {
                offset: self.offset,
            });
        }
        Ok(count)
    }

    /// A rotation and a translation, as they were written.
    ///
    /// # Errors
    /// At the end.
    pub fn pose(&mut self) -> Result<Isometry3<f64>, Damaged> {
        let [i, j, k, w] = self.f64s()?;
        let translation = Translation3::from(self.f64s::<3>()?);
        // Written as a unit quaternion: another normalisation would change its last bits.
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
        Ok(Isometry3::from_parts(translation, rotation))
    }

    /// To be called when everything is read.
    ///
    /// # Errors
    /// When something is left.
    pub fn finish(self) -> Result<(), Damaged> {
        if self.offset == self.bytes.len() {
            Ok(())
        } else {
            Err(Damaged {
                offset: self.offset,
            })
        }
    }
}
