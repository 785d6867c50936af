//! Every line method on one sequence, against a ground truth and against the images: the tables of the paper.
//!
//! [`methods`] runs the methods, [`surface`] measures distances to the ground truth, [`images`] distances of projected lines to
//! edges of other keyframes; [`truth`] reads and aligns the ground truth; [`carved`] makes surfaces of end points; [`agreement`] compares two sets of lines; [`table`] holds, compares and prints the figures.
//!
//! # Reference
//! S. He, X. Qin, Z. Zhang, M. Jagersand, Incremental 3D Line Segment Extraction from Semi-dense SLAM, ICPR 2018, tables I to III.

pub mod agreement;
pub mod carved;
mod depth_buffer;
mod edge_field;
pub mod images;
pub mod methods;
pub mod surface;
pub mod table;
pub mod truth;
