//! Fixed records as little-endian bytes.

/// A value of fixed size in a file.
pub(crate) trait Record: Copy {
    const BYTES: usize;
    fn put(&self, out: &mut Vec<u8>);
    /// Reads from the first [`BYTES`](Self::BYTES), which must be there.
    fn get(bytes: &[u8]) -> Self;
}

macro_rules! numbers {
    ($($number:ty),*) => { $(
        impl Record for $number {
            const BYTES: usize = size_of::<$number>();
            fn put(&self, out: &mut Vec<u8>) {
                out.extend_from_slice(&self.to_le_bytes());
            }
            fn get(bytes: &[u8]) -> Self {
                let mut own = [0; size_of::<$number>()];
                own.copy_from_slice(&bytes[..size_of::<$number>()]);
                Self::from_le_bytes(own)
            }
        }
    )* };
}
numbers!(u8, u32, u64, i64, f64);

impl<T: Record, const N: usize> Record for [T; N] {
    const BYTES: usize = N * T::BYTES;
    fn put(&self, out: &mut Vec<u8>) {
        self.iter().for_each(|value| value.put(out));
    }
    fn get(bytes: &[u8]) -> Self {
        std::array::from_fn(|k| T::get(&bytes[k * T::BYTES..]))
    }
}

/// The bytes of a list.
pub(crate) fn encode<T: Record>(records: &[T]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(records.len() * T::BYTES);
    records.iter().for_each(|record| record.put(&mut bytes));
    bytes
}

/// The list of some bytes; `None` when they do not end with a record.
pub(crate) fn decode<T: Record>(bytes: &[u8]) -> Option<Vec<T>> {
    let is_whole = bytes.len().is_multiple_of(T::BYTES);
    is_whole.then(|| bytes.chunks_exact(T::BYTES).map(T::get).collect())
}

/// A ray to a vertex.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct RayRecord {
    pub(crate) view: u32,
    /// Number of its vertex in the tile.
    pub(crate) vertex: u32,
    pub(crate) weight: u32,
    /// Total weight of the rays to its point.
    pub(crate) support: u32,
    /// NaN when there is none.
    pub(crate) sigma: f64,
    pub(crate) target: [f64; 3],
}

impl Record for RayRecord {
    const BYTES: usize = 48;
    fn put(&self, out: &mut Vec<u8>) {
        [self.view, self.vertex, self.weight, self.support].put(out);
        self.sigma.put(out);
        self.target.put(out);
    }
    fn get(bytes: &[u8]) -> Self {
        let [view, vertex, weight, support] = <[u32; 4]>::get(bytes);
        Self {
            view,
            vertex,
            weight,
            support,
            sigma: f64::get(&bytes[16..]),
            target: <[f64; 3]>::get(&bytes[24..]),
        }
    }
}
