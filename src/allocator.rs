//! The program's allocator: large blocks are mappings of their own, and small ones lie together in huge pages.

#![cfg_attr(
    all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"),
    expect(
        unsafe_code,
        reason = "allocators and their settings have no safe interface"
    )
)]

/// Asks for huge pages for small blocks. Does nothing with other systems.
///
/// Without them, each of the many places of a map that a keyframe reads costs an address translation of its own, the more the larger the
/// map. For that the addresses of a large heap are taken at once. With `is_limited` the heap grows as it is used: the addresses of the
/// process are limited, and those that are not used would count.
pub fn set_up(is_limited: bool) {
    #[cfg(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"))]
    glibc::set_up(is_limited);
    #[cfg(not(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64")))]
    let _ = is_limited;
}

#[cfg(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"))]
pub use glibc::Mappings;
#[cfg(not(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64")))]
pub use std::alloc::System as Mappings;

#[cfg(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"))]
mod glibc {
    use std::alloc::{GlobalAlloc, Layout, System};
    use std::ptr::null_mut;

    /// Blocks from this size on, in bytes, are mappings of their own: the arrays of a map, which grow in place and go back to the system
    /// at once. The gaps that they would leave in a heap stay resident.
    const OWN_MAPPING: usize = 1 << 20;
    /// Mappings from this size on, in bytes, ask for huge pages: smaller ones would leave much of one unused.
    const HUGE_PAGES: usize = 4 << 20;
    /// Addresses that the heap takes at the start, in bytes; only what is used takes memory.
    const RESERVED: i32 = 1 << 30;
    /// Addresses that it takes at a time when these are used up, in bytes.
    const GROWTH: i32 = 1 << 20;
    /// Mappings are aligned to pages of at least this size.
    const LEAST_PAGE: usize = 4096;

    /// The system's allocator, with a mapping for each large block.
    pub struct Mappings;

    fn is_large(layout: Layout) -> bool {
        layout.size() >= OWN_MAPPING && layout.align() <= LEAST_PAGE
    }

    // SAFETY: a block is large or not by its layout alone, so it is freed and resized where it was allocated. Mappings have at least the size
    // and the alignment that is asked for, and do not overlap other blocks.
    unsafe impl GlobalAlloc for Mappings {
        unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
            if is_large(layout) {
                return map(layout.size());
            }
            // SAFETY: the caller's promise.
            unsafe { System.alloc(layout) }
        }

        unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
            if is_large(layout) {
                // Pages of a new mapping are zero.
                return map(layout.size());
            }
            // SAFETY: the caller's promise.
            unsafe { System.alloc_zeroed(layout) }
        }

        unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
            // SAFETY: the block was allocated with this layout, so it is a mapping of this size if that is large.
            unsafe {
                if is_large(layout) {
                    libc::munmap(block.cast(), layout.size());
                } else {
                    System.dealloc(block, layout);
                }
            }
        }

        unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
            // SAFETY: the caller promises a size that makes a layout with this alignment, and a block of `layout`.
            unsafe {
                let new = Layout::from_size_align_unchecked(size, layout.align());
                match (is_large(layout), is_large(new)) {
                    (true, true) => advised(
                        libc::mremap(block.cast(), layout.size(), size, libc::MREMAP_MAYMOVE),
                        size,
                    ),
                    (false, false) => System.realloc(block, layout, size),
                    _ => {
                        let moved = self.alloc(new);
                        if !moved.is_null() {
                            std::ptr::copy_nonoverlapping(block, moved, layout.size().min(size));
                            self.dealloc(block, layout);
                        }
                        moved
                    }
                }
            }
        }
    }

    fn map(size: usize) -> *mut u8 {
        // SAFETY: an anonymous mapping at addresses that the system chooses touches nothing that exists.
        let mapping = unsafe {
            libc::mmap(
                null_mut(),
                size,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
                -1,
                0,
            )
        };
        advised(mapping, size)
    }

    /// The block of a mapping of some size, in huge pages if it is large enough; null if there is none.
    fn advised(mapping: *mut libc::c_void, size: usize) -> *mut u8 {
        if mapping == libc::MAP_FAILED {
            return null_mut();
        }
        if size >= HUGE_PAGES {
            // SAFETY: the advice concerns this mapping, and does not change what it holds; a system that refuses it changes nothing.
            unsafe { libc::madvise(mapping, size, libc::MADV_HUGEPAGE) };
        }
        mapping.cast()
    }

    pub(super) fn set_up(is_limited: bool) {
        // One heap for all threads, which is the one that is reserved, and keeps its addresses.
        set(libc::M_ARENA_MAX, 1);
        if !is_limited {
            set(libc::M_TRIM_THRESHOLD, i32::MAX);
            set(libc::M_TOP_PAD, RESERVED);
            ask_for_huge_pages();
        }
        set(libc::M_TOP_PAD, GROWTH);
    }

    fn set(parameter: i32, value: i32) {
        // SAFETY: `mallopt` sets a number under the lock of the allocator; it may be called at any time. A refused value changes nothing.
        unsafe { libc::mallopt(parameter, value) };
    }

    /// Asks for huge pages for the addresses of the heap, where the system gives them to those who ask.
    fn ask_for_huge_pages() {
        // SAFETY: the block is in the heap, or null, and is freed once. `sbrk(0)` reads the end of the heap. The advice concerns whole pages
        // between the two, and does not change what they hold; a system that refuses it changes nothing.
        unsafe {
            // Larger than what the heap has at first, so that it takes its addresses now.
            let block = libc::malloc(OWN_MAPPING / 2);
            let page = libc::sysconf(libc::_SC_PAGESIZE).max(1) as usize;
            let start = (block as usize).next_multiple_of(page);
            let end = libc::sbrk(0) as usize / page * page;
            if !block.is_null() && start < end {
                libc::madvise(start as *mut _, end - start, libc::MADV_HUGEPAGE);
            }
            libc::free(block);
        }
    }
}
