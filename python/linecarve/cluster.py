"""Surfaces on many machines, with Dask distributed.

`reconstruct` carves a model or a sequence in tiles (`linecarve tiles`) by the workers of a client that the caller brings: of a laptop
(`LocalCluster`), of machines reached by SSH, of Slurm (`dask_jobqueue`), of Kubernetes. `reconstruct_many` gives each sequence to a worker.
Input and work folder must be on a file system that the caller and all workers share. Only names go through the scheduler; every
task is a process of `linecarve`.
"""

import dataclasses
import json
import pathlib
import signal
import subprocess
import sys
import time
import uuid

from . import Error

try:
    import distributed
except ImportError as error:
    raise ImportError("linecarve.cluster needs Dask distributed: pip install 'linecarve[dask]'") from error

__all__ = ["Run", "reconstruct", "reconstruct_many"]

# Between looks at a process, in seconds.
_POLL = 0.05
# Between looks for the file that cancels a run: it may be on a network.
_POLL_CANCEL = 1.0
# Tasks of a stage that the scheduler knows at a time.
_WINDOW = 2000


class _Lost(RuntimeError):
    """A process that was killed; another attempt may succeed."""


@dataclasses.dataclass(frozen=True)
class Run:
    """What a run in tiles left behind."""

    mesh_path: pathlib.Path
    """`mesh.ply` in the work folder."""
    tiles: int
    """Number of tiles."""
    report: dict
    """For each stage `tasks`, `seconds` of all tasks together, and `peak_mb`, the most memory of a task."""


def reconstruct(
    path, *, work, client, labels=None, tiles=None, halo=None, config=None, memory=None, retries=5, program=None, **options
):
    """Carves a model or a sequence in tiles; returns a `Run`. The mesh has the bytes of one process.

    `path` is a model with points and views or a sequence, as for `linecarve tiles plan`; `labels`, `tiles`, `halo`, `config` and all
    `options` (`from_`, `depth`, `every`, `keyframes_per_task`) are its options, with underscores.
    `memory` ("4G") limits each task of a stage. A run that was interrupted goes on when called again with the same arguments. A task
    whose process or worker is lost is carried out again up to `retries` times. `program` replaces the program, a list of arguments.

    Raises `linecarve.Error`, which names the task, file and remedy. Ctrl-C ends all processes of the run.
    """
    program = list(program or [sys.executable, "-m", "linecarve"])
    work = pathlib.Path(work).absolute()
    options |= {"labels": labels, "tiles": tiles, "halo": halo, "config": config}
    command = ["tiles", "plan", str(pathlib.Path(path).absolute()), str(work), "-q", *_flags(options)]
    work.mkdir(parents=True, exist_ok=True)
    with _Cancel(work) as cancel:
        _carry_out(client, {"plan": program + command}, cancel, retries)
        limit = ["--memory-limit", memory] if memory else []
        for stage, numbers in _pending(program, work).items():
            tasks = {
                f"{stage} {number}": [*program, "tiles", "item", str(work), stage, str(number), "--threads", "1", *limit]
                for number in numbers
            }
            _carry_out(client, tasks, cancel, retries)
        # Verifies all files, makes damaged ones again and writes the mesh.
        finish = [*program, "tiles", "run", str(work), "-q", *limit]
        _carry_out(client, {"mesh": finish}, cancel, retries)
    items = _items(program, work)
    report = {}
    for item in items:
        entry = report.setdefault(item["stage"], {"tasks": 0, "seconds": 0.0, "peak_mb": 0.0})
        entry["tasks"] += 1
        entry["seconds"] += item["manifest"]["seconds"]
        entry["peak_mb"] = max(entry["peak_mb"], item["manifest"]["peak_mb"] or 0.0)
    return Run(work / "mesh.ply", report["frame"]["tasks"], report)


