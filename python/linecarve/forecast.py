"""Forecasts how long a run in tiles takes on a cluster, from the stage times of runs that were measured.

    linecarve tiles stages WORK --json > run.json
    python -m linecarve.forecast run.json --points 1e9 --points-per-tile 1e6 --workers 16,128

Each stage is simulated: its tasks go to workers in order, each to the first that is free, and a stage begins when all
tasks of the stage before have ended. A task takes as long as a measured one of its stage, drawn at random with a fixed seed and scaled
with the points of its tile; `intake`, `giants`, `settle` and `merge` are one task each and scaled with all points, and the number of tasks
of `keyframes` grows with all points. With several runs of
different size, tasks may also grow with the points of the other tiles, whose blocks they look through.

Not in it: a slow network or disk, machines of different speed, and tasks that are lost.
"""

import argparse
import dataclasses
import heapq
import json
import random
import statistics

__all__ = ["Forecast", "Measured", "forecast", "read"]

_SINGLE = ("intake", "giants", "settle", "merge")
# A process and the files of its plan, in seconds.
_START = 0.02


@dataclasses.dataclass(frozen=True)
class Measured:
    """Stage times of a run: for each stage the seconds of its tasks, and the points of each tile."""

    seconds: dict
    points: tuple


@dataclasses.dataclass(frozen=True)
class Forecast:
    """Seconds by the clock for each stage, and of all tasks together."""

    stages: dict
    busy: float

    @property
    def wall(self):
        """Seconds by the clock."""
        return sum(self.stages.values())


def read(path):
    """Reads what `linecarve tiles stages WORK --json` wrote of a run that is done."""
    with open(path, encoding="utf-8") as file:
        items = json.load(file)["items"]
    undone = [f"{item['stage']} {item['item']}" for item in items if not item["manifest"]]
    if undone:
        raise ValueError(f"{path}: {undone[0]} is not done: finish the run first (linecarve tiles run)")
    seconds = {}
    points = []
    for item in items:
        seconds.setdefault(item["stage"], []).append(item["manifest"]["seconds"])
        if item["stage"] == "frame":
            points.append(dict(map(tuple, item["manifest"]["counts"]))["vertices"])
    if not points or sum(points) == 0:
        raise ValueError(f"{path}: no stages of a run in tiles")
    return Measured(seconds, tuple(points))


def _rates(runs, stage):
    """Seconds for each point of the tile, of each task; and seconds for each point of all other tiles."""
    rates = []
    for run in runs:
        scale = [sum(run.points)] if stage in _SINGLE else run.points
        rates.append([s / p for s, p in zip(run.seconds[stage], scale) if p > 0])
    if stage in _SINGLE or len(runs) == 1:
        return [rate for run in rates for rate in run], 0.0
    # Least squares over the means of the runs: seconds a point = own + growth * other points / points of the tile.
    x = [(len(run.points) - 1.0) for run in runs]
    y = [statistics.fmean(rate) for rate in rates]
    mean = statistics.fmean(x)
    spread = sum((a - mean) ** 2 for a in x)
    growth = max(0.0, sum((a - mean) * b for a, b in zip(x, y)) / spread) if spread > 0 else 0.0
    own = [max(rate - growth * a, 0.1 * rate) for rates_, a in zip(rates, x) for rate in rates_]
    return own, growth


def forecast(runs, *, points, tiles, workers, start=_START, seed=0):
    """Forecasts a run of so many points and tiles by so many workers."""
    if points < 1 or tiles < 1 or workers < 1:
        raise ValueError("points, tiles and workers must be at least 1")
    stages = set(runs[0].seconds)
    if any(set(run.seconds) != stages for run in runs):
        raise ValueError("the runs have different stages: some are votes, some are cuts")
    order = random.Random(seed)
    walls, busy = {}, 0.0
    for stage in runs[0].seconds:
        own, growth = _rates(runs, stage) if stage != "keyframes" else ([], 0.0)
        if stage == "keyframes":
            measured = runs[0].seconds[stage]
            count = max(1, round(len(measured) * points / sum(runs[0].points)))
            tasks = [order.choice(measured) for _ in range(count)]
        elif stage in _SINGLE:
            tasks = [statistics.fmean(own) * points]
        else:
            share = points / tiles
            tasks = [share * (order.choice(own) + growth * (tiles - 1)) for _ in range(tiles)]
        free = [0.0] * min(workers, len(tasks))
        for task in tasks:
            heapq.heapreplace(free, free[0] + task + start)
        walls[stage] = max(free)
        busy += sum(tasks)
    return Forecast(walls, busy)


def _text(seconds):
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.1f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def main(arguments=None):
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m linecarve.forecast", description=__doc__.split("\n\n")[0])
    parser.add_argument("runs", nargs="+", help="what `linecarve tiles stages WORK --json` wrote, of one or more runs")
    parser.add_argument("--points", type=float, help="points of the input (default: as measured)")
    parser.add_argument("--points-per-tile", type=float, help="points of a tile (default: as measured in the first run)")
    parser.add_argument("--workers", default="1,2", help="numbers of tasks at a time, with commas")
    given = parser.parse_args(arguments)
    try:
        runs = [read(path) for path in given.runs]
        points = given.points or sum(runs[0].points)
        per_tile = given.points_per_tile or sum(runs[0].points) / len(runs[0].points)
        tiles = max(1, round(points / per_tile))
        for workers in (int(number) for number in given.workers.split(",")):
            result = forecast(runs, points=points, tiles=tiles, workers=workers)
            stages = ", ".join(f"{stage} {_text(seconds)}" for stage, seconds in result.stages.items())
            print(f"{points:.3g} points, {tiles} tiles, {workers} workers: {_text(result.wall)} ({stages})")
    except (OSError, ValueError, KeyError) as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
