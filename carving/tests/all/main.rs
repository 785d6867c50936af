//! The crate through its public interface, in one binary.

#![allow(clippy::unwrap_used)] // Helpers of tests fail like tests.
#![allow(clippy::disallowed_methods)] // Made-up scenes may differ between platforms.

mod carver;
mod cut;
mod helpers;
mod incremental;
mod mesh;
mod samples;
#[cfg(feature = "serde")]
mod serialization;
mod tetrahedralization;
