"""Times one commit of 100 000 points, each seen by one of 100 views in a room, and prints it as JSON.

    python examples/commit_points.py [votes|cut]

`cargo run --release -p linecarve-carving --example commit_points` does the same in Rust.
"""

import json
import sys
import time

import numpy as np

import linecarve

POINTS = 100_000
VIEWS = 100


def random(counter):
    """Numbers in 0..1 that counters give (SplitMix64)."""
    z = (np.asarray(counter, np.uint64) + np.uint64(1)) * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return ((z ^ (z >> np.uint64(31))) >> np.uint64(11)) / float(1 << 53)


def on_wall(number):
    """Points on the walls of a room of 10 by 8 by 3."""
    wall = (random(4 * number) * 6.0).astype(int)
    points = np.stack([random(4 * number + k) for k in (1, 2, 3)], axis=1)
    points[np.arange(len(number)), wall // 2] = wall % 2
    return points * [10.0, 8.0, 3.0]


def inside(number):
    """Centres well within it."""
    share = np.stack([0.1 + 0.8 * random((1 << 40) | (3 * number + k)) for k in range(3)], axis=1)
    return share * [10.0, 8.0, 3.0]


def main():
    labels = sys.argv[1] if len(sys.argv) > 1 else "votes"
    positions, centers = on_wall(np.arange(POINTS)), inside(np.arange(VIEWS))
    seen_by = np.arange(POINTS) % VIEWS
    carver = linecarve.Carver(labels=labels)
    start = time.perf_counter()
    with carver.transaction() as change:
        views = change.add_views(centers)
        points = change.add_points(positions, sigma=0.01)
        change.add_observations(views[seen_by], points)
    seconds = time.perf_counter() - start
    print(json.dumps({"labels": labels, "triangles": carver.triangle_count, "seconds": round(seconds, 3)}))


if __name__ == "__main__":
    main()
