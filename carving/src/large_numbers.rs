//! Whole numbers in 32 bits each, with a table for the few that are larger.

use rustc_hash::FxHashMap;

/// The numbers that do not fit into 32 bits, by a key of the owner's choosing. In place of each the owner stores [`IS_LARGE`].
#[derive(Clone, Debug, Default)]
pub(crate) struct LargeNumbers(FxHashMap<u64, u64>);

/// Marks a number that is in the table.
pub(crate) const IS_LARGE: u32 = u32::MAX;

impl LargeNumbers {
    /// The number that is stored as `stored`.
    #[inline]
    pub(crate) fn get(&self, stored: u32, key: u64) -> u64 {
        match stored {
            IS_LARGE => self.get_large(key),
            small => small.into(),
        }
    }

    #[cold]
    #[inline(never)]
    fn get_large(&self, key: u64) -> u64 {
        self.0[&key]
    }

    /// Replaces the number that is stored in `stored`.
    #[inline]
    pub(crate) fn set(&mut self, stored: &mut u32, key: u64, number: u64) {
        if *stored != IS_LARGE && number < IS_LARGE.into() {
            *stored = number as u32;
        } else {
            self.set_large(stored, key, number);
        }
    }

    #[cold]
    #[inline(never)]
    fn set_large(&mut self, stored: &mut u32, key: u64, number: u64) {
        if number < IS_LARGE.into() {
            *stored = number as u32;
            self.0.remove(&key);
        } else {
            *stored = IS_LARGE;
            self.0.insert(key, number);
        }
    }

    /// Empties the table, when no number is stored any more.
    pub(crate) fn clear(&mut self) {
        self.0.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_any_size_are_kept() {
        let mut large = LargeNumbers::default();
        let mut stored = [0_u32; 2];
        let limit = u64::from(u32::MAX);
        for number in [0, 7, limit - 1, limit, limit + 1, u64::MAX, 3, limit, 0] {
            large.set(&mut stored[0], 10, number);
            large.set(&mut stored[1], 11, u64::MAX - number);
            assert_eq!(large.get(stored[0], 10), number);
            assert_eq!(large.get(stored[1], 11), u64::MAX - number);
        }
        large.set(&mut stored[1], 11, 1);
        assert!(large.0.is_empty());
    }
}
