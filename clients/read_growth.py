#!/usr/bin/env python3
"""Rebuilds the surface after each keyframe from the files of `linecarve reconstruct --growth delta`.

    linecarve reconstruct kitchen --out out/kitchen --growth delta
    clients/read_growth.py out/kitchen/keyframes --out out/surfaces --every 10

writes every tenth surface as PLY, and the last one. As a module:

    for number, surface in surfaces("out/kitchen/keyframes"):
        print(number, len(surface.vertices), len(surface.triangles))

A surface costs what its keyframe changed. The format is described in docs/outputs.md. Python 3.11 or newer, nothing else.
"""

import argparse
import pathlib
import struct
import sys

MAGIC = b"LCDELTA1"
HEADER = struct.Struct("<8s3d7I")
PLACED = struct.Struct("<I3f4B")
RECOLORED = struct.Struct("<I4B")
NUMBER = struct.Struct("<I")
TRIANGLE = struct.Struct("<3I")


class Surface:
    """A surface that follows the files of its keyframes.

    `vertices` maps the number of a vertex to its position and its colour, `triangles` is a set of triples of such numbers,
    counter-clockwise seen from free space. Positions are relative to `origin`, in the frame of the poses; a colour is red,
    green, blue and 255, or grey and 0 where none was observed.
    """

    def __init__(self):
        self.origin = (0.0, 0.0, 0.0)
        self.vertices = {}
        self.triangles = set()

    def apply(self, path):
        """Applies the file of the next keyframe."""
        data = pathlib.Path(path).read_bytes()
        if len(data) < HEADER.size or not data.startswith(MAGIC):
            raise ValueError(f"{path}: not a file of `linecarve reconstruct --growth delta`")
        _, *numbers = HEADER.unpack_from(data)
        self.origin = tuple(numbers[:3])
        vertices, triangles, *counts = numbers[3:]
        parts = [TRIANGLE, NUMBER, PLACED, RECOLORED, TRIANGLE]
        if len(data) != HEADER.size + sum(n * part.size for n, part in zip(counts, parts)):
            raise ValueError(f"{path}: the file is {len(data)} bytes long, which its header contradicts")
        at = HEADER.size
        lists = []
        for count, part in zip(counts, parts):
            end = at + count * part.size
            lists.append(part.iter_unpack(data[at:end]))
            at = end
        removed, freed, placed, recolored, added = lists
        self.triangles.difference_update(removed)
        for (number,) in freed:
            self.vertices.pop(number, None)
        for number, x, y, z, *color in placed:
            self.vertices[number] = ((x, y, z), tuple(color))
        for number, *color in recolored:
            position, _ = self.vertices.get(number, (None, None))
            if position is None:
                raise ValueError(f"{path}: does not continue the files before it; is one missing?")
            self.vertices[number] = (position, tuple(color))
        self.triangles.update(added)
        if (len(self.vertices), len(self.triangles)) != (vertices, triangles):
            raise ValueError(f"{path}: does not continue the files before it; is one missing?")

    def write_ply(self, path):
        """Writes a binary PLY file in the frame of the poses."""
        numbers = sorted(self.vertices)
        index = {number: at for at, number in enumerate(numbers)}
        has_colors = any(color[3] for _, color in self.vertices.values())
        header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(numbers)}"]
        header += [f"property double {axis}" for axis in "xyz"]
        if has_colors:
            header += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
        header += [f"element face {len(self.triangles)}", "property list uchar int vertex_indices", "end_header"]
        body = bytearray()
        for number in numbers:
            position, color = self.vertices[number]
            body += struct.pack("<3d", *(value + shift for value, shift in zip(position, self.origin)))
            if has_colors:
                body += bytes(color[:3])
        for corners in sorted(self.triangles):
            body += struct.pack("<B3i", 3, *(index[corner] for corner in corners))
        pathlib.Path(path).write_bytes("\n".join(header).encode() + b"\n" + body)


def surfaces(folder):
    """Yields the number of each keyframe and the surface after it, which is the same object every time."""
    surface = Surface()
    for path in sorted(pathlib.Path(folder).glob("[0-9]*.delta")):
        surface.apply(path)
        yield int(path.stem), surface


def main():
    """Writes surfaces as PLY files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("keyframes", type=pathlib.Path, help="folder with NNNNNN.delta")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="folder for NNNNNN.ply; made when missing")
    parser.add_argument("--every", type=int, default=1, metavar="N", help="write every N-th surface, and the last one")
    arguments = parser.parse_args()
    if arguments.every < 1:
        parser.error("--every: 1 or more")
    arguments.out.mkdir(parents=True, exist_ok=True)
    number, written, surface = None, None, None
    try:
        for number, surface in surfaces(arguments.keyframes):
            if number % arguments.every == 0:
                surface.write_ply(arguments.out / f"{number:06}.ply")
                written = number
    except (OSError, ValueError) as error:
        sys.exit(str(error))
    if number is None:
        sys.exit(f"{arguments.keyframes}: no files NNNNNN.delta; make them with `linecarve reconstruct --growth delta`")
    if number != written:
        surface.write_ply(arguments.out / f"{number:06}.ply")


if __name__ == "__main__":
    main()
