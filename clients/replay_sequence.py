#!/usr/bin/env python3
"""Replays a recorded sequence to `linecarve stream` as a live SLAM system would.

A stand-in for the place in a SLAM system where keyframes are made. Poses are sent with an error that grows like drift;
now and then, as after a bundle adjustment or a loop closure, better poses of all keyframes so far follow, at the end the
recorded ones. The changes of the surface that come back are applied to a mesh, which is compared with the program's own
count after every step.

    linecarve reconstruct kitchen --out out/batch
    clients/replay_sequence.py kitchen --report out/batch/report.json --out out/live
    linecarve diff out/batch/mesh.ply out/live/mesh.ply

With --no-depth (and `reconstruct --depth semi-dense`) depth images are left out: depth comes from the images alone.

With --track all frames are sent without poses, as a camera would: the program tracks them and chooses keyframes itself. With
--no-depth too it tracks with one camera, or with both of a stereo recording.

    clients/replay_sequence.py kitchen --track --out out/live
    linecarve evaluate --trajectory out/live/trajectory.txt --reference kitchen
    clients/replay_sequence.py V1_01_easy --track --out out/stereo

Reads the 7-Scenes layout (frame-NNNNNN.color.jpg|png, .depth.png, .pose.txt) with its camera-intrinsics.txt, the layout of
Open3D (image/NNNNN.jpg|png, depth/NNNNN.png, trajectory.log, camera_primesense.json), and with --track that of EuRoC (mav0/cam0 and
cam1 with sensor.yaml; images of one name are a pair). A linecarve.toml beside them counts for what it says. Python 3.11 or newer,
nothing else.
"""

import argparse
import base64
import json
import math
import pathlib
import queue
import re
import subprocess
import sys
import threading
import tomllib


def rows_of(path, words):
    """The four rows of 16 numbers."""
    if len(words) != 16:
        sys.exit(f"{path}: 16 numbers are needed for a pose, there are {len(words)}")
    numbers = [float(word) for word in words]
    return [numbers[4 * row : 4 * row + 4] for row in range(4)]


def euroc_camera(path):
    """The table of a camera, and its `T_BS` (body from camera), from the lines of a sensor.yaml."""
    text = " ".join(line.split("#")[0] for line in path.read_text().splitlines())

    def numbers(key):
        found = re.search(key + r":\s*\[([^]]*)\]", text)
        return [float(word) for word in found[1].split(",")] if found else []

    camera = dict(zip(("fx", "fy", "cx", "cy"), numbers("intrinsics")))
    camera |= dict(zip(("width", "height"), map(int, numbers("resolution"))))
    distortion = numbers("distortion_coefficients")
    if any(distortion):
        is_fisheye = re.search(r"distortion_model:\s*equi", text)
        camera |= {"model": "kannala-brandt" if is_fisheye else "radial-tangential", "distortion": distortion}
    return camera, rows_of(path, numbers("data"))


def product(a, b):
    """The product of two transforms, as four rows."""
    return [[sum(a[i][k] * b[k][j] for k in range(4)) for j in range(4)] for i in range(4)]


def inverse(rows):
    """The inverse of a rigid transform."""
    turned = [[rows[j][i] for j in range(3)] for i in range(3)]
    shift = [-sum(turned[i][k] * rows[k][3] for k in range(3)) for i in range(3)]
    return [[*turned[i], shift[i]] for i in range(3)] + [[0.0, 0.0, 0.0, 1.0]]


class EurocRecording:
    """Image pairs without poses, and the calibration of both cameras."""

    is_posed = False

    def __init__(self, folder):
        left, right = (folder / "mav0" / camera for camera in ("cam0", "cam1"))
        self.images = {path.stem: path for path in sorted((left / "data").iterdir())}
        self.right_images = {path.stem: path for path in (right / "data").iterdir()} if right.exists() else {}
        self.frames = [name for name in self.images if name in self.right_images or not self.right_images]
        color, body_from_left = euroc_camera(left / "sensor.yaml")
        self.calibration = {"color": color}
        if self.right_images:
            camera, body_from_right = euroc_camera(right / "sensor.yaml")
            motion = product(inverse(body_from_left), body_from_right)
            self.calibration["right"] = camera | {"color_from_right": motion}

    def color(self, name):
        return self.images[name]

    def right(self, name):
        return self.right_images.get(name)


