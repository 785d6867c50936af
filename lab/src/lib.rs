//! What measures Linecarve and is not part of the product: baselines, tables, harnesses.
//!
//! [`baselines`] holds other methods for 3D line segments and points behind one trait, against which edge-aided fitting is
//! measured.

pub mod baselines;
