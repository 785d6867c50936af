//! Sorting of many items with few keys each, by counting.

/// Items in buckets, which are numbered; those of a bucket are sorted and have no duplicates.
pub(crate) struct Buckets<T> {
    /// Where each bucket begins, and where the last one ends.
    begins: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy + Ord> Buckets<T> {
    /// Items with their buckets, which are less than `count`.
    ///
    /// # Complexity
    ///
    /// Linear, as long as few items share a bucket.
    pub(crate) fn new(count: usize, keyed: impl Iterator<Item = (u32, T)> + Clone) -> Self {
        let mut begins = vec![0_u32; count + 1];
        let mut first = None;
        for (bucket, item) in keyed.clone() {
            begins[bucket as usize + 1] += 1;
            first = Some(item);
        }
        let mut total = 0;
        for begin in &mut begins {
            total += *begin;
            *begin = total;
        }
        let mut items: Vec<T> = first.map_or_else(Vec::new, |item| vec![item; total as usize]);
        let mut places = begins.clone();
        for (bucket, item) in keyed {
            let place = &mut places[bucket as usize];
            items[*place as usize] = item;
            *place += 1;
        }
        let mut kept = 0;
        for bucket in 0..count {
            let range = begins[bucket] as usize..begins[bucket + 1] as usize;
            begins[bucket] = kept as u32;
            items[range.clone()].sort_unstable();
            for at in range {
                if kept == begins[bucket] as usize || items[kept - 1] != items[at] {
                    items[kept] = items[at];
                    kept += 1;
                }
            }
        }
        begins[count] = kept as u32;
        items.truncate(kept);
        Self { begins, items }
    }

    /// The items of a bucket.
    pub(crate) fn of(&self, bucket: u32) -> &[T] {
        let bucket = bucket as usize;
        &self.items[self.begins[bucket] as usize..self.begins[bucket + 1] as usize]
    }

    /// Number of an item among all; `None` where its bucket does not have it.
    pub(crate) fn number(&self, bucket: u32, item: T) -> Option<u32> {
        let found = self.of(bucket).binary_search(&item).ok()?;
        Some(self.begins[bucket as usize] + found as u32)
    }

    /// All items with their buckets, in order.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (u32, T)> + '_ {
        let buckets = 0..self.begins.len() as u32 - 1;
        buckets.flat_map(|bucket| self.of(bucket).iter().map(move |&item| (bucket, item)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_are_sorted_by_bucket_and_each_is_there_once() {
        let keyed = [(2, 'x'), (0, 'b'), (2, 'a'), (0, 'b'), (2, 'x'), (4, 'q')];
        let buckets = Buckets::new(5, keyed.into_iter());
        let all: Vec<(u32, char)> = buckets.iter().collect();
        assert_eq!(all, [(0, 'b'), (2, 'a'), (2, 'x'), (4, 'q')]);
        assert_eq!(buckets.of(2), ['a', 'x']);
        assert_eq!(buckets.number(2, 'x'), Some(2));
        assert_eq!(buckets.number(3, 'x'), None);
        assert_eq!(Buckets::<u8>::new(0, [].into_iter()).iter().count(), 0);
    }
}
