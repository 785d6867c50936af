//! The crate through its public interface, in one binary.

#![allow(clippy::unwrap_used)] // Helpers of tests fail like tests.

mod carver;
mod cut;
mod helpers;
mod incremental;
mod mesh;
#[cfg(feature = "serde")]
mod serialization;
mod tetrahedralization;
