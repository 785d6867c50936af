//! Per cell the observations that pass through it, in pooled chunks.
//!
//! An entry holds the number of an observation and where the observation enters the cell. A withdrawn observation gives up
//! its number, and its entries stay as *stale* ones until their lists are taken or swept: looking for them would cost more
//! than all the rest of the withdrawal. Each withdrawal sweeps a number of lists in proportion to the entries that it made
//! stale, so stale entries stay a bounded share; a number is given out again once no list can hold it.

use crate::growth::{reserve, resize};
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

/// Most observations of a short list, which has 32 bytes of its own in place of chunks. Most lists are short.
const SHORT_LEN: usize = 8;

/// The entries of a short list.
type Short = [u32; SHORT_LEN];

/// One cell's list: the entries of a short one, or chunks, all of which are full but the first.
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

    #[inline]
    fn is_short(&self) -> bool {
        self.len as usize <= SHORT_LEN
    }

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
/// 8 bytes a cell, 32 bytes for each list of up to 8 entries, and 64 bytes for each 15 entries begun of others. Freed memory is the next
/// to be used.
#[derive(Clone, Debug)]
pub(crate) struct Crossings {
    /// Whether there are lists; otherwise entries are counted only.
    has_lists: bool,
    lists: Vec<List>,
    chunks: Vec<Chunk>,
    free: u32,
    shorts: Vec<Short>,
    free_short: u32,
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
            shorts: Vec::new(),
            free_short: NO_CHUNK,
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
        if self.has_lists {
            resize(&mut self.lists, cells, List::EMPTY);
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
        self.lists.capacity() * size_of::<List>()
            + self.chunks.capacity() * size_of::<Chunk>()
            + self.shorts.capacity() * size_of::<Short>()
    }

    /// Adds an observation that is not in the list of `cell`.
    #[inline]
    pub(crate) fn add(&mut self, cell: CellId, id: ObservationId, entrance: Entrance) {
        self.total += 1;
        if self.has_lists {
            self.list(cell, id, entrance);
        }
    }

    fn list(&mut self, cell: CellId, id: ObservationId, entrance: Entrance) {
        let entry = Entry::new(id, entrance).0;
        let List { first, len } = self.lists[cell.index()];
        let first = match len as usize {
            0 => self.new_short(entry),
            len @ 1..SHORT_LEN => {
                self.shorts[first as usize][len] = entry;
                first
            }
            SHORT_LEN => {
                let mut chunk = [0; CHUNK_LEN + 1];
                chunk[..SHORT_LEN].copy_from_slice(&self.shorts[first as usize]);
                chunk[SHORT_LEN] = entry;
                chunk[CHUNK_LEN] = NO_CHUNK;
                self.release_short(first);
                self.new_chunk(chunk)
            }
            len if len % CHUNK_LEN == 0 => {
                let mut chunk = [0; CHUNK_LEN + 1];
                chunk[0] = entry;
                chunk[CHUNK_LEN] = first;
                self.new_chunk(chunk)
            }
            len => {
                self.chunks[first as usize][len % CHUNK_LEN] = entry;
                first
            }
        };
        self.lists[cell.index()] = List {
            first,
            len: len + 1,
        };
    }

    /// Puts a chunk in its place.
    #[inline]
    fn new_chunk(&mut self, chunk: Chunk) -> u32 {
        let place = self.free;
        if place == NO_CHUNK {
            reserve(&mut self.chunks, 1);
            self.chunks.push(chunk);
            return (self.chunks.len() - 1) as u32;
        }
        let freed = &mut self.chunks[place as usize];
        self.free = freed[CHUNK_LEN];
        *freed = chunk;
        place
    }

    /// Makes a short list of one entry.
    #[inline]
    fn new_short(&mut self, entry: u32) -> u32 {
        let mut short = [0; SHORT_LEN];
        short[0] = entry;
        let place = self.free_short;
        if place == NO_CHUNK {
            reserve(&mut self.shorts, 1);
            self.shorts.push(short);
            return (self.shorts.len() - 1) as u32;
        }
        let freed = &mut self.shorts[place as usize];
        self.free_short = freed[0];
        *freed = short;
        place
    }