class Recording:
    """Where the images and poses of a sequence are, and its calibration."""

    is_posed = True

    def __init__(self, folder):
        self.folder = folder
        self.log = {}
        sidecar = folder / "linecarve.toml"
        self.calibration = tomllib.loads(sidecar.read_text()) if sidecar.exists() else {}
        if (folder / "trajectory.log").exists():
            lines = (folder / "trajectory.log").read_text().split("\n")
            for head in range(0, len(lines) - 4, 5):
                words = " ".join(lines[head + 1 : head + 5]).split()
                self.log[int(lines[head].split()[0])] = rows_of(folder / "trajectory.log", words)
            self.frames = sorted(path.stem for path in (folder / "image").iterdir() if int(path.stem) in self.log)
            camera = folder / "camera_primesense.json"
            matrix = json.loads(camera.read_text())["intrinsic_matrix"] if camera.exists() else None
        else:
            self.frames = sorted(path.name.split(".")[0] for path in folder.glob("frame-*.pose.txt"))
            camera = folder / "camera-intrinsics.txt"
            # By rows here, by columns there.
            words = camera.read_text().split() if camera.exists() else None
            matrix = words and [float(words[at]) for at in (0, 3, 6, 1, 4, 7, 2, 5, 8)]
        if matrix:
            intrinsics = {"fx": matrix[0], "fy": matrix[4], "cx": matrix[6], "cy": matrix[7]}
            self.calibration.setdefault("color", intrinsics)
        if not self.frames or "color" not in self.calibration:
            sys.exit(f"{folder}: poses and the intrinsics of the colour camera are needed, in one of the two layouts")

    def pose(self, name):
        if self.log:
            return self.log[int(name)]
        path = self.folder / f"{name}.pose.txt"
        return rows_of(path, path.read_text().split())

    def color(self, name):
        return next(self.folder.glob(f"image/{name}.*" if self.log else f"{name}.color.*"))

    def depth(self, name):
        return self.folder / (f"depth/{name}.png" if self.log else f"{name}.depth.png")

    def right(self, name):
        return None


def drifted(rows, number, per_keyframe):
    """A pose with the drift of `number` keyframes: a turn about the world's y axis and a step along x."""
    angle, step = number * per_keyframe * 0.1, number * per_keyframe
    cos, sin = math.cos(angle), math.sin(angle)
    turn = [[cos, 0.0, sin, step], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 0.0], [0.0, 0.0, 0.0, 1.0]]
    return product(turn, rows)


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
        # Called with replies that no message caused.
        self.when_idle = lambda reply: None
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self.replies.put(json.loads(line))
        self.replies.put(None)

    def send(self, **message):
        """Sends a message and waits for its reply. A live system would not wait, but read replies in another thread."""
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()
        return self.receive()

    def receive(self):
        """The next reply to a message."""
        reply = self.replies.get()
        while reply is not None and reply.get("idle"):
            self.when_idle(reply)
            reply = self.replies.get()
        if reply is None:
            sys.exit(f"linecarve ended with status {self.process.wait()}")
        if reply["type"] == "error":
            print(f"line {reply['line']}: {reply['message']}", file=sys.stderr)
        return reply

    def close(self):
        """Waits for the end of the program."""
        self.process.stdin.close()
        self.process.wait()


def follow_frame(reply, surface):
    """Applies the reply to a frame without pose to the surface, and describes it."""
    if "surface" in reply:
        surface.apply(reply["surface"])
    pose = reply["world_from_camera"]
    where = "at " + " ".join(f"{x:.3f}" for x in pose["translation"]) if pose else f"no pose: {reply['reason']}"
    for warning in reply.get("warnings", []):
        print(f"frame {reply['id']}: {warning}", file=sys.stderr)
    count = len(reply.get("corrected_poses", []))
    return f"frame {reply['id']}: {where}; keyframes {reply['keyframes']}, {count} poses corrected"


