//! Seeded random numbers.

/// SplitMix64, a generator whose stream is fixed for ever.
///
/// # Reference
/// Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014.
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    /// A stream for a frame and a stage.
    pub(crate) fn new(frame: u32, stage: u32) -> Self {
        Self((u64::from(frame) << 32) ^ u64::from(stage).wrapping_mul(0x9e37_79b9))
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A number below `count`, which is at least 1.
    pub(crate) fn below(&mut self, count: usize) -> usize {
        ((u128::from(self.next()) * count as u128) >> 64) as usize
    }

    /// Three different numbers below `count`, which is at least 3.
    pub(crate) fn three(&mut self, count: usize) -> [usize; 3] {
        let first = self.below(count);
        let mut second = self.below(count - 1);
        second += usize::from(second >= first);
        let mut third = self.below(count - 2);
        let (low, high) = (first.min(second), first.max(second));
        third += usize::from(third >= low);
        third += usize::from(third >= high);
        [first, second, third]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_numbers_are_different_and_all_occur() {
        let mut random = Random::new(7, 1);
        let mut seen = [0; 5];
        for _ in 0..500 {
            let [a, b, c] = random.three(5);
            assert!(a != b && b != c && a != c && a.max(b).max(c) < 5);
            for at in [a, b, c] {
                seen[at] += 1;
            }
        }
        assert!(seen.iter().all(|&count| count > 200), "{seen:?}");
    }
}
