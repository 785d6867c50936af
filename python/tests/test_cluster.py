"""`linecarve.cluster` on a cluster of this machine."""

import os
import pathlib
import signal
import subprocess
import sys
import threading
import time

import pytest

distributed = pytest.importorskip("distributed")

import linecarve
from linecarve import cluster

ROOM = pathlib.Path(__file__).parents[2] / "assets" / "room"
PROGRAM = [sys.executable, "-m", "linecarve"]


@pytest.fixture(scope="module")
def client():
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local,
        distributed.Client(local) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def city(tmp_path_factory):
    """A cloud and the mesh that one process makes of it."""
    folder = tmp_path_factory.mktemp("city")
    subprocess.run([*PROGRAM, "synth", "city", "--points", "3000", "-q", "--out", folder / "city"], check=True)
    cloud = folder / "city" / "fused.ply"
    how = ["--from", "map-points", "--final-only", "--format", "ply", "--labels", "cut", "--no-page", "--no-picture"]
    subprocess.run([*PROGRAM, "reconstruct", cloud, *how, "--quiet", "--out", folder / "whole"], check=True)
    return cloud, (folder / "whole" / "mesh.ply").read_bytes()


def test_tiles_have_the_bytes_of_one_process(client, city, tmp_path):
    cloud, whole = city
    run = cluster.reconstruct(cloud, work=tmp_path / "work", client=client, labels="cut", tiles=3, memory="4G")
    assert run.mesh_path.read_bytes() == whole
    assert run.tiles == 3 and run.report["label"]["tasks"] == 3 and run.report["merge"]["peak_mb"] > 0
    run.mesh_path.unlink()
    manifest = tmp_path / "work" / "carve" / "000001.json"
    before = manifest.stat().st_mtime_ns
    again = cluster.reconstruct(cloud, work=tmp_path / "work", client=client, labels="cut", tiles=3)
    assert again.mesh_path.read_bytes() == whole and manifest.stat().st_mtime_ns == before


def test_a_sequence_in_tiles_has_the_bytes_of_one_process(client, tmp_path):
    how = ["--from", "map-points", "--final-only", "--format", "ply", "--every", "3", "--no-page", "--no-picture"]
    subprocess.run([*PROGRAM, "reconstruct", ROOM, *how, "--quiet", "--out", tmp_path / "whole"], check=True)
    options = dict(every=3, keyframes_per_task=5, tiles=2)
    run = cluster.reconstruct(ROOM, work=tmp_path / "work", client=client, **options)
    assert run.mesh_path.read_bytes() == (tmp_path / "whole" / "mesh.ply").read_bytes()
    assert run.report["keyframes"]["tasks"] == 3 and run.report["intake"]["tasks"] == 1


def test_killed_processes_are_started_again(client, city, tmp_path):
    cloud, whole = city
    # Kills itself before every task's first attempt.
    script = tmp_path / "program.py"
    script.write_text(
        "import os, pathlib, signal, subprocess, sys\n"
        "mark = pathlib.Path(__file__).parent / ('-'.join(sys.argv[1:3] + sys.argv[4:6]).replace('/', '_') + '.mark')\n"
        "if sys.argv[1:3] == ['tiles', 'item'] and not mark.exists():\n"
        "    mark.touch()\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
        "sys.exit(subprocess.call([sys.executable, '-m', 'linecarve', *sys.argv[1:]]))\n"
    )
    program = [sys.executable, str(script)]
    work = tmp_path / "work"
    run = cluster.reconstruct(cloud, work=work, client=client, labels="cut", tiles=2, program=program)
    assert run.mesh_path.read_bytes() == whole
    assert len(list(tmp_path.glob("*.mark"))) >= 12


def test_a_task_that_hangs_is_started_again(client, city, tmp_path, monkeypatch):
    cloud, whole = city
    monkeypatch.setattr(cluster, "_STRAGGLER", 0.5)
    # The first attempt of one task hangs.
    script = tmp_path / "program.py"
    script.write_text(
        "import os, pathlib, subprocess, sys, time\n"
        "pid = pathlib.Path(__file__).parent / 'pid'\n"
        "if sys.argv[1:3] == ['tiles', 'item'] and sys.argv[4:6] == ['carve', '3'] and not pid.exists():\n"
        "    pid.write_text(str(os.getpid()))\n"
        "    time.sleep(600)\n"
        "sys.exit(subprocess.call([sys.executable, '-m', 'linecarve', *sys.argv[1:]]))\n"
    )
    program = [sys.executable, str(script)]
    run = cluster.reconstruct(cloud, work=tmp_path / "work", client=client, labels="cut", tiles=6, program=program)
    assert run.mesh_path.read_bytes() == whole
    # What hung was ended.
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / "pid").read_text()), 0)
    # The list of the folder stays, no unfinished file does.
    assert [path.name for path in (tmp_path / "work").glob(".linecarve*")] == [".linecarve-files"]


