//! The median of numbers.

use std::cmp::Ordering;

/// The median by `order`, the larger of two middle values; `None` of no values. Changes the order of the values.
///
/// # Complexity
/// Linear.
pub fn upper_median<T: Copy>(values: &mut [T], order: impl FnMut(&T, &T) -> Ordering) -> Option<T> {
    let middle = values.len() / 2;
    (middle < values.len()).then(|| *values.select_nth_unstable_by(middle, order).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_needs_no_order() {
        assert_eq!(
            upper_median(&mut [3.0, 1.0, 2.0], f64::total_cmp),
            Some(2.0)
        );
        assert_eq!(
            upper_median(&mut [3.0, 1.0, 2.0, 4.0], f64::total_cmp),
            Some(3.0)
        );
        assert_eq!(upper_median(&mut [], f64::total_cmp), None);
    }
}
