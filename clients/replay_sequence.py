#!/usr/bin/env python3
"""Replays a recorded sequence to `linecarve stream` as a live SLAM system would.

A stand-in for the place in a SLAM system where keyframes are made. Poses are sent with an error that grows like drift;
now and then, as after a bundle adjustment or a loop closure, better poses of all keyframes so far follow, at the end the
recorded ones. The changes of the surface that come back are applied to a mesh, which is compared with the program's own
count after every step.

    linecarve reconstruct kitchen --out out/batch
    clients/replay_sequence.py kitchen --report out/batch/report.json --out out/live
    linecarve diff out/batch/mesh.ply out/live/mesh.ply

Reads the 7-Scenes layout (frame-NNNNNN.color.jpg|png, .depth.png, .pose.txt) with its linecarve.toml. Python 3.11 or newer,
nothing else.
"""

import argparse
import base64
import json
import math
import pathlib
import queue
import subprocess
import sys
import threading
import tomllib


def pose_of(path):
    """The four rows of a pose file."""
    numbers = [float(word) for word in path.read_text().split()]
    if len(numbers) != 16:
        sys.exit(f"{path}: 16 numbers are needed, there are {len(numbers)}")
    return [numbers[4 * row : 4 * row + 4] for row in range(4)]


def drifted(rows, number, per_keyframe):
    """A pose with the drift of `number` keyframes: a turn about the world's y axis and a step along x."""
    angle, step = number * per_keyframe * 0.1, number * per_keyframe
    cos, sin = math.cos(angle), math.sin(angle)
    turn = [[cos, 0.0, sin, step], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 0.0], [0.0, 0.0, 0.0, 1.0]]
    return [[sum(turn[i][k] * rows[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


class Surface:
    """A mesh that follows the changes."""

    def __init__(self):
        self.vertices, self.triangles = [], {}

    def apply(self, reply):
        assert reply["first_vertex"] == len(self.vertices), "a change was missed"
        self.vertices += reply["vertices"]
        for triangle in map(tuple, reply["removed"]):
            self.triangles[triangle] -= 1
            if not self.triangles[triangle]:
                del self.triangles[triangle]
        for triangle in map(tuple, reply["added"]):
            self.triangles[triangle] = self.triangles.get(triangle, 0) + 1
        assert sum(self.triangles.values()) == reply["triangles"], "the changes do not add up"


class Linecarve:
    """The program, and the replies that come while messages go."""

    def __init__(self, program, arguments):
        self.process = subprocess.Popen(
            [program, "stream", *arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.replies = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self.replies.put(json.loads(line))
        self.replies.put(None)

    def send(self, **message):
        """Sends a message and waits for its reply. A live system would not wait, but read replies in another thread."""
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()
        reply = self.replies.get()
        if reply is None:
            sys.exit(f"linecarve ended with status {self.process.wait()}")
        if reply["type"] == "error":
            print(f"line {reply['line']}: {reply['message']}", file=sys.stderr)
        return reply


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=pathlib.Path)
    parser.add_argument("--report", type=pathlib.Path, help="report.json of a batch run: its keyframes and median depth")
    parser.add_argument("--every", type=int, default=7, help="without a report: every n-th frame")
    parser.add_argument("--drift", type=float, default=0.002, help="error that each keyframe adds, in units of the poses")
    parser.add_argument("--correct-every", type=int, default=10, help="keyframes between corrections of all poses")
    parser.add_argument("--bytes", action="store_true", help="send images in the messages in place of their paths")
    parser.add_argument("--program", default="linecarve")
    parser.add_argument("--out", help="folder for the final mesh")
    options = parser.parse_args()

    frames = sorted(path.name.split(".")[0] for path in options.sequence.glob("frame-*.pose.txt"))
    sidecar = options.sequence / "linecarve.toml"
    if not frames or not sidecar.exists():
        sys.exit(f"{options.sequence}: frame-NNNNNN.pose.txt files and linecarve.toml are needed")
    start = {"calibration": tomllib.loads(sidecar.read_text())}
    if options.report:
        report = json.loads(options.report.read_text())
        keyframes = [keyframe["frame"] for keyframe in report["keyframes"]]
        start["median_depth"] = report["sequence"]["median_depth"]
        start["origin"] = report["sequence"]["origin"]
    else:
        keyframes = frames[:: options.every]

    def image(path):
        return {"base64": base64.b64encode(path.read_bytes()).decode()} if options.bytes else {"path": str(path)}

    linecarve = Linecarve(options.program, ["--out", options.out] if options.out else [])
    if linecarve.send(type="start", **start)["type"] != "ready":
        sys.exit("the calibration was refused")
    surface, poses, milliseconds, corrections = Surface(), {}, [], []
    since_correction = 0
    for number, name in enumerate(keyframes):
        poses[number] = pose_of(options.sequence / f"{name}.pose.txt")
        color = next(options.sequence.glob(f"{name}.color.*"))
        reply = linecarve.send(
            type="keyframe",
            id=number,
            world_from_camera={"matrix": drifted(poses[number], since_correction, options.drift)},
            color=image(color),
            depth=image(options.sequence / f"{name}.depth.png"),
        )
        since_correction += 1
        if reply["type"] == "surface":
            surface.apply(reply)
            milliseconds.append(reply["milliseconds"])
            print(f"{name}: {reply['triangles']} triangles, {len(reply['added'])} new, {len(reply['removed'])} gone")
        else:
            del poses[number]
        if since_correction == options.correct_every or number + 1 == len(keyframes):
            updates = [{"id": id, "world_from_camera": {"matrix": pose}} for id, pose in poses.items()]
            reply = linecarve.send(type="poses", poses=updates)
            surface.apply(reply)
            corrections.append(reply["milliseconds"])
            print(f"poses corrected: {len(reply['added'])} triangles new, {len(reply['removed'])} gone")
            since_correction = 0
    end = linecarve.send(type="end")
    assert end["triangles"] == sum(surface.triangles.values())
    print(f"{end['keyframes']} keyframes, {end['triangles']} triangles, {sorted(milliseconds)[len(milliseconds) // 2]:.1f} ms a "
          f"keyframe (median), {max(corrections):.0f} ms the longest of {len(corrections)} corrections")


if __name__ == "__main__":
    main()
