//! Samples in eight bytes, without those that are missing.

use super::samples::SurfaceSample;

/// A sample in 64 bits, from the highest: inverse depth, slopes, standard deviation. They are rounded by a share of at most 2^-15 (a thirtieth of
/// a millimetre at a metre), 2^-7 and 2^-5: less than they are wrong by.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
struct PackedSample(u64);

/// Bits of an inverse depth.
const RHO_BITS: u32 = 22;
/// Bits of a slope, of which the highest is the sign.
const SLOPE_BITS: u32 = 15;
/// Bits of a standard deviation.
const SIGMA_BITS: u32 = 12;

impl PackedSample {
    fn new(sample: &SurfaceSample) -> Self {
        let slopes = sample.slope.map(|slope| {
            let sign = u64::from(slope.is_sign_negative()) << (SLOPE_BITS - 1);
            sign | rounded(slope.abs(), SLOPE_BITS - 1)
        });
        let sizes = [SLOPE_BITS, SLOPE_BITS, SIGMA_BITS];
        let others = [slopes[0], slopes[1], rounded(sample.sigma, SIGMA_BITS)];
        let others = others.into_iter().zip(sizes);
        let rho = rounded(sample.rho, RHO_BITS);
        Self(others.fold(rho, |packed, (bits, size)| packed << size | bits))
    }

    #[inline]
    fn unpacked(self) -> SurfaceSample {
        let slope = |bits: u64| {
            let size = restored(bits, SLOPE_BITS - 1);
            match bits >> (SLOPE_BITS - 1) & 1 {
                1 => -size,
                _ => size,
            }
        };
        let y = self.0 >> SIGMA_BITS;
        let x = y >> SLOPE_BITS;
        SurfaceSample {
            rho: restored(x >> SLOPE_BITS, RHO_BITS),
            slope: [slope(x), slope(y)],
            sigma: restored(self.0, SIGMA_BITS),
        }
    }
}

/// The highest bits behind the sign of the nearest number, not negative, whose other bits are zero.
fn rounded(number: f32, bits: u32) -> u64 {
    let omitted = 31 - bits;
    u64::from((number.to_bits() + (1 << (omitted - 1))) >> omitted)
}

/// The number with these highest bits behind the sign.
#[inline]
fn restored(highest: u64, bits: u32) -> f32 {
    f32::from_bits((highest as u32 & ((1 << bits) - 1)) << (31 - bits))
}

/// The known ones of all samples.
#[derive(Debug, Clone, Default, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct PackedSamples {
    /// One bit for each sample, set where it is known.
    is_known: Vec<u64>,
    /// Number of known samples before each word of these.
    before: Vec<u32>,
    samples: Vec<PackedSample>,
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
                packed.samples.push(PackedSample::new(&sample));
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
        Some(self.samples[before as usize].unpacked())
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
                index as f32 + 0.1
            },
            slope: [1.234e-3, -2.345e-5 * index as f32],
            sigma: 1.001e-4,
        };
        let packed = PackedSamples::new((0..300).map(sample));
        assert_eq!(packed.known_count(), 200);
        for index in 0..300 {
            let expected = Some(sample(index)).filter(|sample| sample.rho > 0.0);
            let found = packed.get(index);
            assert_eq!(found.is_some(), expected.is_some());
            let (Some(found), Some(expected)) = (found, expected) else {
                continue;
            };
            let numbers = |it: SurfaceSample| [it.rho, it.slope[0], it.slope[1], it.sigma];
            let shares = [1.0 / 32768.0, 1.0 / 128.0, 1.0 / 128.0, 1.0 / 32.0];
            let pairs = numbers(found).into_iter().zip(numbers(expected));
            for ((found, expected), share) in pairs.zip(shares) {
                assert!((found - expected).abs() <= share * expected.abs());
            }
        }
        assert_eq!(packed.get(300).or(packed.get(1000)), None);
    }

    #[test]
    fn numbers_are_rounded_to_the_nearest() {
        for (number, nearest) in [
            (0.0, 0.0),
            (1.0, 1.0),
            (1.0625, 1.0625),
            (1.03, 1.0),
            (1.04, 1.0625),
            (1.99, 2.0),
        ] {
            assert_eq!(restored(rounded(number, SIGMA_BITS), SIGMA_BITS), nearest);
        }
    }
}
