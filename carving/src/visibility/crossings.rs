//! Per cell the observations that pass through it, in pooled chunks.

use crate::tetrahedralization::CellId;

use super::ObservationId;

/// Observations in one chunk; with the link a chunk is 64 bytes, one cache line.
const CHUNK_LEN: usize = 15;
const NO_CHUNK: u32 = u32::MAX;

/// Ids, and in the last slot the next chunk.
type Chunk = [u32; CHUNK_LEN + 1];

/// One cell's list: all chunks are full but the first.
#[derive(Clone, Copy, Debug)]
struct List {
    first: u32,
    len: u32,
}

impl List {
    const EMPTY: List = List {
        first: NO_CHUNK,
        len: 0,
    };

    /// Number of ids in the first chunk.
    #[inline]
    fn first_len(&self) -> usize {
        match self.len as usize % CHUNK_LEN {
            0 if self.len > 0 => CHUNK_LEN,
            rest => rest,
        }
    }
}

/// For each cell the observations that pass through it or run in its boundary.
///
/// 8 bytes a cell and 64 bytes for each 15 entries begun. A freed chunk is the next to be used.
#[derive(Clone, Debug)]
pub(crate) struct Crossings {
    lists: Vec<List>,
    chunks: Vec<Chunk>,
    free: u32,
    total: u64,
}

impl Default for Crossings {
    fn default() -> Self {
        Self {
            lists: Vec::new(),
            chunks: Vec::new(),
            free: NO_CHUNK,
            total: 0,
        }
    }
}

impl Crossings {
    /// Makes room for cells with index below `cells`.
    pub(crate) fn grow(&mut self, cells: usize) {
        if self.lists.len() < cells {
            self.lists.resize(cells, List::EMPTY);
        }
    }

    /// Number of entries of the list of `cell`.
    pub(crate) fn listed(&self, cell: CellId) -> u64 {
        self.lists
            .get(cell.index())
            .map_or(0, |list| list.len.into())
    }

    /// Number of entries of all lists.
    pub(crate) fn total(&self) -> u64 {
        self.total
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.lists.capacity() * size_of::<List>() + self.chunks.capacity() * size_of::<Chunk>()
    }

    /// Adds an observation that is not in the list of `cell`.
    #[inline]
    pub(crate) fn add(&mut self, cell: CellId, id: ObservationId) {
        let list = &mut self.lists[cell.index()];
        let slot = list.len as usize % CHUNK_LEN;
        if slot == 0 {
            let next = list.first;
            let mut chunk = [0; CHUNK_LEN + 1];
            chunk[CHUNK_LEN] = next;
            if self.free == NO_CHUNK {
                list.first = self.chunks.len() as u32;
                self.chunks.push(chunk);
            } else {
                list.first = self.free;
                let freed = &mut self.chunks[self.free as usize];
                self.free = freed[CHUNK_LEN];
                *freed = chunk;
            }
        }
        self.chunks[list.first as usize][slot] = id.0;
        list.len += 1;
        self.total += 1;
    }

    /// Drops the observations from the list of `cell` that do not satisfy `keep`.
    pub(crate) fn retain(&mut self, cell: CellId, keep: impl Fn(ObservationId) -> bool) {
        let list = self.lists[cell.index()];
        // Chunks that are full again, the one that is not, and how many ids that one has.
        let (mut full, mut partial, mut partial_len) = (NO_CHUNK, NO_CHUNK, 0);
        let mut kept_count = 0;
        let (mut chunk, mut len) = (list.first, list.first_len());
        while chunk != NO_CHUNK {
            let mut slots = self.chunks[chunk as usize];
            let next = slots[CHUNK_LEN];
            let mut kept = 0;
            for slot in 0..len {
                slots[kept] = slots[slot];
                kept += usize::from(keep(ObservationId(slots[slot])));
            }
            kept_count += kept;
            // Fill up from the partial chunk.
            let moved = partial_len.min(CHUNK_LEN - kept);
            if moved > 0 {
                let source = &self.chunks[partial as usize][partial_len - moved..partial_len];
                slots[kept..kept + moved].copy_from_slice(source);
                partial_len -= moved;
                kept += moved;
            }
            let is_full = kept == CHUNK_LEN;
            slots[CHUNK_LEN] = if is_full { full } else { NO_CHUNK };
            self.chunks[chunk as usize] = slots;
            if is_full {
                full = chunk;
            } else {
                // The partial chunk is empty now.
                self.release(partial);
                (partial, partial_len) = (chunk, kept);
            }
            chunk = next;
            len = CHUNK_LEN;
        }
        if partial_len == 0 {
            self.release(partial);
            partial = full;
        } else {
            self.chunks[partial as usize][CHUNK_LEN] = full;
        }
        self.total -= u64::from(list.len) - kept_count as u64;
        self.lists[cell.index()] = List {
            first: partial,
            len: kept_count as u32,
        };
    }

