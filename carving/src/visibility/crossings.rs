//! Per cell the observations that pass through it, in pooled chunks.
//!
//! An entry holds the number of an observation and where the observation enters the cell. A withdrawn observation gives up
//! its number, and its entries stay as *stale* ones until their lists are taken or swept: looking for them would cost more
//! than all the rest of the withdrawal. Each withdrawal sweeps a number of lists in proportion to the entries that it made
//! stale, so stale entries stay a bounded share; a number is given out again once no list can hold it.

use crate::tetrahedralization::CellId;

use super::ObservationId;

/// Bits of an entry that say where the observation enters the cell.
const ENTRANCE_BITS: u32 = 3;
/// Entries swept for each one that became stale.
const SWEPT_PER_STALE: u64 = 4;

/// Where an observation enters a cell, on its way from its vertex to the centre of its view.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) enum Entrance {
    /// Through the open interior of this facet.
    Facet(u8),
    /// At its vertex, a corner of the cell.
    Start,
    /// Not known.
    Unknown,
}

impl Entrance {
    #[inline]
    fn bits(self) -> u32 {
        match self {
            Entrance::Facet(facet) => facet.into(),
            Entrance::Start => 4,
            Entrance::Unknown => 5,
        }
    }
}

/// An entry of a list.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(crate) struct Entry(u32);

impl Entry {
    #[inline]
    fn new(id: ObservationId, entrance: Entrance) -> Self {
        Self(id.0 << ENTRANCE_BITS | entrance.bits())
    }

    #[inline]
    pub(crate) fn id(self) -> ObservationId {
        ObservationId(self.0 >> ENTRANCE_BITS)
    }

    #[inline]
    pub(crate) fn entrance(self) -> Entrance {
        match self.0 & ((1 << ENTRANCE_BITS) - 1) {
            4 => Entrance::Start,
            5 => Entrance::Unknown,
            facet => Entrance::Facet(facet as u8),
        }
    }
}

/// Observations in one chunk; with the link a chunk is 64 bytes, one cache line.
const CHUNK_LEN: usize = 15;
const NO_CHUNK: u32 = u32::MAX;

/// Entries, and in the last slot the next chunk.
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
    /// Whether there are lists; otherwise entries are counted only.
    has_lists: bool,
    lists: Vec<List>,
    chunks: Vec<Chunk>,
    free: u32,
    /// Number of entries, and how many of them are stale.
    total: u64,
    stale: u64,
    /// One bit for each number that was withdrawn and may be listed still.
    is_withdrawn: Vec<u64>,
    /// The list to sweep next.
    cursor: usize,
    /// Numbers withdrawn before and since the cursor was at the first list.
    withdrawn: [Vec<u32>; 2],
}

impl Crossings {
    /// No entries, and lists of them where asked for.
    pub(crate) fn new(has_lists: bool) -> Self {
        Self {
            has_lists,
            lists: Vec::new(),
            chunks: Vec::new(),
            free: NO_CHUNK,
            total: 0,
            stale: 0,
            is_withdrawn: Vec::new(),
            cursor: 0,
            withdrawn: [Vec::new(), Vec::new()],
        }
    }

    /// Largest number of an observation.
    pub(crate) const MAX_ID: usize = (u32::MAX >> ENTRANCE_BITS) as usize;

    /// Whether there are lists; otherwise entries are counted only.
    pub(crate) fn has_lists(&self) -> bool {
        self.has_lists
    }

    /// Makes room for cells with index below `cells`.
    pub(crate) fn grow(&mut self, cells: usize) {
        if self.has_lists && self.lists.len() < cells {
            self.lists.resize(cells, List::EMPTY);
        }
    }

    /// Number of entries of the list of `cell`, stale ones included.
    pub(crate) fn listed(&self, cell: CellId) -> u64 {
        self.lists
            .get(cell.index())
            .map_or(0, |list| list.len.into())
    }

    /// Number of entries of all lists.
    pub(crate) fn total(&self) -> u64 {
        self.total - self.stale
    }

    /// Whether the number was withdrawn.
    #[inline]
    fn is_stale(&self, id: ObservationId) -> bool {
        let word = self.is_withdrawn.get((id.0 / 64) as usize);
        word.is_some_and(|word| word >> (id.0 % 64) & 1 != 0)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.lists.capacity() * size_of::<List>() + self.chunks.capacity() * size_of::<Chunk>()
    }

