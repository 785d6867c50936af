//! The Helmholtz principle: a segment counts when noise is unlikely to produce it.

/// Expected number of segments in noise that are at least as good as a given one.
///
/// # Reference
/// A. Desolneux, L. Moisan, J.-M. Morel, Meaningful Alignments, International Journal of Computer Vision, 2000.
#[derive(Debug, Clone, Default)]
pub(super) struct Significance {
    /// Natural logarithm of the number of segments in an image.
    ln_tests: f64,
    ln_chance: f64,
    ln_rest: f64,
    /// Logarithm of k! by k, grown as needed.
    ln_factorials: Vec<f64>,
}

impl Significance {
    /// For an image of the given size, where a pixel of noise is aligned with probability `chance`.
    pub(super) fn prepare(&mut self, width: usize, height: usize, chance: f64) {
        // A segment has two ends, each at any pixel.
        self.ln_tests = 2.0 * ((width * height).max(1) as f64).ln();
        self.ln_chance = chance.ln();
        self.ln_rest = (-chance).ln_1p();
    }

    /// The shortest segment that can be meaningful, all of its pixels being aligned.
    pub(super) fn least_length(&self, false_alarms: f64) -> usize {
        let length = (false_alarms.ln() - self.ln_tests) / self.ln_chance;
        length.ceil().max(2.0) as usize
    }

    /// Natural logarithm of the expected number of segments of `pixels` pixels with at least `aligned` aligned ones.
    pub(super) fn ln_false_alarms(&mut self, pixels: usize, aligned: usize) -> f64 {
        if aligned == 0 {
            return self.ln_tests;
        }
        self.grow(pixels);
        let ln_factorial = &self.ln_factorials;
        let ln_term = |k: usize| {
            ln_factorial[pixels] - ln_factorial[k] - ln_factorial[pixels - k]
                + k as f64 * self.ln_chance
                + (pixels - k) as f64 * self.ln_rest
        };
        // The tail relative to its first term; terms fall by a growing factor once past the mean.
        let first = ln_term(aligned);
        let mut sum = 1.0;
        for k in aligned + 1..=pixels {
            let term = (ln_term(k) - first).exp();
            sum += term;
            if term < 1e-9 * sum {
                break;
            }
        }
        self.ln_tests + (first + sum.ln()).min(0.0)
    }

    fn grow(&mut self, to: usize) {
        if self.ln_factorials.is_empty() {
            self.ln_factorials.push(0.0);
        }
        while self.ln_factorials.len() <= to {
            let k = self.ln_factorials.len();
            let last = self.ln_factorials[k - 1];
            self.ln_factorials.push(last + (k as f64).ln());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tails_of_small_binomials() {
        let mut significance = Significance::default();
        significance.prepare(1, 1, 0.125);
        // One image pixel: one test, the logarithm is that of the tail itself.
        let all = significance.ln_false_alarms(4, 4);
        assert!((all - 4.0 * 0.125_f64.ln()).abs() < 1e-12);
        let at_least_one = significance.ln_false_alarms(3, 1);
        assert!((at_least_one - (1.0 - 0.875_f64.powi(3)).ln()).abs() < 1e-12);
        assert_eq!(significance.ln_false_alarms(9, 0), 0.0);
    }

    #[test]
    fn the_shortest_meaningful_segment_of_a_vga_image() {
        let mut significance = Significance::default();
        significance.prepare(640, 480, 0.125);
        let least = significance.least_length(1.0);
        assert_eq!(least, 13);
        assert!(significance.ln_false_alarms(least, least) <= 0.0);
        assert!(significance.ln_false_alarms(least - 1, least - 1) > 0.0);
        // Half of the pixels aligned is meaningful for a long segment; an eighth is expected in noise.
        assert!(significance.ln_false_alarms(100, 50) < 0.0);
        assert!(significance.ln_false_alarms(100, 13) > 0.0);
    }
}