    /// Makes a chunk, if it is one, the next to be used.
    fn release(&mut self, chunk: u32) {
        if chunk != NO_CHUNK {
            self.chunks[chunk as usize][CHUNK_LEN] = self.free;
            self.free = chunk;
        }
    }

    /// Whether the list of `cell` has an observation; linear in the length of the list.
    pub(crate) fn contains(&self, cell: CellId, id: ObservationId) -> bool {
        self.of(cell).any(|other| other == id)
    }

    /// The list of `cell`, in an order that depends on history.
    pub(crate) fn of(&self, cell: CellId) -> impl Iterator<Item = ObservationId> + '_ {
        let list = self.lists[cell.index()];
        let (mut chunk, mut slot) = (list.first, list.first_len());
        std::iter::from_fn(move || {
            if chunk == NO_CHUNK {
                return None;
            }
            slot -= 1;
            let id = self.chunks[chunk as usize][slot];
            if slot == 0 {
                chunk = self.chunks[chunk as usize][CHUNK_LEN];
                slot = CHUNK_LEN;
            }
            Some(ObservationId(id))
        })
    }

    /// Empties the list of `cell` into `ids`, which is cleared first.
    pub(crate) fn take(&mut self, cell: CellId, ids: &mut Vec<ObservationId>) {
        ids.clear();
        let list = std::mem::replace(&mut self.lists[cell.index()], List::EMPTY);
        self.total -= u64::from(list.len);
        let (mut chunk, mut len) = (list.first, list.first_len());
        while chunk != NO_CHUNK {
            let slots = &self.chunks[chunk as usize];
            ids.extend(slots[..len].iter().map(|&id| ObservationId(id)));
            let next = slots[CHUNK_LEN];
            self.release(chunk);
            chunk = next;
            len = CHUNK_LEN;
        }
    }

    /// Empties all lists.
    pub(crate) fn clear(&mut self) {
        self.lists.fill(List::EMPTY);
        self.chunks.clear();
        self.free = NO_CHUNK;
        self.total = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_keep_what_is_added_and_forget_what_is_removed() {
        let mut crossings = Crossings::default();
        crossings.grow(2);
        let [one, two] = [0, 1].map(CellId::from_index);
        for id in 0..100 {
            crossings.add(one, ObservationId(id));
            crossings.add(two, ObservationId(id + 1000));
        }
        assert_eq!(crossings.of(one).count(), 100);
        crossings.retain(one, |id| id.0 % 3 != 0);
        let mut rest: Vec<u32> = crossings.of(one).map(|id| id.0).collect();
        rest.sort_unstable();
        assert_eq!(rest, (0..100).filter(|r| r % 3 != 0).collect::<Vec<_>>());
        let mut taken = vec![];
        crossings.take(two, &mut taken);
        assert_eq!((taken.len(), crossings.of(two).count()), (100, 0));
        for id in rest {
            assert!(crossings.contains(one, ObservationId(id)));
        }
        assert!(!crossings.contains(one, ObservationId(3)));
        assert_eq!(crossings.total(), 66);
        crossings.retain(one, |_| false);
        assert_eq!((crossings.total(), crossings.of(one).count()), (0, 0));
    }

    #[test]
    fn any_choice_of_entries_can_be_dropped() {
        let mut crossings = Crossings::default();
        crossings.grow(1);
        let cell = CellId::from_index(0);
        for count in 0..64u32 {
            // Multiplicative hashing makes the choices irregular.
            for choice in 0..40u32 {
                let keep = |r: u32| (r + 1).wrapping_mul(choice * 0x9e37 + 1) >> 3 & 3 < choice % 5;
                for id in 0..count {
                    crossings.add(cell, ObservationId(id));
                }
                crossings.retain(cell, |id| keep(id.0));
                let mut rest: Vec<u32> = crossings.of(cell).map(|id| id.0).collect();
                rest.sort_unstable();
                let expected: Vec<u32> = (0..count).filter(|&r| keep(r)).collect();
                assert_eq!(rest, expected, "{count} {choice}");
                assert_eq!(crossings.total(), expected.len() as u64);
                crossings.add(cell, ObservationId(1000));
                assert_eq!(crossings.of(cell).count(), expected.len() + 1);
                crossings.clear();
            }
        }
    }

    #[test]
    fn freed_chunks_are_used_again() {
        let mut crossings = Crossings::default();
        crossings.grow(1);
        let cell = CellId::from_index(0);
        let mut ids = vec![];
        for round in 0..50 {
            for id in 0..40 {
                crossings.add(cell, ObservationId(round * 40 + id));
            }
            crossings.take(cell, &mut ids);
        }
        assert_eq!(crossings.chunks.len(), 3);
    }
}