    /// Adds an observation that is not in the list of `cell`.
    #[inline]
    pub(crate) fn add(&mut self, cell: CellId, id: ObservationId, entrance: Entrance) {
        self.total += 1;
        if !self.has_lists {
            return;
        }
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
        self.chunks[list.first as usize][slot] = Entry::new(id, entrance).0;
        list.len += 1;
    }

    /// Withdraws an observation, which `entries` cells list; its number is given out again by [`sweep`](Self::sweep).
    pub(crate) fn withdraw(&mut self, id: ObservationId, entries: usize) {
        let word = (id.0 / 64) as usize;
        if self.is_withdrawn.len() <= word {
            self.is_withdrawn.resize(word + 1, 0);
        }
        self.is_withdrawn[word] |= 1 << (id.0 % 64);
        self.withdrawn[1].push(id.0);
        self.stale += entries as u64;
    }

    /// Drops stale entries, looking at a few for each of `stale` new ones. Appends the numbers that no list has any more.
    pub(crate) fn sweep(&mut self, stale: usize, unlisted: &mut Vec<u32>) {
        let mut budget = SWEPT_PER_STALE * stale as u64;
        while budget > 0 {
            if self.cursor == self.lists.len() {
                self.cursor = 0;
                self.release_withdrawn(unlisted);
                if self.withdrawn[0].is_empty() {
                    return;
                }
            }
            let cell = CellId::from_index(self.cursor);
            self.cursor += 1;
            let listed = self.listed(cell);
            if listed > 0 {
                let before = self.total;
                self.retain_entries(cell, |crossings, id| !crossings.is_stale(id));
                self.stale -= before - self.total;
            }
            budget = budget.saturating_sub(listed + 1);
        }
    }

    /// Appends the numbers withdrawn before the cursor was at the first list last.
    fn release_withdrawn(&mut self, unlisted: &mut Vec<u32>) {
        for &id in &self.withdrawn[0] {
            self.is_withdrawn[(id / 64) as usize] &= !(1 << (id % 64));
        }
        unlisted.append(&mut self.withdrawn[0]);
        self.withdrawn.swap(0, 1);
    }

    /// Drops the observations from the list of `cell` that do not satisfy `keep`.
    pub(crate) fn retain(&mut self, cell: CellId, keep: impl Fn(ObservationId) -> bool) {
        self.retain_entries(cell, |_, id| keep(id));
    }