def reconstruct_many(sequences, out, *, client, retries=5, program=None, **options):
    """Reconstructs sequences, each as one task; returns the folders of the results, in the order of the sequences.

    `options` are those of `linecarve reconstruct`, with underscores. The result of `a/room` goes to `out/room`. A sequence whose process
    was lost, or whose call was interrupted, goes on with the keyframes that it saved in `out/room/.linecarve`; with other options than
    those of the interrupted call it is refused, until that folder is deleted.

    Raises `ValueError` when two sequences have one name, and `linecarve.Error`.
    """
    program = list(program or [sys.executable, "-m", "linecarve"])
    out = pathlib.Path(out).absolute()
    sequences = [pathlib.Path(sequence).absolute() for sequence in sequences]
    names = [sequence.name for sequence in sequences]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ValueError(f"several sequences are named {', '.join(repeated)}: their results would go to one folder")
    out.mkdir(parents=True, exist_ok=True)
    tasks = {
        name: [*program, "reconstruct", str(sequence), "--out", str(out / name), "--quiet", *_flags(options)]
        for name, sequence in zip(names, sequences)
    }
    with _Cancel(out) as cancel:
        checkpoints = {name: str(out / name / ".linecarve" / "run.txt") for name in names}
        _carry_out(client, tasks, cancel, retries, checkpoints)
    return [out / name for name in names]


def _flags(options):
    flags = []
    for name, value in options.items():
        flag = "--" + name.strip("_").replace("_", "-")
        if value is True:
            flags.append(flag)
        elif value is not None and value is not False:
            values = value if isinstance(value, (list, tuple)) else [value]
            flags += [flag, ",".join(str(value) for value in values)]
    return flags


class _Cancel:
    """A file that tells the tasks of a run to end; it is there while the caller is leaving by an exception."""

    def __init__(self, folder):
        self.path = folder / f".linecarve-cancel-{uuid.uuid4().hex}"

    def __enter__(self):
        return self.path

    def __exit__(self, kind, value, traceback):
        if kind is not None:
            try:
                self.path.touch()
                time.sleep(3 * _POLL_CANCEL)
            finally:
                self.path.unlink(missing_ok=True)


def _items(program, work):
    listed = subprocess.run([*program, "tiles", "stages", str(work), "--json"], capture_output=True, text=True)
    if listed.returncode != 0:
        raise Error(listed.stderr.strip())
    return json.loads(listed.stdout)["items"]


def _pending(program, work):
    stages = {}
    for item in _items(program, work):
        numbers = stages.setdefault(item["stage"], [])
        if not item["done"]:
            numbers.append(item["item"])
    return stages


def _carry_out(client, tasks, cancel, retries, checkpoints=None):
    """Carries out commands by name; returns when all are done. A command whose checkpoint is there goes on with it."""
    attempts = dict.fromkeys(tasks, 0)
    waiting = list(reversed(tasks))
    running = {}
    finished = distributed.as_completed(with_results=False)

    def submit(name):
        # A key of its own: an earlier result of the same command is none of this run.
        key = f"linecarve-{name.replace(' ', '-')}-{uuid.uuid4().hex}"
        future = client.submit(_execute, name, tasks[name], str(cancel), (checkpoints or {}).get(name), key=key, pure=False)
        running[future.key] = (name, future)
        finished.add(future)

    try:
        while waiting or running:
            while waiting and len(running) < _WINDOW:
                submit(waiting.pop())
            future = next(finished)
            name, _ = running.pop(future.key)
            error = future.exception() if future.status == "error" else None
            if future.status == "cancelled":
                error = _Lost(f"{name}: its future was cancelled")
            if error is None:
                continue
            is_lost = isinstance(error, (_Lost, distributed.KilledWorker))
            attempts[name] += 1
            if not is_lost:
                raise error
            if attempts[name] > retries:
                raise Error(f"{name}: given up after {attempts[name]} attempts: {error}") from error
            waiting.append(name)
    finally:
        client.cancel([future for _, future in running.values()])


def _execute(name, command, cancel, checkpoint=None):
    """Runs a command on a worker. Nothing is returned: results are files."""
    if checkpoint and "--resume" not in command and pathlib.Path(checkpoint).exists():
        command = [*command, "--resume"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    cancel = pathlib.Path(cancel)
    looked = time.monotonic()
    said = ""
    try:
        while True:
            try:
                said = process.communicate(timeout=_POLL)[1].strip()
                break
            except subprocess.TimeoutExpired:
                now = time.monotonic()
                if now - looked > _POLL_CANCEL:
                    looked = now
                    if cancel.exists():
                        raise Error(f"{name}: cancelled") from None
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()
    # The scheduler gets the end of the text at most.
    said = said[-2000:]
    status = process.returncode
    if status == 0:
        return
    # The program aborts when memory is refused.
    if status == -signal.SIGABRT or "memory allocation" in said:
        raise Error(f"{name}: needs more memory than it is given: plan more tiles, or raise `memory`. {said}")
    if status < 0:
        raise _Lost(f"{name}: ended by signal {-status}. {said}")
    raise Error(f"{name}: {said or f'exit status {status}'}")
