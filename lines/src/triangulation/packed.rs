//! Samples without those that are missing.

use super::samples::SurfaceSample;

/// The known ones of all samples.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct PackedSamples {
    /// One bit for each sample, set where it is known.
    is_known: Vec<u64>,
    /// Number of known samples before each word of these.
    before: Vec<u32>,
    samples: Vec<SurfaceSample>,
}

impl PackedSamples {
    /// An inverse depth of 0 marks a missing sample.
    pub(super) fn new(all: impl Iterator<Item = SurfaceSample>) -> Self {
        let mut packed = Self::default();
        for (index, sample) in all.enumerate() {
            if index % 64 == 0 {
                packed.is_known.push(0);
                packed.before.push(packed.samples.len() as u32);
            }
            if sample.rho > 0.0 {
                packed.is_known[index / 64] |= 1 << (index % 64);
                packed.samples.push(sample);
            }
        }
        packed.samples.shrink_to_fit();
        packed
    }

    pub(super) fn known_count(&self) -> usize {
        self.samples.len()
    }

    #[inline]
    pub(super) fn get(&self, index: usize) -> Option<SurfaceSample> {
        let word = *self.is_known.get(index / 64)?;
        let bit = 1 << (index % 64);
        if word & bit == 0 {
            return None;
        }
        let before = self.before[index / 64] + (word & (bit - 1)).count_ones();
        Some(self.samples[before as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_samples_come_back() {
        let sample = |index: usize| SurfaceSample {
            rho: if index.is_multiple_of(3) {
                0.0
            } else {
                index as f32
            },
            slope: [1e-3, -2e-5],
            sigma: 1e-4,
        };
        let packed = PackedSamples::new((0..300).map(sample));
        assert_eq!(packed.known_count(), 200);
        for index in 0..300 {
            let expected = Some(sample(index)).filter(|sample| sample.rho > 0.0);
            assert_eq!(packed.get(index), expected);
        }
        assert_eq!(packed.get(300).or(packed.get(1000)), None);
    }
}
