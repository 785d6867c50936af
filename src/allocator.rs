//! Settings of the system's allocator.

#![cfg_attr(
    all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"),
    expect(
        unsafe_code,
        reason = "settings of the allocator have no safe interface"
    )
)]

/// Keeps large blocks apart from small ones, and asks for huge pages for the small ones. Does nothing with other allocators.
///
/// Without the first, glibc raises the size of blocks that get a mapping of their own up to 32 MiB, and the gaps that grown arrays leave
/// stay resident. Without the second, each of the many places of a map that a keyframe reads costs an address translation of its own, the
/// more the larger the map. For that the addresses of a large heap are taken at once. Until they are used up, large blocks lie among them,
/// too, with gaps. With `is_small` the heap grows as it is used: for a process with a limit of its addresses, whose heap would not count, and
/// for commands whose memory is mostly large blocks.
pub fn set_up(is_small: bool) {
    #[cfg(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"))]
    glibc::set_up(is_small);
    #[cfg(not(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64")))]
    let _ = is_small;
}

#[cfg(all(target_os = "linux", target_env = "gnu", target_pointer_width = "64"))]
mod glibc {
    /// Blocks from this size on, in bytes, are mappings of their own: the arrays of a map, which grow in place and go back to the system
    /// at once.
    const OWN_MAPPING: i32 = 1 << 20;
    /// Addresses that the heap takes at the start, in bytes; only what is used takes memory.
    const RESERVED: i32 = 1 << 30;
    /// Addresses that it takes at a time when these are used up, in bytes.
    const GROWTH: i32 = 1 << 20;

    pub(super) fn set_up(is_small: bool) {
        set(libc::M_MMAP_THRESHOLD, OWN_MAPPING);
        // One heap for all threads, which is the one that is reserved, and keeps its addresses.
        set(libc::M_ARENA_MAX, 1);
        if !is_small {
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
            let block = libc::malloc(OWN_MAPPING as usize / 2);
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
