//! Planes of whole numbers in few bits, without loss.

/// Groups of pixels by how much their neighbours differ; each learns how large its residuals are.
const CONTEXTS: usize = 9;
/// Number of residuals after which what was learnt counts half.
const MEMORY: u32 = 64;
/// Longest unary part of a code; after it a residual follows as it is.
const LONGEST_UNARY: u32 = 20;
/// Bits of a residual as it is: the difference of two 16-bit numbers without its sign, and the sign.
const WHOLE_BITS: u32 = 17;

/// A plane of 16-bit numbers, row by row, in about as many bits as neighbours differ by.
///
/// It is read as a whole. Packing and unpacking take some ten nanoseconds a pixel.
///
/// # Reference
/// M. Weinberger, G. Seroussi, G. Sapiro, *The LOCO-I lossless image compression algorithm*, IEEE Trans. Image Processing 9(8), 2000: the median
/// predictor and adaptive Golomb-Rice codes.
///
/// *Differs from the paper*: few contexts, no bias correction and no run mode.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PackedPlane {
    width: usize,
    height: usize,
    words: Vec<u64>,
}

impl PackedPlane {
    /// Packs samples, row by row.
    ///
    /// # Panics
    /// When the number of samples is not `width * height`.
    pub fn new(width: usize, height: usize, samples: &[u16]) -> Self {
        assert_eq!(samples.len(), width * height, "samples fill the plane");
        let mut writer = BitWriter::default();
        let mut residuals = Residuals::default();
        let mut above: &[u16] = &[];
        for row in samples.chunks_exact(width.max(1)) {
            for (column, &sample) in row.iter().enumerate() {
                let around = Neighbours::of(row, above, column);
                let residual = i32::from(sample) - around.prediction();
                residuals.write(around.context(), residual, &mut writer);
            }
            above = row;
        }
        Self {
            width,
            height,
            words: writer.finish(),
        }
    }

    /// The samples, row by row.
    pub fn unpack(&self) -> Vec<u16> {
        let mut reader = BitReader::new(&self.words);
        let mut residuals = Residuals::default();
        let mut samples = vec![0; self.width * self.height];
        let mut rest = samples.as_mut_slice();
        let mut above: &[u16] = &[];
        for _ in 0..self.height {
            let (row, after) = rest.split_at_mut(self.width);
            for column in 0..self.width {
                let around = Neighbours::of(row, above, column);
                let residual = residuals.read(around.context(), &mut reader);
                row[column] = (around.prediction() + residual) as u16;
            }
            above = row;
            rest = after;
        }
        samples
    }

    /// Number of columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Memory of the samples, in bytes.
    pub fn bytes(&self) -> usize {
        self.words.capacity() * size_of::<u64>()
    }
}

/// The samples before one in reading order.
///
/// ```text
/// c b d
/// a x
/// ```
struct Neighbours {
    a: i32,
    b: i32,
    c: i32,
    d: i32,
}

impl Neighbours {
    /// Those of a column; the row above is empty for the first row. Missing ones are as those that are there.
    #[inline]
    fn of(row: &[u16], above: &[u16], column: usize) -> Self {
        let left = column.checked_sub(1).map(|left| i32::from(row[left]));
        let Some(b) = above.get(column).map(|b| i32::from(*b)) else {
            let a = left.unwrap_or(0);
            return Self {
                a,
                b: a,
                c: a,
                d: a,
            };
        };
        Self {
            a: left.unwrap_or(b),
            b,
            c: column.checked_sub(1).map_or(b, |left| above[left].into()),
            d: above.get(column + 1).map_or(b, |d| i32::from(*d)),
        }
    }

    /// The median of the samples to the left and above and of the plane through the three nearest.
    #[inline]
    fn prediction(&self) -> i32 {
        let (low, high) = (self.a.min(self.b), self.a.max(self.b));
        (self.a + self.b - self.c).clamp(low, high)
    }

    #[inline]
    fn context(&self) -> usize {
        let differences =
            (self.d - self.b).abs() + (self.b - self.c).abs() + (self.c - self.a).abs();
        // The number of its bits.
        let bits = 32 - differences.leading_zeros();
        (bits as usize).min(CONTEXTS - 1)
    }
}

/// The sizes of the residuals so far.
struct Residuals {
    /// Sum and number of sizes, by context.
    sizes: [(u32, u32); CONTEXTS],
}

impl Default for Residuals {
    fn default() -> Self {
        Self {
            sizes: [(4, 1); CONTEXTS],
        }
    }
}

impl Residuals {
    /// Low bits of a residual that are written as they are.
    #[inline]
    fn low_bits(&self, context: usize) -> u32 {
        let (sum, count) = self.sizes[context];
        // The number of bits of their quotient, without a division: that of the difference of their bits, or one more.
        let bits = count.leading_zeros().saturating_sub(sum.leading_zeros());
        let bits = bits + u32::from(sum >= count << bits);
        bits.min(WHOLE_BITS - 1)
    }

    #[inline]
    fn learn(&mut self, context: usize, folded: u32) {
        let (sum, count) = &mut self.sizes[context];
        *sum += folded;
        *count += 1;
        if *count == MEMORY {
            *sum /= 2;
            *count /= 2;
        }
    }

