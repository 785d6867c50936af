import dataclasses
import os
import pathlib
from collections.abc import Iterable, Sequence
from typing import Any

import distributed

@dataclasses.dataclass(frozen=True)
class Run:
    mesh_path: pathlib.Path
    tiles: int
    report: dict[str, dict[str, float]]

def reconstruct(
    path: str | os.PathLike[str],
    *,
    work: str | os.PathLike[str],
    client: distributed.Client,
    labels: str | None = None,
    tiles: int | None = None,
    halo: int | None = None,
    config: str | os.PathLike[str] | None = None,
    memory: str | None = None,
    retries: int = 5,
    program: Sequence[str] | None = None,
    **options: Any,
) -> Run: ...
def reconstruct_many(
    sequences: Iterable[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    *,
    client: distributed.Client,
    retries: int = 5,
    program: Sequence[str] | None = None,
    **options: Any,
) -> list[pathlib.Path]: ...
