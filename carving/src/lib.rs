//! Exact incremental Delaunay tetrahedralisation and free-space carving.
