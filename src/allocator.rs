//! How the allocator of the system treats large blocks.

#![cfg_attr(
    all(target_os = "linux", target_env = "gnu"),
    expect(
        unsafe_code,
        reason = "settings of the allocator have no safe interface"
    )
)]

/// Blocks from this size on, in bytes, are mappings of their own: the arrays of a map, which grow in place and go back to the system at
/// once.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const OWN_MAPPING: i32 = 1 << 20;
/// Free memory at the end of a heap, in bytes, that is kept for the next keyframe.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const KEPT: i32 = 4 << 20;

/// Keeps large blocks apart from small ones. Otherwise glibc raises the size of blocks that get a mapping of their own up to 32 MiB, and
/// the gaps that grown arrays leave stay resident. Does nothing with other allocators.
pub fn keep_large_blocks_apart() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (parameter, bytes) in [
        (libc::M_MMAP_THRESHOLD, OWN_MAPPING),
        (libc::M_TRIM_THRESHOLD, KEPT),
    ] {
        // SAFETY: `mallopt` sets a number under the lock of the allocator; it may be called at any time. A refused value changes nothing.
        unsafe { libc::mallopt(parameter, bytes) };
    }
}