def test_a_worker_that_is_stopped_changes_nothing(client, city, tmp_path, monkeypatch):
    cloud, whole = city
    monkeypatch.setattr(cluster, "_STRAGGLER", 1.0)
    monkeypatch.setattr(cluster, "_SILENCE", 2.0)
    stopped = next(iter(client.run(os.getpid).values()))
    work = tmp_path / "work"

    def stop():
        while not list(work.glob("frame/*.json")):
            time.sleep(0.01)
        os.kill(stopped, signal.SIGSTOP)

    thread = threading.Thread(target=stop)
    thread.start()
    try:
        run = cluster.reconstruct(cloud, work=work, client=client, labels="cut", tiles=8)
        assert run.mesh_path.read_bytes() == whole
    finally:
        thread.join()
        os.kill(stopped, signal.SIGCONT)


def test_a_lost_worker_changes_nothing(client, city, tmp_path):
    cloud, whole = city
    pids = list(client.run(os.getpid).values())
    killer = threading.Timer(1.5, os.kill, (pids[0], signal.SIGKILL))
    killer.start()
    run = cluster.reconstruct(cloud, work=tmp_path / "work", client=client, labels="cut", tiles=4)
    killer.join()
    assert run.mesh_path.read_bytes() == whole


def test_errors_name_the_task_and_the_remedy(client, city, tmp_path):
    cloud, _ = city
    with pytest.raises(linecarve.Error, match="nothing"):
        cluster.reconstruct(tmp_path / "nothing", work=tmp_path / "a", client=client)
    if sys.platform == "linux":
        with pytest.raises(linecarve.Error, match="frame .*memory"):
            cluster.reconstruct(cloud, work=tmp_path / "b", client=client, tiles=2, memory="1M")


def test_tasks_end_when_the_run_is_cancelled(client, tmp_path):
    script = tmp_path / "program.py"
    pid = tmp_path / "pid"
    script.write_text(
        "import os, pathlib, time\n"
        f"part = pathlib.Path({str(pid)!r} + '.part')\n"
        "part.write_text(str(os.getpid())); part.rename(str(part)[:-5])\n"
        "time.sleep(600)\n"
    )

    def interrupt():
        while not pid.exists():
            time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    # Shells start commands in the background without it.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        program = [sys.executable, str(script)]
        cluster.reconstruct(ROOM, work=tmp_path / "work", client=client, program=program)
    thread.join()
    signal.signal(signal.SIGINT, before)
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid.read_text()), 0)


def test_sequences_are_one_task_each(client, tmp_path):
    options = dict(max_keyframes=3, min_translation=0.3, no_page=True, no_picture=True)
    [room] = cluster.reconstruct_many([ROOM], tmp_path, client=client, **options)
    assert (room / "mesh.ply").stat().st_size > 1000
    with pytest.raises(ValueError, match="room"):
        cluster.reconstruct_many([ROOM, ROOM], tmp_path, client=client)


def test_an_interrupted_sequence_goes_on(client, tmp_path):
    script = tmp_path / "program.py"
    script.write_text(
        "import os, pathlib, signal, sys\n"
        "out = pathlib.Path(sys.argv[sys.argv.index('--out') + 1])\n"
        "if '--resume' in sys.argv:\n"
        "    (out / 'mesh.ply').write_text('resumed')\n"
        "else:\n"
        "    (out / '.linecarve').mkdir(parents=True)\n"
        "    (out / '.linecarve' / 'run.txt').write_text('')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    [room] = cluster.reconstruct_many([ROOM], tmp_path, client=client, program=[sys.executable, str(script)])
    assert (room / "mesh.ply").read_text() == "resumed"


def test_little_goes_through_the_scheduler(client, tmp_path, monkeypatch):
    from distributed.comm.tcp import TCP

    # The client and the scheduler, which are in this process. What workers send is a fifth of all.
    sent = []
    write = TCP.write

    async def counted(self, *arguments, **options):
        sent.append(await write(self, *arguments, **options))
        return sent[-1]

    monkeypatch.setattr(TCP, "write", counted)
    program = [sys.executable, "-c", "pass", "tiles", "item", "/scratch/a folder of some length/run1", "carve"]
    tasks = {f"carve {number}": [*program, str(number), "--threads", "1"] for number in range(50)}
    cluster._carry_out(client, tasks, cluster._Cancel(tmp_path), retries=0)
    assert 300 * len(tasks) < sum(sent) < 2500 * len(tasks)
