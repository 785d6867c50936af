//! Association of two lists of time stamps.

/// Candidates considered on each side of a stamp; bounds the work for very dense stamps.
const CANDIDATES: usize = 16;

/// One-to-one association: for each stamp of `left` the index of its partner in `right`. Pairs within
/// `max_difference_ns` are taken nearest first (ties: earlier left, then earlier right). Both lists ascend strictly.
///
/// # Complexity
/// O(n log n) in the total number of stamps.
pub(super) fn nearest_unique(
    left: &[i64],
    right: &[i64],
    max_difference_ns: i64,
) -> Vec<Option<usize>> {
    let mut pairs = Vec::new();
    for (i, &stamp) in left.iter().enumerate() {
        let middle = right.partition_point(|&other| other < stamp);
        let from = middle.saturating_sub(CANDIDATES);
        let to = (middle + CANDIDATES).min(right.len());
        for (j, &other) in (from..to).zip(&right[from..to]) {
            let difference = stamp.abs_diff(other);
            if difference <= max_difference_ns.unsigned_abs() {
                pairs.push((difference, i, j));
            }
        }
    }
    pairs.sort_unstable();
    let mut partner = vec![None; left.len()];
    let mut is_taken = vec![false; right.len()];
    for (_, i, j) in pairs {
        if partner[i].is_none() && !is_taken[j] {
            partner[i] = Some(j);
            is_taken[j] = true;
        }
    }
    partner
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_nearest_wins_and_none_is_used_twice() {
        assert_eq!(
            nearest_unique(&[0, 10, 20, 100], &[9, 12, 19, 50], 10),
            [None, Some(0), Some(2), None]
        );
        assert_eq!(nearest_unique(&[0, 4], &[3], 10), [None, Some(0)]);
        assert_eq!(nearest_unique(&[i64::MIN], &[i64::MAX], i64::MAX), [None]);
        assert_eq!(nearest_unique(&[], &[1], 5), []);
    }

    proptest! {
        #[test]
        fn partners_are_unique_and_near(
            left in prop::collection::btree_set(0_i64..300, 0..40),
            right in prop::collection::btree_set(0_i64..300, 0..40),
        ) {
            let (left, right): (Vec<_>, Vec<_>) = (left.into_iter().collect(), right.into_iter().collect());
            let partner = nearest_unique(&left, &right, 7);
            let mut used: Vec<usize> = partner.iter().flatten().copied().collect();
            let count = used.len();
            used.sort_unstable();
            used.dedup();
            prop_assert_eq!(used.len(), count);
            for (i, j) in partner.iter().enumerate() {
                match j {
                    Some(j) => prop_assert!(left[i].abs_diff(right[*j]) <= 7),
                    // Every unused candidate is too far away.
                    None => prop_assert!((0..right.len()).all(|k| used.contains(&k) || left[i].abs_diff(right[k]) > 7)),
                }
            }
        }
    }
}
