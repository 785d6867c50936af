#![doc = include_str!("../README.md")]

mod border;
mod directions;
mod estimate;
mod grow;
mod kind;
mod label;
mod measures;
mod merge;
mod plane;
mod polygon;
mod straighten;
mod structure;
mod surface;

pub use kind::Kind;
pub use measures::{Angle, Distance};
pub use structure::{Polygon, Structure, StructureOptions, StructurePlane, structure};