    fn retain_entries(&mut self, cell: CellId, keep: impl Fn(&Self, ObservationId) -> bool) {
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
                kept += usize::from(keep(self, Entry(slots[slot]).id()));
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
            let entry = Entry(self.chunks[chunk as usize][slot]);
            if slot == 0 {
                chunk = self.chunks[chunk as usize][CHUNK_LEN];
                slot = CHUNK_LEN;
            }
            Some(entry.id())
        })
        .filter(|id| !self.is_stale(*id))
    }

    /// Empties the list of `cell` into `entries`, which is cleared first.
    pub(crate) fn take(&mut self, cell: CellId, entries: &mut Vec<Entry>) {
        entries.clear();
        let list = std::mem::replace(&mut self.lists[cell.index()], List::EMPTY);
        self.total -= u64::from(list.len);
        let (mut chunk, mut len) = (list.first, list.first_len());
        while chunk != NO_CHUNK {
            let slots = &self.chunks[chunk as usize];
            let taken = slots[..len].iter().map(|&entry| Entry(entry));
            entries.extend(taken.filter(|entry| !self.is_stale(entry.id())));
            let next = slots[CHUNK_LEN];
            self.release(chunk);
            chunk = next;
            len = CHUNK_LEN;
        }
        self.stale -= u64::from(list.len) - entries.len() as u64;
    }

    /// Empties all lists. Appends the numbers that were withdrawn.
    pub(crate) fn clear(&mut self, unlisted: &mut Vec<u32>) {
        unlisted.append(&mut self.withdrawn[0]);
        unlisted.append(&mut self.withdrawn[1]);
        self.is_withdrawn.clear();
        self.cursor = 0;
        self.stale = 0;
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
        let mut crossings = Crossings::new(true);
        crossings.grow(2);
        let [one, two] = [0, 1].map(CellId::from_index);
        for id in 0..100 {
            crossings.add(one, ObservationId(id), Entrance::Unknown);
            crossings.add(two, ObservationId(id + 1000), Entrance::Unknown);
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
        let mut crossings = Crossings::new(true);
        crossings.grow(1);
        let cell = CellId::from_index(0);
        for count in 0..64u32 {
            // Multiplicative hashing makes the choices irregular.
            for choice in 0..40u32 {
                let keep = |r: u32| (r + 1).wrapping_mul(choice * 0x9e37 + 1) >> 3 & 3 < choice % 5;
                for id in 0..count {
                    crossings.add(cell, ObservationId(id), Entrance::Unknown);
                }
                crossings.retain(cell, |id| keep(id.0));
                let mut rest: Vec<u32> = crossings.of(cell).map(|id| id.0).collect();
                rest.sort_unstable();
                let expected: Vec<u32> = (0..count).filter(|&r| keep(r)).collect();
                assert_eq!(rest, expected, "{count} {choice}");
                assert_eq!(crossings.total(), expected.len() as u64);
                crossings.add(cell, ObservationId(1000), Entrance::Unknown);
                assert_eq!(crossings.of(cell).count(), expected.len() + 1);
                crossings.clear(&mut vec![]);
            }
        }
    }

    #[test]
    fn withdrawn_numbers_are_unlisted_at_once_and_given_out_again_later() {
        let mut crossings = Crossings::new(true);
        crossings.grow(40);
        for id in 0..200 {
            for cell in (0..40).map(CellId::from_index) {
                crossings.add(cell, ObservationId(id), Entrance::Facet(3));
            }
        }
        let mut unlisted = vec![];
        for id in 0..200 {
            crossings.withdraw(ObservationId(id), 40);
            let expected = 40 * (199 - u64::from(id));
            assert_eq!(crossings.total(), expected);
            let listed: usize = (0..40)
                .map(|cell| crossings.of(CellId::from_index(cell)).count())
                .sum();
            assert_eq!(listed as u64, expected);
            crossings.sweep(40, &mut unlisted);
            for &id in &unlisted {
                assert!(!crossings.lists.iter().any(|list| {
                    let (mut chunk, mut len) = (list.first, list.first_len());
                    let mut is_listed = false;
                    while chunk != NO_CHUNK {
                        let slots = &crossings.chunks[chunk as usize];
                        is_listed |= slots[..len].iter().any(|&e| Entry(e).id().0 == id);
                        chunk = slots[CHUNK_LEN];
                        len = CHUNK_LEN;
                    }
                    is_listed
                }));
            }
        }
        assert!(unlisted.len() > 150, "{}", unlisted.len());
        crossings.clear(&mut unlisted);
        unlisted.sort_unstable();
        assert_eq!(unlisted, (0..200).collect::<Vec<_>>());
    }

    #[test]
    fn an_entry_says_where_the_observation_enters() {
        let mut crossings = Crossings::new(true);
        crossings.grow(1);
        let cell = CellId::from_index(0);
        let entrances = [
            Entrance::Facet(0),
            Entrance::Facet(3),
            Entrance::Start,
            Entrance::Unknown,
        ];
        for (id, entrance) in (7..).zip(entrances) {
            crossings.add(cell, ObservationId(id), entrance);
        }
        let mut entries = vec![];
        crossings.take(cell, &mut entries);
        let taken: Vec<Entrance> = entries.iter().map(|entry| entry.entrance()).collect();
        assert_eq!(taken, entrances);
        assert_eq!(entries[1].id(), ObservationId(8));
    }

    #[test]
    fn freed_chunks_are_used_again() {
        let mut crossings = Crossings::new(true);
        crossings.grow(1);
        let cell = CellId::from_index(0);
        let mut ids = vec![];
        for round in 0..50 {
            for id in 0..40 {
                crossings.add(cell, ObservationId(round * 40 + id), Entrance::Unknown);
            }
            crossings.take(cell, &mut ids);
        }
        assert_eq!(crossings.chunks.len(), 3);
    }
}
