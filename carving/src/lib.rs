//! Exact incremental Delaunay tetrahedralisation and free-space carving.
//!
//! [`Carver`](carver::Carver) turns points, and the views that see them, into a labelled tetrahedralisation and the
//! surface between free and occupied space, and keeps all of it up to date while points and views are added, moved and
//! removed. [`Tetrahedralization`](tetrahedralization::Tetrahedralization) is the kernel below, of use by itself.

pub mod carver;
pub mod flow;
pub mod labels;
pub mod predicates;
pub mod surface;
pub mod tetrahedralization;
mod vectors;
pub mod visibility;
