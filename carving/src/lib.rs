//! Exact incremental Delaunay tetrahedralisation and free-space carving.

pub mod predicates;
pub mod tetrahedralization;
