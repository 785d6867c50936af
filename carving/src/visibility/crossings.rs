//! Per cell the rays that cross it and their total weight, in pooled chunks.

use crate::tetrahedralization::CellId;

use super::rays::RayId;

/// Ray ids in one chunk; with the link a chunk is 64 bytes, one cache line.
const CHUNK_RAYS: usize = 15;
const NO_CHUNK: u32 = u32::MAX;

/// Ids, and in the last place the next chunk.
type Chunk = [u32; CHUNK_RAYS + 1];

/// One cell's list: all chunks are full but the first.
#[derive(Clone, Copy, Debug)]
struct List {
    weight: u64,
    first: u32,
    len: u32,
}

impl List {
    const EMPTY: List = List {
        weight: 0,
        first: NO_CHUNK,
        len: 0,
    };

    /// Number of ids in the first chunk.
    #[inline]
    fn first_len(&self) -> usize {
        match self.len as usize % CHUNK_RAYS {
            0 if self.len > 0 => CHUNK_RAYS,
            rest => rest,
        }
    }
}

/// The rays that cross each cell, and the sum of their weights. A list may also hold rays without weight, which run
/// in the boundary of the cell.
///
/// Indexed by cell; 16 bytes a cell and 64 bytes for each 15 rays begun. A freed chunk is the next to be used.
/// Sums are integers, so they do not depend on the order in which rays come and go.
#[derive(Clone, Debug)]
pub(crate) struct Crossings {
    lists: Vec<List>,
    chunks: Vec<Chunk>,
    free: u32,
    total: u64,
    /// Weight whose crossing is reported in `flipped`.
    watched: u64,
    /// Cells whose weight has passed the watched value upwards or downwards, possibly repeatedly.
    flipped: Vec<CellId>,
}

impl Crossings {
    /// No cells. Cells whose weight reaches `watched`, or falls below, are listed.
    pub(crate) fn new(watched: u64) -> Self {
        Self {
            lists: Vec::new(),
            chunks: Vec::new(),
            free: NO_CHUNK,
            total: 0,
            watched,
            flipped: Vec::new(),
        }
    }

    /// Makes room for cells with index below `cells`.
    pub(crate) fn grow(&mut self, cells: usize) {
        if self.lists.len() < cells {
            self.lists.resize(cells, List::EMPTY);
        }
    }

