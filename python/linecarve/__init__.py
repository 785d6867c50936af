"""Reconstructs a surface from keyframes with known poses.

`reconstruct` takes a folder of images with poses to a surface, as `linecarve reconstruct` does. `Carver` carves free space from points,
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

__all__ = [
    "Carver",
    "Commit",
    "EmptyMeshError",
    "Error",
    "Lines",
    "Mesh",
    "Reconstruction",
    "Transaction",
    "__version__",
    "reconstruct",
]
