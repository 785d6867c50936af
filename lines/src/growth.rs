//! How arrays grow that live as long as a map.

/// Appends an element. A full array grows by a quarter, where `Vec` would double it.
///
/// # Complexity
/// Amortised, an element is copied at most five times.
pub(crate) fn push<T>(array: &mut Vec<T>, element: T) {
    if array.len() == array.capacity() {
        array.reserve_exact((array.len() / 4).max(16));
    }
    array.push(element);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_grow_by_a_quarter() {
        let mut array = Vec::new();
        for number in 0..1000 {
            push(&mut array, number);
        }
        assert!(array.iter().copied().eq(0..1000));
        assert!((1000..1300).contains(&array.capacity()));
    }
}