    /// Total weight of the rays across `cell`.
    #[inline]
    pub(crate) fn weight(&self, cell: CellId) -> u64 {
        self.lists[cell.index()].weight
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

    /// Adds a ray that is not in the list of `cell`.
    #[inline]
    pub(crate) fn add(&mut self, cell: CellId, ray: RayId, weight: u32) {
        self.push(cell, ray);
        let list = &mut self.lists[cell.index()];
        let before = list.weight;
        list.weight += u64::from(weight);
        if before < self.watched && list.weight >= self.watched {
            self.flipped.push(cell);
        }
    }

    #[inline]
    fn push(&mut self, cell: CellId, ray: RayId) {
        let list = &mut self.lists[cell.index()];
        let place = list.len as usize % CHUNK_RAYS;
        if place == 0 {
            let next = list.first;
            let mut chunk = [0; CHUNK_RAYS + 1];
            chunk[CHUNK_RAYS] = next;
            if self.free == NO_CHUNK {
                list.first = self.chunks.len() as u32;
                self.chunks.push(chunk);
            } else {
                list.first = self.free;
                let slot = &mut self.chunks[self.free as usize];
                self.free = slot[CHUNK_RAYS];
                *slot = chunk;
            }
        }
        self.chunks[list.first as usize][place] = ray.0;
        list.len += 1;
        self.total += 1;
    }

    /// Adds `weight` to a cell, without a change of its list.
    #[inline]
    pub(crate) fn burden(&mut self, cell: CellId, weight: u32) {
        let list = &mut self.lists[cell.index()];
        let before = list.weight;
        list.weight += u64::from(weight);
        if before < self.watched && list.weight >= self.watched {
            self.flipped.push(cell);
        }
    }

    /// Takes `weight` from a cell, without a look at its list.
    #[inline]
    pub(crate) fn lighten(&mut self, cell: CellId, weight: u32) {
        let list = &mut self.lists[cell.index()];
        let before = list.weight;
        list.weight -= u64::from(weight);
        if before >= self.watched && list.weight < self.watched {
            self.flipped.push(cell);
        }
    }

    /// Drops the rays from the list of `cell` that do not satisfy `keep`. The weight stays as it is.
    pub(crate) fn retain(&mut self, cell: CellId, keep: impl Fn(RayId) -> bool) {
        let list = self.lists[cell.index()];
        // Chunks that are full again, the one that is not, and how many ids that one has.
        let (mut full, mut partial, mut partial_len) = (NO_CHUNK, NO_CHUNK, 0);
        let mut kept_count = 0;
        let (mut chunk, mut len) = (list.first, list.first_len());
        while chunk != NO_CHUNK {
            let mut slots = self.chunks[chunk as usize];
            let next = slots[CHUNK_RAYS];
            let mut kept = 0;
            for place in 0..len {
                slots[kept] = slots[place];
                kept += usize::from(keep(RayId(slots[place])));
            }
            kept_count += kept;
            // Fill up from the partial chunk.
            let moved = partial_len.min(CHUNK_RAYS - kept);
            if moved > 0 {
                let source = &self.chunks[partial as usize][partial_len - moved..partial_len];
                slots[kept..kept + moved].copy_from_slice(source);
                partial_len -= moved;
                kept += moved;
            }
            let is_full = kept == CHUNK_RAYS;
            slots[CHUNK_RAYS] = if is_full { full } else { NO_CHUNK };
            self.chunks[chunk as usize] = slots;
            if is_full {
                full = chunk;
            } else {
                // The partial chunk is empty now.
                self.release(partial);
                (partial, partial_len) = (chunk, kept);
            }
            chunk = next;
            len = CHUNK_RAYS;
        }
        if partial_len == 0 {
            self.release(partial);
            partial = full;
        } else {
            self.chunks[partial as usize][CHUNK_RAYS] = full;
        }
        self.total -= u64::from(list.len) - kept_count as u64;
        self.lists[cell.index()] = List {
            first: partial,
            len: kept_count as u32,
            weight: list.weight,
        };
    }

    /// Makes a chunk, if it is one, the next to be used.
    fn release(&mut self, chunk: u32) {
        if chunk != NO_CHUNK {
            self.chunks[chunk as usize][CHUNK_RAYS] = self.free;
            self.free = chunk;
        }
    }

    /// Whether `ray` is in the list of `cell`; linear in the length of the list.
    pub(crate) fn contains(&self, cell: CellId, ray: RayId) -> bool {
        self.rays(cell).any(|r| r == ray)
    }

    /// The rays in the list of `cell`, in an order that depends on history.
    pub(crate) fn rays(&self, cell: CellId) -> impl Iterator<Item = RayId> + '_ {
        let list = self.lists[cell.index()];
        let (mut chunk, mut place) = (list.first, list.first_len());
        std::iter::from_fn(move || {
            if chunk == NO_CHUNK {
                return None;
            }
            place -= 1;
            let ray = self.chunks[chunk as usize][place];
            if place == 0 {
                chunk = self.chunks[chunk as usize][CHUNK_RAYS];
                place = CHUNK_RAYS;
            }
            Some(RayId(ray))
        })
    }

    /// Empties the list of `cell` into `rays`, which is cleared first.
    pub(crate) fn take(&mut self, cell: CellId, rays: &mut Vec<RayId>) {
        rays.clear();
        let list = std::mem::replace(&mut self.lists[cell.index()], List::EMPTY);
        self.total -= u64::from(list.len);
        let (mut chunk, mut len) = (list.first, list.first_len());
        while chunk != NO_CHUNK {
            let slots = &self.chunks[chunk as usize];
            rays.extend(slots[..len].iter().map(|&r| RayId(r)));
            let next = slots[CHUNK_RAYS];
            self.release(chunk);
            chunk = next;
            len = CHUNK_RAYS;
        }
    }

