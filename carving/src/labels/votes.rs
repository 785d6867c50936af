//! Labels by counting votes.

use std::num::NonZeroU64;

/// A finite cell is free when the weights of the rays across it add up to a threshold.
///
/// Space outside the hull (ghost cells) is never free. Samples do not count.
///
/// # Reference
///
/// D. Lovi, N. Birkbeck, D. Cobzas, M. Jagersand, "Incremental free-space carving for real-time 3D reconstruction",
/// 3DPVT 2010.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Serialize, serde::Deserialize),
    serde(default, deny_unknown_fields)
)]
pub struct Votes {
    /// Smallest total weight of a free cell.
    pub threshold: NonZeroU64,
}

impl Votes {
    /// Whether a finite cell with this total weight is free.
    #[inline]
    pub fn is_free(self, weight: u64) -> bool {
        weight >= self.threshold.get()
    }
}

impl Default for Votes {
    /// One ray of weight 1 frees a cell.
    fn default() -> Self {
        Self {
            threshold: NonZeroU64::MIN,
        }
    }
}
