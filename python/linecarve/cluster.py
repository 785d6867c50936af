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
# A task hangs when no other ends for so many times as long as one takes, and for so many seconds.
_STRAGGLER_FACTOR = 3
_STRAGGLER = 10.0
# A worker that was not heard of for so many seconds gets no task after one hung.
_SILENCE = 10.0


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
            _carry_out(client, tasks, cancel, retries, may_repeat=True)
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
    """A file that tells tasks of a run to end: all, while the caller is leaving by an exception, or those that it names by their keys."""

    def __init__(self, folder):
        self.path = folder / f".linecarve-cancel-{uuid.uuid4().hex}"
        self.keys = []

    def __enter__(self):
        return self

    def __exit__(self, kind, value, traceback):
        try:
            if kind is not None:
                self._write("")
            if kind is not None or self.keys:
                time.sleep(3 * _POLL_CANCEL)
        finally:
            self.path.unlink(missing_ok=True)

    def add(self, keys):
        self.keys += keys
        self._write("\n".join(self.keys))

    def _write(self, text):
        part = self.path.with_suffix(".part")
        part.write_text(text)
        part.replace(self.path)


def _is_cancelled(path, key):
    try:
        keys = path.read_text().split()
    except OSError:
        return False
    return not keys or key in keys


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


def _carry_out(client, tasks, cancel, retries, checkpoints=None, may_repeat=False):
    """Carries out commands by name; returns when all are done. A command whose checkpoint is there goes on with it. With `may_repeat`
    a command that takes far longer than the others is started once more, and the first to end counts."""
    stage = _Stage(client, tasks, cancel, retries, checkpoints or {})
    try:
        while stage.waiting or stage.running:
            stage.submit_waiting()
            if not stage.take_finished():
                time.sleep(_POLL)
                if may_repeat:
                    stage.repeat_stragglers()
    finally:
        client.cancel([future for _, future in stage.running.values()])


class _Stage:
    """Commands that do not depend on each other, and their futures."""

    def __init__(self, client, tasks, cancel, retries, checkpoints):
        self.client = client
        self.tasks = tasks
        self.cancel = cancel
        self.retries = retries
        self.checkpoints = checkpoints
        self.run = uuid.uuid4().hex[:12]
        self.attempts = dict.fromkeys(tasks, 0)
        self.losses = dict.fromkeys(tasks, 0)
        self.waiting = list(tasks)
        self.running = {}
        self.finished = distributed.as_completed(with_results=False)
        self.started = self.progressed = self.looked = time.monotonic()
        self.done = 0
        self.is_hanging = False

    def submit_waiting(self):
        """Fills the window when half of it is done, so that graphs are few."""
        if self.waiting and len(self.running) <= _WINDOW // 2:
            count = _WINDOW - len(self.running)
            self.submit(self.waiting[:count])
            del self.waiting[:count]

    def submit(self, names):
        # A graph for all of them, and short keys: both are most of what the scheduler hears of a task. No two runs or attempts have keys in
        # common, so that an earlier result of the same command is none of this run.
        keys = [f"{name.replace(' ', '-')}-{self.run}-{self.attempts[name]}" for name in names]
        commands = [self.tasks[name] for name in names]
        checkpoints = [self.checkpoints.get(name) for name in names]
        cancels = [str(self.cancel.path)] * len(names)
        options = {"workers": self.answering(), "allow_other_workers": True} if self.is_hanging or self.cancel.keys else {}
        futures = self.client.map(_execute, names, keys, commands, cancels, checkpoints, key=keys, pure=False, **options)
        for name, future in zip(names, futures):
            self.attempts[name] += 1
            self.running[future.key] = (name, future)
        self.finished.update(futures)

    def answering(self):
        """The workers that the scheduler heard of lately; `None` when there are none."""
        workers = self.client.scheduler_info(n_workers=-1)["workers"]
        latest = max((worker["last_seen"] for worker in workers.values()), default=0.0)
        return [address for address, worker in workers.items() if latest - worker["last_seen"] < _SILENCE] or None

    def take_finished(self):
        """Takes note of what has ended; returns whether anything has."""
        batch = self.finished.next_batch(block=False)
        for future in batch:
            name, _ = self.running.pop(future.key, (None, None))
            if name is None:
                continue
            others = [key for key, (other, _) in self.running.items() if other == name]
            error = future.exception() if future.status == "error" else None
            if future.status == "cancelled":
                error = _Lost(f"{name}: its future was cancelled")
            if error is None:
                self.done += 1
                self.progressed = time.monotonic()
                if others:
                    self.cancel.add(others)
                    self.client.cancel([self.running.pop(key)[1] for key in others])
            elif not isinstance(error, (_Lost, distributed.KilledWorker)):
                raise error
            elif not others:
                self.losses[name] += 1
                if self.losses[name] > self.retries:
                    raise Error(f"{name}: given up after {self.losses[name]} attempts: {error}") from error
                self.waiting.insert(0, name)
        return bool(batch)

    def repeat_stragglers(self):
        """Starts what is left once more, when nothing has ended for a while and either a worker no longer answers, or that is several times
        as long as a task takes: a machine may hang."""
        now = time.monotonic()
        if now - max(self.looked, self.progressed) < _STRAGGLER:
            return
        self.looked = now
        nthreads = self.client.nthreads()
        answering = self.answering()
        names = [name for name, _ in self.running.values()]
        if answering is None or len(answering) >= len(nthreads):
            threads = sum(nthreads.values())
            # No more tasks than threads: all of them have begun.
            if self.waiting or len(names) > min(self.done, threads):
                return
            mean = (self.progressed - self.started) * threads / self.done
            if now - self.progressed <= _STRAGGLER_FACTOR * mean:
                return
        self.is_hanging = True
        names = [name for name in names if self.attempts[name] == self.losses[name] + 1]
        if names:
            self.submit(names)


def _execute(name, key, command, cancel, checkpoint=None):
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
                    if _is_cancelled(cancel, key):
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