def track(linecarve, recording, frames, image, has_depth):
    """Sends frames without poses, and prints what becomes of them."""
    surface, milliseconds = Surface(), []
    linecarve.when_idle = surface.apply
    for name in frames:
        images = {"color": image(recording.color(name))}
        if has_depth:
            images["depth"] = image(recording.depth(name))
        if recording.right(name):
            images["right"] = image(recording.right(name))
        if not recording.is_posed:
            # Names of EuRoC are times in nanoseconds.
            images["timestamp_ns"] = int(name)
        reply = linecarve.send(type="frame", id=int(name.split("-")[-1]), **images)
        if reply["type"] == "frame":
            print(follow_frame(reply, surface))
            milliseconds.append(reply["milliseconds"])
    end = linecarve.send(type="end")
    while end["type"] != "end":
        if end["type"] == "surface":
            surface.apply(end)
            print(f"last adjustment: {len(end['added'])} triangles new, {len(end['removed'])} gone, {end['milliseconds']:.0f} ms")
        end = linecarve.receive()
    linecarve.close()
    tracking, milliseconds = end["tracking"], sorted(milliseconds)
    print(f"{tracking['tracked']} of {tracking['frames']} frames have a pose, {end['keyframes']} keyframes, {end['triangles']} "
          f"triangles; a frame takes {milliseconds[len(milliseconds) // 2]:.1f} ms (median), {milliseconds[-1]:.0f} at most")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sequence", type=pathlib.Path)
    parser.add_argument("--report", type=pathlib.Path, help="report.json of a batch run: its keyframes and median depth")
    parser.add_argument("--track", action="store_true", help="send frames without poses")
    parser.add_argument("--every", type=int, help="without a report: every n-th frame; default 7, with --track 1")
    parser.add_argument("--drift", type=float, default=0.002, help="error that each keyframe adds, in units of the poses")
    parser.add_argument("--correct-every", type=int, default=10, help="keyframes between corrections of all poses; 0: none")
    parser.add_argument("--no-depth", action="store_true", help="send no depth images: depth comes from the images alone")
    parser.add_argument("--config", help="file with the parameters of the stages")
    parser.add_argument("--bytes", action="store_true", help="send images in the messages in place of their paths")
    parser.add_argument("--program", default="linecarve")
    parser.add_argument("--out", help="folder for the final mesh")
    options = parser.parse_args()

    is_euroc = (options.sequence / "mav0").exists()
    if is_euroc and not options.track:
        parser.error("the layout of EuRoC needs --track")
    options.no_depth |= is_euroc
    recording = EurocRecording(options.sequence) if is_euroc else Recording(options.sequence)
    start = {"calibration": recording.calibration}
    if options.no_depth:
        start["depth_source"] = "semi-dense"
    if options.track:
        start["poses"] = "track"
        # Poses that are found are those of the colour camera.
        recording.calibration.pop("poses", None)
    if options.report:
        report = json.loads(options.report.read_text())
        keyframes = [keyframe["frame"] for keyframe in report["keyframes"]]
        start["median_depth"] = report["sequence"]["median_depth"]
        start["origin"] = report["sequence"]["origin"]
    else:
        keyframes = recording.frames[:: options.every or 7]

    def image(path):
        return {"base64": base64.b64encode(path.read_bytes()).decode()} if options.bytes else {"path": str(path)}

    arguments = ["--out", options.out] if options.out else []
    arguments += ["--config", options.config] if options.config else []
    linecarve = Linecarve(options.program, arguments)
    if linecarve.send(type="start", **start)["type"] != "ready":
        sys.exit("the calibration was refused")
    if options.track:
        track(linecarve, recording, recording.frames[:: options.every or 1], image, not options.no_depth)
        return
    surface, poses, milliseconds, corrections = Surface(), {}, [], []
    linecarve.when_idle = surface.apply
    since_correction = 0
    for number, name in enumerate(keyframes):
        poses[number] = recording.pose(name)
        images = {"color": image(recording.color(name))}
        if not options.no_depth:
            images["depth"] = image(recording.depth(name))
        world_from_camera = {"matrix": drifted(poses[number], since_correction, options.drift)}
        reply = linecarve.send(type="keyframe", id=number, world_from_camera=world_from_camera, **images)
        since_correction += 1
        if reply["type"] == "surface":
            surface.apply(reply)
            milliseconds.append(reply["milliseconds"])
            print(f"{name}: {reply['triangles']} triangles, {len(reply['added'])} new, {len(reply['removed'])} gone")
        else:
            del poses[number]
        is_last = number + 1 == len(keyframes)
        if options.correct_every > 0 and (since_correction == options.correct_every or is_last):
            updates = [{"id": id, "world_from_camera": {"matrix": pose}} for id, pose in poses.items()]
            reply = linecarve.send(type="poses", poses=updates)
            surface.apply(reply)
            corrections.append(reply["milliseconds"])
            print(f"poses corrected: {len(reply['added'])} triangles new, {len(reply['removed'])} gone")
            since_correction = 0
    end = linecarve.send(type="end")
    while end["type"] != "end":
        if end["type"] == "surface":
            surface.apply(end)
            print(f"last estimates: {len(end['added'])} triangles new, {len(end['removed'])} gone, {end['milliseconds']:.0f} ms")
        end = linecarve.receive()
    linecarve.close()
    print(f"{end['keyframes']} keyframes, {end['triangles']} triangles, {sorted(milliseconds)[len(milliseconds) // 2]:.1f} ms a "
          f"keyframe (median), {max(corrections, default=0):.0f} ms the longest of {len(corrections)} corrections")
    if "corrected_poses" in end:
        print(f"the images contradict the poses of {len(end['corrected_poses'])} keyframes: corrected")


if __name__ == "__main__":
    main()