    /// Forgets all rays of all cells.
    pub(crate) fn clear(&mut self) {
        self.lists.fill(List::EMPTY);
        self.chunks.clear();
        self.free = NO_CHUNK;
        self.total = 0;
        self.flipped.clear();
    }

    /// Cells whose weight passed the watched value since the list was last emptied; some may have passed it twice.
    pub(crate) fn flipped(&mut self) -> &mut Vec<CellId> {
        &mut self.flipped
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_keep_what_is_added_and_forget_what_is_removed() {
        let mut crossings = Crossings::new(3);
        crossings.grow(2);
        let [one, two] = [0, 1].map(CellId::from_index);
        for ray in 0..100 {
            crossings.add(one, RayId(ray), 2);
            crossings.add(two, RayId(ray + 1000), 1);
        }
        assert_eq!(
            (crossings.rays(one).count(), crossings.weight(one)),
            (100, 200)
        );
        assert_eq!(crossings.flipped().len(), 2);
        crossings.retain(one, |ray| ray.0 % 3 != 0);
        for _ in (0..100).step_by(3) {
            crossings.lighten(one, 2);
        }
        let mut rest: Vec<u32> = crossings.rays(one).map(|r| r.0).collect();
        rest.sort_unstable();
        assert_eq!(rest, (0..100).filter(|r| r % 3 != 0).collect::<Vec<_>>());
        let mut taken = vec![];
        crossings.take(two, &mut taken);
        assert_eq!(
            (
                taken.len(),
                crossings.rays(two).count(),
                crossings.weight(two)
            ),
            (100, 0, 0)
        );
        for ray in rest {
            assert!(crossings.contains(one, RayId(ray)));
        }
        assert!(!crossings.contains(one, RayId(3)));
        assert_eq!((crossings.total(), crossings.weight(one)), (66, 132));
        crossings.flipped().clear();
        crossings.lighten(one, 130);
        assert_eq!(crossings.flipped().as_slice(), [one]);
        crossings.retain(one, |_| false);
        assert_eq!((crossings.total(), crossings.rays(one).count()), (0, 0));
    }

    #[test]
    fn any_choice_of_rays_can_be_dropped() {
        let mut crossings = Crossings::new(1);
        crossings.grow(1);
        let cell = CellId::from_index(0);
        for count in 0..64u32 {
            // Multiplicative hashing makes the choices irregular.
            for choice in 0..40u32 {
                let keep = |r: u32| (r + 1).wrapping_mul(choice * 0x9e37 + 1) >> 3 & 3 < choice % 5;
                for ray in 0..count {
                    crossings.add(cell, RayId(ray), 1);
                }
                crossings.retain(cell, |ray| keep(ray.0));
                let mut rest: Vec<u32> = crossings.rays(cell).map(|r| r.0).collect();
                rest.sort_unstable();
                let expected: Vec<u32> = (0..count).filter(|&r| keep(r)).collect();
                assert_eq!(rest, expected, "{count} {choice}");
                assert_eq!(crossings.total(), expected.len() as u64);
                crossings.add(cell, RayId(1000), 1);
                assert_eq!(crossings.rays(cell).count(), expected.len() + 1);
                crossings.clear();
            }
        }
    }

    #[test]
    fn freed_chunks_are_used_again() {
        let mut crossings = Crossings::new(1);
        crossings.grow(1);
        let cell = CellId::from_index(0);
        let mut rays = vec![];
        for round in 0..50 {
            for ray in 0..40 {
                crossings.add(cell, RayId(round * 40 + ray), 1);
            }
            crossings.take(cell, &mut rays);
        }
        assert_eq!(crossings.chunks.len(), 3);
    }
}
