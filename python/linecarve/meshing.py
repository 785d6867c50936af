"""The mesh of a dense or sparse cloud, with the names that users of pycolmap know."""

from __future__ import annotations

import dataclasses
import os

from ._linecarve import mesh as _mesh


@dataclasses.dataclass
class DelaunayMeshingOptions:
    """Options under the names and with the defaults of COLMAP. Those that differ from the defaults are passed on; docs/dense-clouds.md
    says what each becomes."""

    max_proj_dist: float = 20.0
    max_depth_dist: float = 0.05
    visibility_sigma: float = 3.0
    distance_sigma_factor: float = 1.0
    quality_regularization: float = 1.0
    max_side_length_factor: float = 25.0

    def _arguments(self) -> list[str]:
        given = (
            (field.name, getattr(self, field.name), field.default)
            for field in dataclasses.fields(self)
        )
        return [
            f"--DelaunayMeshing.{name}={value}"
            for name, value, default in given
            if value != default
        ]


def delaunay_meshing(
    input_path: str | os.PathLike[str],
    output_path: str | os.PathLike[str],
    options: DelaunayMeshingOptions | None = None,
    *,
    closed: bool = False,
    config: str | os.PathLike[str] | None = None,
) -> None:
    """Writes the mesh of points whose views are known, as `linecarve mesh` does.

    `input_path` is a dense workspace of COLMAP, its `fused.ply`, a sparse model, or a scene of OpenMVS. `output_path` ends with .glb,
    .obj or .ply. With `closed` the mesh is watertight. `config` is a TOML file with parameters.

    Raises `Error` for bad input, `EmptyMeshError` without a surface, `ValueError` for options out of range.
    """
    arguments = (options or DelaunayMeshingOptions())._arguments()
    if closed:
        arguments.append("--closed")
    if config is not None:
        arguments.append(f"--config={os.fspath(config)}")
    arguments += [f"--out={os.fspath(output_path)}", "--", os.fspath(input_path)]
    _mesh(arguments)
