"""`reconstruct` and the program."""

import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import linecarve

ROOM = pathlib.Path(__file__).parents[2] / "assets" / "room"
QUICK = dict(max_keyframes=4, min_translation=0.3)


def test_the_sample_is_reconstructed():
    room = linecarve.reconstruct(ROOM, **QUICK)
    assert isinstance(room, linecarve.Mesh)
    n, m = len(room.vertices), len(room.triangles)
    assert room.vertices.shape == (n, 3) and room.vertices.dtype == np.float64
    assert room.triangles.shape == (m, 3) and room.triangles.dtype == np.uint32
    assert room.colors.shape == (n, 3) and room.colors.dtype == np.uint8
    assert n > 500 and m > 500 and room.triangles.max() == n - 1
    # The attributes are the arrays themselves.
    assert room.vertices is room.vertices and np.shares_memory(room.vertices, room.vertices)
    assert len(room.keyframes) == 4 and room.poses.shape == (4, 4, 4)
    np.testing.assert_allclose(room.poses[:, 3], [[0, 0, 0, 1]] * 4)
    rotation = room.poses[0, :3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert room.segments.lines.max() < len(room.segments.points)
    assert len(room.clusters.lines) < len(room.segments.lines)


def test_files_are_those_of_the_program(tmp_path):
    here = linecarve.reconstruct(ROOM, tmp_path / "a", no_page=True, no_picture=True, format=["ply", "obj"], **QUICK)
    arguments = ["reconstruct", ROOM, "--out", tmp_path / "b", "--no-page", "--no-picture", "--format", "ply,obj", "--quiet"]
    arguments += ["--max-keyframes", "4", "--min-translation", "0.3"]
    subprocess.run([sys.executable, "-m", "linecarve", *map(str, arguments)], check=True)
    for name in ("mesh.ply", "mesh.obj", "segments.ply"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert not (tmp_path / "a" / "mesh.glb").exists()
    corners = [line.split()[1:4] for line in (tmp_path / "a" / "mesh.obj").read_text().splitlines() if line.startswith("v ")]
    np.testing.assert_allclose(here.vertices, np.array(corners, float), atol=1e-5)
    assert np.array_equal(here.vertices, linecarve.reconstruct(ROOM, **QUICK).vertices)


def test_errors_name_file_and_remedy(tmp_path):
    with pytest.raises(linecarve.Error, match="nowhere"):
        linecarve.reconstruct(tmp_path / "nowhere")
    with pytest.raises(ValueError, match="--max-keyframes"):
        linecarve.reconstruct(ROOM, max_keyframe=4)
    with pytest.raises(ValueError, match="votes"):
        linecarve.reconstruct(ROOM, labels="best")
    with pytest.raises(TypeError):
        linecarve.reconstruct()
    assert issubclass(linecarve.EmptyMeshError, linecarve.Error)


def test_other_threads_run_meanwhile():
    count, done = 0, threading.Event()

    def work():
        try:
            linecarve.reconstruct(ROOM, **QUICK)
        finally:
            done.set()

    thread = threading.Thread(target=work)
    thread.start()
    while not done.is_set():
        time.sleep(0.001)
        count += 1
    thread.join()
    assert count > 10


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_ends_a_run():
    # Shells start commands in the background without the handler of Python.
    program = f"""
import linecarve, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
print("begins", flush=True)
try:
    linecarve.reconstruct({str(ROOM)!r}, every=1)
except KeyboardInterrupt:
    print("interrupted")
    print(len(linecarve.reconstruct({str(ROOM)!r}, max_keyframes=2).keyframes))
"""
    run = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    assert run.stdout.readline() == "begins\n"
    time.sleep(0.3)
    run.send_signal(signal.SIGINT)
    assert run.stdout.read() == "interrupted\n2\n"
    assert run.wait() == 0


def test_the_program_has_its_exit_status():
    def status(*arguments):
        run = subprocess.run([sys.executable, "-m", "linecarve", *arguments], capture_output=True, text=True)
        return run.returncode, run.stdout + run.stderr

    code, text = status("--version")
    assert code == 0 and text.split()[1] == linecarve.__version__
    assert status("reconstruct")[0] == 2
    code, text = status("info", "/no/such/folder")
    assert code == 2 and "/no/such/folder" in text
