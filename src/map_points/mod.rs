//! Map points: sparse points, the views that see them, and where.
//!
//! A [`PointModel`] is what structure from motion and feature-based SLAM leave behind, whether it was read from their files or
//! made here; it can be carved without a look at the images.

mod model;

pub use model::{ModelPoint, ModelView, PointModel, Sighting};
