#![doc = include_str!("../README.md")]

mod border;
mod directions;
mod estimate;
mod find;
mod grow;
mod kind;
mod label;
mod measures;
mod merge;
mod plan;
mod plane;
mod polygon;
mod straighten;
mod structure;
mod surface;
#[cfg(test)]
mod tests;
mod write;

pub use find::structure;
pub use kind::Kind;
pub use measures::{Angle, Distance, Edge};
pub use plan::{Opening, Piece, Plan};
pub use structure::{Polygon, Structure, StructureOptions, StructurePlane};
pub use write::{
    StructureSummary, deviation_text, measured_text, svg, write_dxf, write_ifc, write_json,
    write_structure_glb, write_structure_obj, write_usda,
};