    #[inline]
    fn write(&mut self, context: usize, residual: i32, writer: &mut BitWriter) {
        // 0, -1, 1, -2, 2...
        let folded = ((residual << 1) ^ (residual >> 31)) as u32;
        let low = self.low_bits(context).saturating_sub(1);
        let unary = folded >> low;
        if unary < LONGEST_UNARY {
            // As many zeros, and a one.
            writer.write(1 << unary, unary + 1);
            writer.write(u64::from(folded & ((1 << low) - 1)), low);
        } else {
            writer.write(1 << LONGEST_UNARY, LONGEST_UNARY + 1);
            writer.write(folded.into(), WHOLE_BITS);
        }
        self.learn(context, folded);
    }

    #[inline]
    fn read(&mut self, context: usize, reader: &mut BitReader<'_>) -> i32 {
        let low = self.low_bits(context).saturating_sub(1);
        let unary = reader.zeros();
        let folded = match unary < LONGEST_UNARY {
            true => unary << low | reader.read(low),
            false => reader.read(WHOLE_BITS),
        };
        self.learn(context, folded);
        (folded >> 1) as i32 ^ -((folded & 1) as i32)
    }
}

/// Bits in words, the lowest first.
#[derive(Default)]
struct BitWriter {
    words: Vec<u64>,
    word: u64,
    used: u32,
}

impl BitWriter {
    /// Appends fewer than 64 bits; the others are zero.
    #[inline]
    fn write(&mut self, bits: u64, count: u32) {
        self.word |= bits << self.used;
        self.used += count;
        if self.used >= 64 {
            self.words.push(self.word);
            self.used -= 64;
            self.word = bits >> (count - self.used);
        }
    }

    fn finish(mut self) -> Vec<u64> {
        if self.used > 0 {
            self.words.push(self.word);
        }
        self.words.shrink_to_fit();
        self.words
    }
}

/// Reads what a [`BitWriter`] wrote; zeros after its end.
struct BitReader<'a> {
    words: std::slice::Iter<'a, u64>,
    /// The next bits, and how many of them.
    bits: u64,
    count: u32,
}

impl<'a> BitReader<'a> {
    fn new(words: &'a [u64]) -> Self {
        Self {
            words: words.iter(),
            bits: 0,
            count: 0,
        }
    }

    /// Fewer than 32 bits.
    #[inline]
    fn read(&mut self, count: u32) -> u32 {
        let mask = (1_u64 << count) - 1;
        let mut value = self.bits;
        let missing = count.saturating_sub(self.count);
        if missing > 0 {
            let word = self.words.next().copied().unwrap_or(0);
            value |= word << self.count;
            self.bits = word >> missing;
            self.count = 64 - missing;
        } else {
            self.bits >>= count;
            self.count -= count;
        }
        (value & mask) as u32
    }

    /// Number of zeros before the next one, which is read as well; at most [`LONGEST_UNARY`].
    #[inline]
    fn zeros(&mut self) -> u32 {
        let mut zeros = 0;
        if self.bits == 0 {
            zeros = self.count;
            self.bits = self.words.next().copied().unwrap_or(0);
            self.count = 64;
        }
        let more = self.bits.trailing_zeros();
        let taken = (more + 1).min(self.count);
        self.bits = self.bits.checked_shr(taken).unwrap_or(0);
        self.count -= taken;
        (zeros + more).min(LONGEST_UNARY)
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn assert_comes_back(width: usize, height: usize, samples: &[u16]) -> usize {
        let packed = PackedPlane::new(width, height, samples);
        assert_eq!((packed.width(), packed.height()), (width, height));
        assert!(packed.unpack() == samples, "{width} x {height}");
        packed.bytes()
    }

    #[test]
    fn planes_come_back() {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        for (width, height) in [(0, 0), (1, 1), (1, 9), (9, 1), (0, 3), (37, 23), (64, 64)] {
            for bits in [0, 1, 3, 8, 12, 16] {
                let largest = ((1_u32 << bits) - 1) as u16;
                let noise = (0..width * height).map(|_| random.random_range(0..=largest));
                assert_comes_back(width, height, &noise.collect::<Vec<_>>());
                // The largest residuals of either sign.
                let ends = (0..width * height).map(|_| [0, largest][random.random_range(0..2)]);
                assert_comes_back(width, height, &ends.collect::<Vec<_>>());
                // Few of them in a flat plane, where short codes are learnt.
                let rare = (0..width * height).map(|_| match random.random_range(0..40) {
                    0 => largest,
                    _ => 0,
                });
                assert_comes_back(width, height, &rare.collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn low_bits_are_those_of_the_mean() {
        let sums = (0..200).chain((8..22).flat_map(|bits| (1 << bits) - 1..(1 << bits) + 2));
        for (sum, count) in sums.flat_map(|sum| (1..MEMORY).map(move |count| (sum, count))) {
            let residuals = Residuals {
                sizes: [(sum, count); CONTEXTS],
            };
            let bits = 32 - (sum / count).leading_zeros();
            assert_eq!(
                residuals.low_bits(3),
                bits.min(WHOLE_BITS - 1),
                "{sum} / {count}"
            );
        }
    }

    #[test]
    fn smooth_planes_need_few_bits() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let flat = vec![777; 160 * 120];
        assert!(assert_comes_back(160, 120, &flat) < 160 * 120 / 7);
        let mut slope = |i: usize| {
            let rise = (i % 160 * 3 + i / 160) as u16;
            rise + random.random_range(0..4)
        };
        let slope: Vec<u16> = (0..160 * 120).map(&mut slope).collect();
        // The noise has two bits; the sum of three neighbours' more.
        assert!(assert_comes_back(160, 120, &slope) < 160 * 120 / 2);
    }
}
