//! Binary descriptors.

use serde::{Deserialize, Serialize};

/// A 256-bit descriptor, compared by Hamming distance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Descriptor(pub [u64; 4]);

impl Descriptor {
    /// A descriptor from 32 bytes, the first in the lowest bits.
    pub fn from_bytes(bytes: &[u8; 32]) -> Self {
        let mut words = [0; 4];
        for (word, chunk) in words.iter_mut().zip(bytes.chunks_exact(8)) {
            *word = chunk
                .iter()
                .rev()
                .fold(0, |word, byte| word << 8 | u64::from(*byte));
        }
        Self(words)
    }

    /// Hamming distance: the number of different bits.
    #[inline]
    pub fn distance(&self, other: &Self) -> u32 {
        let bits = |word: usize| (self.0[word] ^ other.0[word]).count_ones();
        bits(0) + bits(1) + bits(2) + bits(3)
    }

    /// The descriptor with the smallest median distance to the others, the first of equals; `None` of an empty list.
    ///
    /// # Complexity
    /// Quadratic in their number.
    pub fn representative(descriptors: &[Self]) -> Option<Self> {
        let mut distances = Vec::with_capacity(descriptors.len());
        descriptors
            .iter()
            .min_by_key(|candidate| {
                distances.clear();
                distances.extend(descriptors.iter().map(|other| candidate.distance(other)));
                let middle = distances.len() / 2;
                *distances.select_nth_unstable(middle).1
            })
            .copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distance_counts_bits() {
        let mut bytes = [0; 32];
        let zero = Descriptor::from_bytes(&bytes);
        bytes[0] = 0b101;
        bytes[31] = 0x80;
        let other = Descriptor::from_bytes(&bytes);
        assert_eq!(other.0, [5, 0, 0, 1 << 63]);
        assert_eq!((zero.distance(&other), zero.distance(&zero)), (3, 0));
    }

    #[test]
    fn the_representative_is_in_the_middle() {
        let of = |bits: u64| Descriptor([bits, 0, 0, 0]);
        let all = [of(0xff00), of(1), of(0), of(2)];
        assert_eq!(Descriptor::representative(&all), Some(of(0)));
        assert_eq!(Descriptor::representative(&[]), None);
    }
}
