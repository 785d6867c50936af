//! How the large arrays grow: those by cell are most of the memory.

/// Makes room for `more` further elements in steps of a quarter of an array, where `Vec` would double it.
///
/// # Complexity
///
/// Amortised, an element is copied at most five times.
#[inline]
pub(crate) fn reserve<T>(array: &mut Vec<T>, more: usize) {
    if array.capacity() - array.len() < more {
        array.reserve_exact(more.max(array.len() / 4));
    }
}

/// Appends elements until there are `len`.
pub(crate) fn resize<T: Clone>(array: &mut Vec<T>, len: usize, element: T) {
    if array.len() < len {
        reserve(array, len - array.len());
        array.resize(len, element);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_grow_by_a_quarter() {
        let mut array = vec![0; 1000];
        array.shrink_to_fit();
        resize(&mut array, 1001, 5);
        assert_eq!((array.len(), array[1000]), (1001, 5));
        assert!((1250..1500).contains(&array.capacity()));
        resize(&mut array, 10, 5);
        assert_eq!(array.len(), 1001);
    }
}
