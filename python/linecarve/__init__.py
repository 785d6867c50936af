"""Reconstructs a surface from keyframes with known poses.

`reconstruct` takes a folder of images with poses to a surface, as `linecarve reconstruct` does. `delaunay_meshing` makes the mesh of a
dense cloud, as `linecarve mesh` does. `Carver` carves free space from points,
views and the rays between them. Arrays are numpy arrays, coordinates are float64 in units of the poses.
"""

from ._linecarve import (
    Carver,
    Commit,
    EmptyMeshError,
    Error,
    Lines,
    Mesh,
    Reconstruction,
    Transaction,
    __version__,
    reconstruct,
)
from .meshing import DelaunayMeshingOptions, delaunay_meshing

__all__ = [
    "Carver",
    "Commit",
    "DelaunayMeshingOptions",
    "EmptyMeshError",
    "Error",
    "Lines",
    "Mesh",
    "Reconstruction",
    "Transaction",
    "__version__",
    "delaunay_meshing",
    "reconstruct",
]