    /// Makes the memory of a short list, if it has one, the next to be used.
    #[inline]
    fn release_short(&mut self, short: u32) {
        if short != NO_CHUNK {
            self.shorts[short as usize][0] = self.free_short;
            self.free_short = short;
        }
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

    fn retain_entries(&mut self, cell: CellId, keep: impl Fn(&Self, ObservationId) -> bool) {
        let list = self.lists[cell.index()];
        if list.is_short() {
            self.retain_short(cell, keep);
            return;
        }
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
        let len = kept_count as u32;
        if (1..=SHORT_LEN).contains(&kept_count) {
            // All of them are in the chunk that is not full.
            let slots = self.chunks[partial as usize];
            self.release(partial);
            partial = self.new_short(slots[0]);
            self.shorts[partial as usize].copy_from_slice(&slots[..SHORT_LEN]);
        }
        self.lists[cell.index()] = List {
            first: partial,
            len,
        };
    }

    fn retain_short(&mut self, cell: CellId, keep: impl Fn(&Self, ObservationId) -> bool) {
        let list = self.lists[cell.index()];
        if list.len == 0 {
            return;
        }
        let mut entries = self.shorts[list.first as usize];
        let mut kept = 0;
        for slot in 0..list.len as usize {
            entries[kept] = entries[slot];
            kept += usize::from(keep(self, Entry(entries[slot]).id()));
        }
        self.total -= u64::from(list.len) - kept as u64;
        self.shorts[list.first as usize] = entries;
        if kept == 0 {
            self.release_short(list.first);
        }
        self.lists[cell.index()] = match kept {
            0 => List::EMPTY,
            kept => List {
                first: list.first,
                len: kept as u32,
            },
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
        let list = self.lists.get(cell.index()).unwrap_or(&List::EMPTY);
        let ids = self.stored(list).map(Entry::id);
        ids.filter(|id| !self.is_stale(*id))
    }

    /// All entries of a list, stale ones included.
    fn stored(&self, list: &List) -> impl Iterator<Item = Entry> + '_ {
        let (short, mut chunk) = match *list {
            List { len: 0, .. } => (&[][..], NO_CHUNK),
            List { first, len } if list.is_short() => {
                (&self.shorts[first as usize][..len as usize], NO_CHUNK)
            }
            List { first, .. } => (&[][..], first),
        };
        let mut slot = list.first_len();
        let chunked = std::iter::from_fn(move || {
            if chunk == NO_CHUNK {
                return None;
            }
            slot -= 1;
            let entry = self.chunks[chunk as usize][slot];
            if slot == 0 {
                chunk = self.chunks[chunk as usize][CHUNK_LEN];
                slot = CHUNK_LEN;
            }
            Some(entry)
        });
        short.iter().copied().chain(chunked).map(Entry)
    }

    /// Empties the list of `cell` into `entries`, which is cleared first.
    pub(crate) fn take(&mut self, cell: CellId, entries: &mut Vec<Entry>) {
        entries.clear();
        let list = std::mem::replace(&mut self.lists[cell.index()], List::EMPTY);
        self.total -= u64::from(list.len);
        if list.len == 0 {
            return;
        }
        let is_listed = |entry: &Entry| !self.is_stale(entry.id());
        if list.is_short() {
            let listed = &self.shorts[list.first as usize][..list.len as usize];
            entries.extend(listed.iter().map(|&entry| Entry(entry)).filter(is_listed));
            self.release_short(list.first);
            self.stale -= u64::from(list.len) - entries.len() as u64;
            return;
        }
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
        self.shorts.clear();
        self.free_short = NO_CHUNK;
        self.total = 0;
    }
}

#[cfg(test)]
mod tests;
