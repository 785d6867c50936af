from os import PathLike
from types import TracebackType
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

class Error(Exception):
    """The program cannot do what is asked for; the message names the file and the remedy."""

class EmptyMeshError(Error):
    """A reconstruction ended without a triangle; the message says why."""

class Mesh:
    """A triangle mesh. Its arrays are made once and shared: reading an attribute copies nothing."""

    @property
    def vertices(self) -> NDArray[np.float64]:
        """Positions, shape (n, 3), in units and frame of the poses or of the points given."""
    @property
    def triangles(self) -> NDArray[np.uint32]:
        """Indices of three vertices, shape (m, 3), counter-clockwise seen from free space."""
    @property
    def colors(self) -> NDArray[np.uint8] | None:
        """sRGB colours of the vertices, shape (n, 3); None without colours."""

class Lines:
    """3D line segments. Their arrays are made once and shared."""

    @property
    def points(self) -> NDArray[np.float64]:
        """Positions, shape (n, 3)."""
    @property
    def lines(self) -> NDArray[np.uint32]:
        """Indices of two points, shape (m, 2)."""

class Reconstruction(Mesh):
    """The surface of a sequence, and what it was made from."""

    @property
    def segments(self) -> Lines:
        """3D line segments of all keyframes; empty when the surface was made from points."""
    @property
    def clusters(self) -> Lines:
        """One line for the segments of several keyframes on the same edge."""
    @property
    def keyframes(self) -> list[str]:
        """Names of the keyframes in the map, n of them, in the order of processing."""
    @property
    def poses(self) -> NDArray[np.float64]:
        """world_from_camera of those keyframes, shape (n, 4, 4); x right, y down, z forward."""

def reconstruct(path: str | PathLike[str], out: str | PathLike[str] | None = None, **options: object) -> Reconstruction:
    """The surface of a sequence of images with poses, as `linecarve reconstruct` makes it.

    `path` is a folder in any layout that the program reads, or a model file. With `out`, all files of the command are written there.

    Options are those of `linecarve reconstruct --help` with underscores: `max_keyframes=20`, `labels="votes"`, `every=3`,
    `from_="map-points"`, `config="parameters.toml"`. True stands for an option without a value; None and False leave it out.

    Other Python threads run meanwhile. Ctrl-C ends the run after the current keyframe with KeyboardInterrupt.

    Raises `Error` for bad input or an interrupted run, `EmptyMeshError` without a surface, `ValueError` for unknown options.
    """

def mesh(arguments: list[str]) -> None:
    """Runs `linecarve mesh` with these arguments; see `delaunay_meshing`."""

class Carver:
    """Free space carved by rays in an exact Delaunay tetrahedralisation, and the surface around it.

    The state consists of points, views and observations (a view sees a point). The surface depends on that state alone, not on the order of changes. Ids are never given out twice. Coordinates have any unit.

    `labels` is "votes" (a cell is free when a ray crosses it, or `threshold` of weight) or "cut" (a minimum cut over all cells, with the
    `relative_sigma`, `behind_sigmas`, `matter_weight` and `quality_weight` of the command's configuration). `hull` is "drop" or "keep": whether
    facets between free space and the outside of the hull are part of the surface.
    """

    def __new__(
        cls,
        labels: Literal["votes", "cut"] = "votes",
        hull: Literal["drop", "keep"] = "drop",
        *,
        threshold: int | None = None,
        relative_sigma: float | None = None,
        behind_sigmas: float | None = None,
        matter_weight: float | None = None,
        quality_weight: float | None = None,
    ) -> Self: ...
    def transaction(self) -> Transaction:
        """Changes that take effect together, on `commit` or at the end of a `with` block."""
    def surface(self, longest_edge: float | None = None, minimum_component: int = 1, manifold: bool = False) -> Mesh:
        """The surface. Triangles with an edge above `longest_edge` and components of fewer triangles are left out; `manifold` copies
        vertices until every edge has two triangles at most."""
    def vertex_positions(self, vertices: ArrayLike) -> NDArray[np.float64]:
        """Positions of vertices of `Commit.added`, shape (n, 3)."""
    @property
    def point_count(self) -> int:
        """Number of points."""
    @property
    def view_count(self) -> int:
        """Number of views."""
    @property
    def ray_count(self) -> int:
        """Number of observations."""
    @property
    def cell_count(self) -> int:
        """Number of tetrahedra."""
    @property
    def triangle_count(self) -> int:
        """Number of triangles between free and occupied cells."""

class Transaction:
    """Changes that take effect together.

    Ids are those that the changes will have. All changes are checked on commit; when one is refused, nothing is changed.
    """

    def add_points(self, positions: ArrayLike, sigma: ArrayLike | None = None) -> NDArray[np.uint32]:
        """Adds points, shape (n, 3), with their standard deviations along rays, shape (n,) or one number. Returns their ids, shape (n,)."""
    def add_views(self, centers: ArrayLike) -> NDArray[np.uint32]:
        """Adds views by their camera centres, shape (n, 3). Returns their ids, shape (n,)."""
    def add_observations(self, views: ArrayLike, points: ArrayLike, weights: ArrayLike = 1) -> None:
        """Views see points: ids and positive integer weights, shape (n,) each, or one number for all."""
    def set_sigma(self, points: ArrayLike, sigma: ArrayLike) -> None:
        """Sets standard deviations along rays, shape (n,) or one number; NaN for that of the options."""
    def move_points(self, points: ArrayLike, positions: ArrayLike) -> None:
        """Moves points, ids of shape (n,), to positions of shape (n, 3); their observations stay."""
    def move_views(self, views: ArrayLike, centers: ArrayLike) -> None:
        """Moves views, ids of shape (n,), to centres of shape (n, 3); their observations stay."""
    def remove_points(self, points: ArrayLike) -> None:
        """Removes points with their observations, ids of shape (n,)."""
    def remove_views(self, views: ArrayLike) -> None:
        """Removes views with their observations, ids of shape (n,)."""
    def remove_observations(self, views: ArrayLike, points: ArrayLike) -> None:
        """Removes observations, ids of shape (n,) each, or one number for all."""
    def commit(self) -> Commit:
        """Makes the changes. Other Python threads run meanwhile. Raises ValueError when one is refused; nothing is changed then."""
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> bool: ...

class Commit:
    """What a transaction changed."""

    @property
    def added(self) -> NDArray[np.uint32]:
        """New triangles by the vertices of the tetrahedralisation, shape (n, 3); see `Carver.vertex_positions`."""
    @property
    def removed(self) -> NDArray[np.uint32]:
        """Triangles that are gone, shape (n, 3)."""
    @property
    def duplicates(self) -> int:
        """Number of new points at the position of another point."""
    @property
    def seconds(self) -> float:
        """Time spent."""
