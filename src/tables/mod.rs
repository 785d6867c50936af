//! The paper's tables: every line method on one sequence against a ground-truth surface and against the images.
//!
//! [`methods`] runs the methods, [`surface`] measures distances to the ground truth, [`images`] how lines fall on the edges of
//! keyframes that they do not come from, [`table`] holds, compares and prints the figures.

mod depth_buffer;
mod edge_field;
pub mod images;
pub mod methods;
pub mod semi_dense;
pub mod surface;
pub mod table;
